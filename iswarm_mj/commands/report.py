"""`iswarm report` and `iswarm reproduce`."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, ClassVar

from iswarm_mj.commands.flags import changed, refuse
from iswarm_mj.commands.options import ManyRunsOptions
from iswarm_mj.experiments.runner.limits import Repeats
from iswarm_mj.utils.constraints import Needs, Within, check, validate


@dataclass(frozen=True)
class Report:
    """Put all results beside the paper's statements, on one HTML page."""

    results: tuple[Path, ...] = (Path("runs"),)
    """Directories with results of `iswarm experiment`, `iswarm evolve` and `iswarm grasp`, at any depth."""
    out: Path = Path("report.html")
    """The page, which embeds its figures."""

    def run(self) -> None:
        """Run the command."""
        check("results", "nothing", "at least one directory", bool(self.results))
        check("out", self.out, "a name that ends in .html", self.out.suffix == ".html")
        from iswarm_mj.experiments.report.writer import report

        report(self.results, self.out)


@dataclass(frozen=True)
class Reproduce(ManyRunsOptions):
    """Make all results, the findings on them, the report, and the tables of README and docs. What is there is kept."""

    MAIN: ClassVar = (
        "only",
        "list",
        "tables",
        "quick",
        "again",
        "reading",
        "engine",
        "results",
        "out",
    )

    only: tuple[str, ...] = ()
    """Parts to make, such as density or evolve-paper; --list names them. All by default."""
    list: bool = False
    """Say which parts are there, and why the others have to be made."""
    tables: bool = False
    """Rewrite the findings and the tables from existing results, without runs."""
    quick: bool = False
    """A trial of some minutes with few and short runs, away from the results and without tables in README and docs."""
    again: bool = False
    """Make also what is there, from the beginning."""
    replicates: Annotated[Repeats, Needs("quick", (False,))] = 16
    """Of each search."""
    trials: Annotated[int, Within(1, 10_000), Needs("quick", (False,))] = 20
    """Grasps at each radius and humidity."""
    results: Path | None = None
    """Directory of the results: results by default, and runs/reproduce-quick/results with --quick."""
    out: Path | None = None
    """Directory in which they are made, with all that is not kept, and of report.html; runs/reproduce by default."""
    pages: tuple[Path, ...] | None = None
    """Markdown files whose tables are written; README.md, docs/*.md and results/README.md by default, if they exist."""

    def __post_init__(self):
        validate(self)

    def run(self) -> None:
        """Run the command."""
        if self.tables:
            others = [name for name in changed(self) if name not in ("tables", "results", "out", "pages")]
            refuse(self, others, "with `tables`, which makes no runs")
        refuse(self, ["again"] if self.list else [], "with `list`")
        from iswarm_mj.experiments.report.reproduce import Places, listing, parts_of, reproduce, rewrite

        out = self.out or Path("runs/reproduce-quick" if self.quick else "runs/reproduce")
        results = self.results or (out / "results" if self.quick else Path("results"))
        places = Places(results, out, self._pages)
        if self.tables:
            rewrite(places)
        elif self.list:
            print(listing(parts_of(self._plans, self.only), results))
        else:
            reproduce(self._plans, places, self.only, self.again)

    @property
    def _pages(self) -> Sequence[Path]:
        """Pages whose tables are written."""
        if self.pages is not None or self.quick:
            return self.pages or ()
        return [
            path
            for path in (Path("README.md"), *sorted(Path("docs").glob("*.md")), Path("results/README.md"))
            if path.is_file()
        ]

    @property
    def _plans(self) -> Any:
        """Settings of all parts; the quick ones are just enough for each step to be taken."""
        from iswarm_mj.experiments.analysis.bench_statements import TRANSPORT
        from iswarm_mj.experiments.report.reproduce import Plans
        from iswarm_mj.experiments.runner.experiment import Plan
        from iswarm_mj.experiments.runner.search_settings import Search
        from iswarm_mj.gripper.bench.contacts import Contacts
        from iswarm_mj.gripper.bench.protocol import Protocol
        from iswarm_mj.workflows.grasp_settings import GraspSettings

        search, repeats = Search(config=self.config, seed=self.seed, replicates=self.replicates), self.trials
        if self.quick:
            search, repeats = replace(search, generations=3, population=4, steps=60, replicates=2), 1
        trials = GraspSettings(
            ("15e-6:25e-6:6",),
            (5.0, 10.0, 30.0, 50.0),
            repeats=repeats,
            seed=self.seed,
            protocol=Protocol(transport=TRANSPORT),
            contacts=Contacts(rolling=50e-9),
        )
        return Plans(Plan(self.config, seed=self.seed, quick=self.quick), search, trials, self.execution)
