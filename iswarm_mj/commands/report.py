"""`iswarm report` and `iswarm reproduce`."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, ClassVar

from iswarm_mj.commands.command_settings import changed_names, refuse_changed
from iswarm_mj.commands.options import ManyRunsOptions
from iswarm_mj.search.settings import Repeats
from iswarm_mj.utils.constraints import Needs, Within, validate
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.extras import require
from iswarm_mj.utils.files import check_name


@dataclass(frozen=True)
class Report:
    """Put all results beside the paper's statements, on one HTML page."""

    results: tuple[Path, ...] = (Path("runs"),)
    """Directories with results of `iswarm experiment`, `iswarm evolve` and `iswarm grasp`, at any
    depth."""
    out: Path = Path("report.html")
    """The page, which embeds its figures."""

    def run(self) -> None:
        """Run the command."""
        require("paper")
        if not self.results:
            raise UserError("--results has no value; name directories with results")
        check_name(self.out, ".html")
        from iswarm_mj.paper.report.html_report import write_report

        write_report(self.results, self.out)


@dataclass(frozen=True)
class Reproduce(ManyRunsOptions):
    """Make all results, the findings on them, the report, and the tables of README and docs.

    Results that are there are kept.
    """

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
    """List the parts that exist, and why the others have to be made."""
    tables: bool = False
    """Rewrite the findings and the tables from existing results, without runs."""
    quick: bool = False
    """A trial of some minutes with few and short runs, away from the results and without tables in
    README and docs."""
    again: Annotated[bool, Needs("list", (False,))] = False
    """Make also what is there, from the beginning."""
    replicates: Annotated[Repeats, Needs("quick", (False,))] = 16
    """Replicates of each search."""
    trials: Annotated[int, Within(1, 10_000), Needs("quick", (False,))] = 20
    """Grasps at each radius and humidity."""
    results: Path | None = None
    """Directory of the results: results/default by default, and runs/reproduce-quick/results with
    --quick."""
    out: Path | None = None
    """Directory in which they are made, with all that is not kept, and of report.html;
    runs/reproduce by default."""
    pages: tuple[Path, ...] | None = None
    """Markdown files whose tables are written; README.md, docs/*.md and results/README.md by
    default, if they exist."""

    def __post_init__(self):
        validate(self)

    def run(self) -> None:
        """Run the command."""
        require("paper")
        if self.tables:
            of_tables = ("tables", "results", "pages")
            of_runs = [name for name in changed_names(self) if name not in of_tables]
            refuse_changed(self, of_runs, "with `tables`, which makes no runs")
        from iswarm_mj.paper.report.reproduce import (
            listing,
            parts_of,
            reproduce,
            rewrite_findings,
        )
        from iswarm_mj.paper.studies.experiment import Plan

        if self.quick:
            out = self.out or Path("runs/reproduce-quick")
            results = self.results or out / "results"
        else:
            out = self.out or Path("runs/reproduce")
            results = self.results or Path("results/default")
        if self.tables:
            rewrite_findings(results, self._pages)
            return
        plan = Plan(self.config, seed=self.seed, quick=self.quick)
        parts = parts_of(plan, self.execution, self.replicates, self.trials, self.only)
        if self.list:
            print(listing(parts, results))
        else:
            reproduce(parts, results, out, self._pages, again=self.again)

    @property
    def _pages(self) -> Sequence[Path]:
        """Pages whose tables are written."""
        if self.pages is not None:
            return self.pages
        if self.quick:
            return ()
        pages = [Path("README.md"), *sorted(Path("docs").glob("*.md")), Path("results/README.md")]
        return [page for page in pages if page.is_file()]
