"""Tables of experiments, searches and trials below directories, their figures, the topics of
findings on them, and the
report: every statement of the paper's sections 3.2 and 4.6 beside the results, as an HTML page with
    its figures."""

import base64
import csv
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from shlex import join
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from iswarm_mj._version import __version__
from iswarm_mj.paper.analysis import bench_statements, evolution_statements
from iswarm_mj.paper.analysis.evolution import evolutions
from iswarm_mj.paper.analysis.findings import KINDS, Finding, findings_on
from iswarm_mj.paper.analysis.plots import draw_trade
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.search.methods import METHODS
from iswarm_mj.search.plots import draw_fitness
from iswarm_mj.search.rows import Rows
from iswarm_mj.search.search import FIGURE
from iswarm_mj.search.search import TABLE as SEARCH
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.files import atomic_write, check_name, make_output_directory
from iswarm_mj.utils.tables import read_table
from iswarm_mj.workflows.grasp import TABLE as TRIALS

LAWS, GRASP, EVOLUTION = "laws", "grasp", "evolution"
_TABLE = files("iswarm_mj.paper.report").joinpath("topics.csv").read_text(encoding="utf-8")
TOPICS = {row["topic"]: row for row in csv.DictReader(_TABLE.splitlines())}
"""Topics in their order: titles, and what the paper's text and captions say of its figures, which
are not at hand."""
SEARCHES = tuple(f"evolve-{method}" for method in METHODS)
OF_RUNS = "type*[0-9].png"
"""Drawings that the experiment on types leaves in its directory."""
_PARTS = {TRIALS: GRASP, **{experiment.table: name for name, experiment in EXPERIMENTS.items()}}
"""Parts by the names of their tables, but for searches, whose tables name their methods."""


class Result(NamedTuple):
    """A table of results."""

    name: str
    """Of the part of the results: an experiment, a search such as evolve-paper, or grasp."""
    path: Path
    rows: Rows
    settings: Mapping[str, Any]

    def draw(self, out: Path) -> None:
        """Draw its figures into a directory."""
        with as_named(self.path):
            if self.name == GRASP:
                # Its import compiles the plugin, which only trials need.
                from iswarm_mj.output.plot_trials import draw_figures

                draw_figures(self.rows, self.settings, out)
            elif self.name in SEARCHES:
                draw_fitness(self.rows, self.settings["config"]["arena"]["n_dust"], out / FIGURE)
            else:
                EXPERIMENTS[self.name].draw(self.rows, out)


class Topic(NamedTuple):
    """A part of the statements."""

    name: str
    title: str
    findings: Sequence[Finding]
    results: Sequence[Result]
    """Tables that the findings are based on; none if they were not made, or are not needed."""
    data: Any = None
    """What they are judged by: rows; of evolutions, samples by methods."""
    paper: str = ""
    """What the paper says of its figure; empty without one."""
    pictures: Sequence[Mapping[str, str]] = ()
    """Names and contents of drawings of the tables, on the page of a report."""


@contextmanager
def as_named(path: Path) -> Iterator[None]:
    """Raise a UserError where rows of a table are not what its name and settings say."""
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise UserError(
            f"{path} is damaged, or holds something else than its name says; make it again"
        ) from error


def collect(directories: Sequence[Path]) -> dict[str, Result]:
    """Read all tables below the directories, by the names of the parts.

    If there are several tables of a name, the one with the most rows is used; one made with --quick
    only if there is no other.

    Raises:
        UserError: a directory does not exist, or a table is damaged.
    """
    found: dict[str, Result] = {}
    for directory in directories:
        if not directory.is_dir():
            raise ConfigError("results", directory, "an existing directory with results")
        for path in files_in(directory, "**/*.parquet"):
            if path.name in (SEARCH, *_PARTS):
                rows, settings = read_table(path)
                with as_named(path):
                    name = _PARTS.get(path.name, f"evolve-{settings.get('method')}")
                if rows:
                    both = found.get(name), Result(name, path, rows, settings)
                    found[name] = max(
                        filter(None, both), key=lambda r: (not r.settings.get("quick"), len(r.rows))
                    )
    return {name: found[name] for name in (GRASP, *SEARCHES, *EXPERIMENTS) if name in found}


def files_in(directory: Path, pattern: str) -> Iterator[Path]:
    """Yield the files that match a pattern, sorted, without those reached by links that lead out of
    the directory."""
    inside = directory.resolve()
    for path in sorted(directory.glob(pattern)):
        if path.is_file() and path.resolve().is_relative_to(inside):
            yield path


def topics_of(results: Mapping[str, Result]) -> list[Topic]:
    """All topics with their findings.

    Raises:
        UserError: a table holds something else than its name says.
    """
    listed, others = [], [*bench_statements.STATEMENTS, *evolution_statements.STATEMENTS]
    for name, words in TOPICS.items():
        mine = [
            results[part]
            for part in (SEARCHES if name == EVOLUTION else (name,))
            if part in results
        ]
        with as_named(mine[0].path if mine else Path()):
            data: Any = mine[0].rows if mine else []
            if name == EVOLUTION:
                data = {
                    one.settings["method"]: evolutions(
                        one.rows, one.settings["config"]["arena"]["n_dust"]
                    )
                    for one in mine
                }
            judge = EXPERIMENTS[name].findings if name in EXPERIMENTS else None
            found = judge(data) if judge else findings_on(others, name, data or name == LAWS)
            listed.append(Topic(name, words["title"], found, mine, data, words["paper"]))
    return listed


def tally(findings: Sequence[Finding]) -> tuple[list[str], dict[str, list[int]]]:
    """The kinds that occur, and the number of statements of each by verdict."""
    counts = Counter((finding.verdict, finding.kind.split(",")[0]) for finding in findings)
    kinds = [kind for kind in KINDS if any(kind == other for _, other in counts)]
    verdicts = dict.fromkeys(finding.verdict for finding in findings)
    return kinds, {verdict: [counts[verdict, kind] for kind in kinds] for verdict in verdicts}


def report(directories: Sequence[Path], out: Path) -> list[Topic]:
    """Write a report of all results below the directories, at any depth, as one HTML page; print a
    summary."""
    check_name(out, ".html")
    results = collect(directories)
    make_output_directory(out.parent, given=out)
    sections = [_section(topic) for topic in topics_of(results)]
    kinds, counts = tally([finding for section in sections for finding in section.findings])
    page = Environment(
        loader=PackageLoader("iswarm_mj.paper.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    ).get_template("report.html")
    text = page.render(
        version=__version__,
        tally=counts,
        kinds={kind: KINDS[kind] for kind in kinds},
        sections=sections,
        results=results,
        again=join(["iswarm", "report", "--results", *map(str, directories), "--out", str(out)]),
    )
    with atomic_write(out) as part:
        part.write_text(text, encoding="utf-8")
    if not results:
        print(
            f"no results found in {', '.join(map(str, directories))}; the statements that are judged need none"
        )
    print(", ".join(f"{verdict or 'not judged'}: {sum(row)}" for verdict, row in counts.items()))
    print(f"report in {out}")
    return sections


def _section(topic: Topic) -> Topic:
    """A topic with the figures of its tables."""
    pictures: dict[str, Path] = {}
    with TemporaryDirectory() as directory:
        for result in topic.results:
            drawn = Path(directory, result.name)
            drawn.mkdir()
            result.draw(drawn)
            of_runs = files_in(result.path.parent, OF_RUNS) if topic.name == "types" else ()
            paths = (*sorted(drawn.glob("*.png")), *of_runs)
            pictures |= {f"{result.name}, {path.stem.replace('_', ' ')}": path for path in paths}
        if topic.name == EVOLUTION:
            draw_trade(topic.data.get("paper", ()), Path(directory, "trade"))
            if (trade := Path(directory, "trade.png")).is_file():
                pictures["Forgetting and scouts among the fittest"] = trade
        embedded = [
            {
                "name": name,
                "content": f"data:image/png;base64,{base64.b64encode(path.read_bytes()).decode()}",
            }
            for name, path in pictures.items()
        ]
    quick = ": the quick version, with few and short runs" * any(
        r.settings.get("quick") for r in topic.results
    )
    return topic._replace(title=topic.title + quick, pictures=embedded)
