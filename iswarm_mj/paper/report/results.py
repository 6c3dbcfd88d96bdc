"""Tables of results below directories, and the topics of findings on them."""

import csv
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

from iswarm_mj.paper.analysis import bench_statements, evolution_statements
from iswarm_mj.paper.analysis.evolution import Evolutions, evolutions
from iswarm_mj.paper.analysis.findings import KINDS, Finding, findings_on
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.search.methods import METHODS
from iswarm_mj.search.plots import draw_fitness
from iswarm_mj.search.rows import Rows
from iswarm_mj.search.search import FIGURE
from iswarm_mj.search.search import TABLE as SEARCH
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.tables import read_table
from iswarm_mj.workflows.grasp import TABLE as TRIALS

LAWS = "laws"
"""Topic of the gripper's laws, which need no results."""
GRASP = "grasp"
"""Topic of the trials on the gripper's bench, and name of their results."""
EVOLUTION = "evolution"
"""Topic of all searches."""


def _read_topics() -> dict[str, dict[str, str]]:
    """Return title and text on the paper's figure of each topic, in their order."""
    table = files("iswarm_mj.paper.report").joinpath("topics.csv")
    rows = csv.DictReader(table.read_text(encoding="utf-8").splitlines())
    return {row["topic"]: row for row in rows}


TOPICS = _read_topics()
"""Topics in their order: titles, and what the paper's text and captions say of its figures, which
are not at hand."""
SEARCHES = tuple(f"evolve-{method}" for method in METHODS)
"""Names of the results of searches."""
_NAME_OF_TABLE = {
    TRIALS: GRASP,
    **{experiment.table: name for name, experiment in EXPERIMENTS.items()},
}
"""Names of results by the files of their tables; those of searches follow from their methods."""


class Result(NamedTuple):
    """A table of results."""

    name: str
    """Name: an experiment, a search such as evolve-paper, or grasp."""
    path: Path
    """Path of the table."""
    rows: Rows
    """Rows of the table."""
    settings: Mapping[str, Any]
    """Settings that the table contains."""

    @property
    def is_quick(self) -> bool:
        """It was made by the quick version of an experiment."""
        return bool(self.settings.get("quick"))

    def draw(self, out: Path) -> None:
        """Draw its figures into a directory."""
        with explaining_damage(self.path):
            if self.name == GRASP:
                # Its import compiles the plugin, which only trials need.
                from iswarm_mj.output.plot_trials import draw_figures

                draw_figures(self.rows, self.settings, out)
            elif self.name in SEARCHES:
                draw_fitness(self.rows, self.settings["config"]["arena"]["n_dust"], out / FIGURE)
            else:
                EXPERIMENTS[self.name].draw(self.rows, out)


class Topic(NamedTuple):
    """A topic: statements that belong together, with their findings."""

    name: str
    """Name, a key of TOPICS."""
    title: str
    """Title of its section."""
    findings: Sequence[Finding]
    """Findings on its statements."""
    results: Sequence[Result]
    """Tables that the findings are based on; none if they were not made, or are not needed."""
    data: Any = None
    """What the statements are judged by: rows; of evolutions, searches by methods."""
    paper: str = ""
    """What the paper says of its figure; empty without one."""
    pictures: Sequence[Mapping[str, str]] = ()
    """Names and contents of drawings of the tables, on the page of a report."""


@contextmanager
def explaining_damage(path: Path) -> Iterator[None]:
    """Raise a UserError where rows of a table are not what its name and settings say."""
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError) as error:
        raise UserError(
            f"{path} is damaged, or holds something else than its name says; make it again"
        ) from error


def collect_results(directories: Sequence[Path]) -> dict[str, Result]:
    """Read all tables below the directories, by their names.

    If there are several tables of a name, the one with the most rows is used; one made with --quick
    only if there is no other.

    Raises:
        UserError: a directory does not exist, or a table is damaged.
    """
    results: dict[str, Result] = {}
    for directory in directories:
        if not directory.is_dir():
            raise ConfigError("results", directory, "an existing directory with results")
        for result in _read_results(directory):
            rival = results.get(result.name)
            if rival is None or _rank(result) > _rank(rival):
                results[result.name] = result
    ordered_names = (GRASP, *SEARCHES, *EXPERIMENTS)
    return {name: results[name] for name in ordered_names if name in results}


def _read_results(directory: Path) -> Iterator[Result]:
    """Yield the tables below a directory that have rows."""
    for path in files_in(directory, "**/*.parquet"):
        if path.name != SEARCH and path.name not in _NAME_OF_TABLE:
            continue
        rows, settings = read_table(path)
        with explaining_damage(path):
            name = _NAME_OF_TABLE.get(path.name, f"evolve-{settings.get('method')}")
        if rows:
            yield Result(name, path, rows, settings)


def _rank(result: Result) -> tuple[bool, int]:
    """Return the rank of a table among those of its name."""
    return not result.is_quick, len(result.rows)


def files_in(directory: Path, pattern: str) -> Iterator[Path]:
    """Yield the files that match a pattern, sorted.

    Those reached by links that lead out of the directory are left out.
    """
    inside = directory.resolve()
    for path in sorted(directory.glob(pattern)):
        if path.is_file() and path.resolve().is_relative_to(inside):
            yield path


def topics_of(results: Mapping[str, Result]) -> list[Topic]:
    """Return all topics with their findings.

    Args:
        results: tables by their names.

    Raises:
        UserError: a table holds something else than its name says.
    """
    return [_topic(name, results) for name in TOPICS]


def _topic(name: str, results: Mapping[str, Result]) -> Topic:
    """Return a topic with its findings."""
    needed = SEARCHES if name == EVOLUTION else (name,)
    topic_results = [results[part] for part in needed if part in results]
    path = topic_results[0].path if topic_results else Path()
    with explaining_damage(path):
        data: Any
        if name == EVOLUTION:
            data = _searches_by_method(topic_results)
        else:
            data = topic_results[0].rows if topic_results else []
        findings = _findings_of_topic(name, data)

    words = TOPICS[name]
    return Topic(name, words["title"], findings, topic_results, data, words["paper"])


def _searches_by_method(results: Sequence[Result]) -> dict[str, Evolutions]:
    """Return the replicates of each search by its method."""
    return {
        result.settings["method"]: evolutions(
            result.rows, result.settings["config"]["arena"]["n_dust"]
        )
        for result in results
    }


def _findings_of_topic(name: str, data: Any) -> list[Finding]:
    """Return the findings on the statements of a topic, from what they are judged by."""
    if name in EXPERIMENTS:
        return EXPERIMENTS[name].findings(data)
    statements = [*bench_statements.STATEMENTS, *evolution_statements.STATEMENTS]

    # The laws are judged without results.
    return findings_on(statements, name, data or name == LAWS)


def count_verdicts(findings: Sequence[Finding]) -> tuple[list[str], dict[str, list[int]]]:
    """Return the kinds of statements that occur, and how many statements of each have a verdict.

    Returns:
        Kinds in the order of `KINDS`; and by verdict the numbers of statements, a number for each
        of these kinds.
    """
    count_by_verdict: dict[str, Counter[str]] = {}
    for finding in findings:
        # Without the role of the statement in the experiment `infer`, which follows a comma.
        kind = finding.kind.split(",")[0]
        count_by_verdict.setdefault(finding.verdict, Counter())[kind] += 1

    occurring: set[str] = set().union(*count_by_verdict.values())
    kinds = [kind for kind in KINDS if kind in occurring]
    numbers_by_verdict = {}
    for verdict, counts in count_by_verdict.items():
        numbers_by_verdict[verdict] = [counts[kind] for kind in kinds]
    return kinds, numbers_by_verdict
