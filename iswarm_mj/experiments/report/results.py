"""Tables of experiments, searches and trials below directories, what follows from them, and the topics of a report."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

from iswarm_mj.experiments.analysis import bench_statements, evolution_statements
from iswarm_mj.experiments.analysis.evolution import samples_of
from iswarm_mj.experiments.analysis.findings import KINDS, Finding, Rows
from iswarm_mj.experiments.report.command_lines import command_line
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.output.plot_trials import draw_figures
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.tables import read_table, write_csv
from iswarm_mj.workflows.grasp_table import TrialRow

SEARCH, TRIALS, FINDINGS = "evolution.parquet", "trials.parquet", "findings.csv"
METHODS = ("paper", "random", "cmaes")
"""Of searches, in the order in which they stand."""
LAWS, GRASP, EVOLUTION = "laws", "grasp", "evolution"
TITLES = {
    LAWS: "The gripper's theory (section 3.2.1)",
    GRASP: "Grasping and releasing (section 3.2.3, Figs. 6 to 11)",
    EVOLUTION: "Evolution (section 4.6.1, Fig. 14, Table 2)",
    "hop-count": "Hop counts (section 4.6.1, Fig. 15)",
    "types": "The two types (Table 2, Fig. 16)",
    "density": "The optimal density (section 4.6.2, Fig. 17)",
    "message-time": "Messages that take time (section 4.1, Fig. 15)",
    "sensitivity": "Beyond the paper: other choices and other noise",
    "robustness": "Beyond the paper: failed robots",
    "resolved-grasps": "Beyond the paper: grasps by trials on the bench",
    "time-step": "Beyond the paper: the physics time step",
    "infer": "Beyond the paper: which readings agree with it",
}
"""Topics in their order."""
_NAMES = {TRIALS, SEARCH, *(experiment.table for experiment in EXPERIMENTS.values())}


class Result(NamedTuple):
    """A table of results, which holds what its name and settings say."""

    name: str
    """Of the part of the results: an experiment, a search such as evolve-paper, or grasp."""
    path: Path
    rows: Rows
    settings: Mapping[str, Any]
    findings: Sequence[Finding]
    """Of a search, as if there were no other."""
    command: str
    """Line that makes it again."""


class Topic(NamedTuple):
    """A part of the statements."""

    name: str
    title: str
    findings: Sequence[Finding]
    results: Sequence[Result]
    """Tables that the findings are based on; none if they were not made, or are not needed."""


@dataclass
class Results:
    """The tables that a report is based on."""

    used: dict[str, Result] = field(default_factory=dict)
    """By their names; searches in the order of their methods."""
    left_out: list[Path] = field(default_factory=list)
    """Tables that are not used because another one of the same name has more runs."""
    unusable: list[Path] = field(default_factory=list)
    """Tables of the right names that are damaged, or hold something else."""


def collect(directories: Sequence[Path]) -> Results:
    """Read all tables below the directories.

    If there are several tables of a name, the one with the most rows is used; one made with --quick only if there is no
    other.

    Raises:
        UserError: a directory does not exist.
    """
    found: dict[str, list[tuple[Path, Rows, Mapping[str, Any]]]] = {}
    results = Results()
    for directory in directories:
        if not directory.is_dir():
            raise ConfigError("results", directory, "an existing directory with results")
        for path in files_in(directory, "**/*.parquet"):
            if path.name in _NAMES:
                try:
                    rows, settings = read_table(path)
                    name = _name(path, settings)
                except (UserError, AttributeError):  # settings may be anything
                    results.unusable.append(path)
                    continue
                if name and rows:
                    found.setdefault(name, []).append((path, rows, settings))
    for name in sorted(found, key=[GRASP, *(f"evolve-{m}" for m in METHODS), *EXPERIMENTS].index):
        best = max(found[name], key=lambda table: (not table[2].get("quick"), len(table[1])))
        results.left_out += [path for path, *_ in found[name] if path != best[0]]
        result = judged(name, *best)
        if result is None:
            results.unusable.append(best[0])
        else:
            results.used[name] = result
    return results


def judged(name: str, path: Path, rows: Rows, settings: Mapping[str, Any]) -> Result | None:
    """What follows from a table; None if it holds something else than its name and settings say."""
    try:
        if name == GRASP and not all(_is_trial(row) for row in rows):
            return None
        searches = {settings["method"]: (rows, settings)} if name not in (GRASP, *EXPERIMENTS) else {}
        findings = findings_on(EVOLUTION if searches else name, samples_of(searches) or rows)
        return Result(name, path, rows, settings, findings, command_line(name, settings))
    except Exception:  # columns may lack, or hold anything
        return None


def findings_on(topic: str, results: Any) -> Sequence[Finding]:
    """Findings on a topic from rows, of evolutions from samples; without results, that they were not made."""
    if topic in EXPERIMENTS:
        return EXPERIMENTS[topic].findings(results or [])
    statements = [*bench_statements.STATEMENTS, *evolution_statements.STATEMENTS]
    return [statement.finding(results or topic == LAWS) for statement in statements if statement.study == topic]


def _is_trial(row: Mapping[str, Any]) -> bool:
    """Whether columns that hold numbers do; figures group by them and draw them."""
    text = {name for name, kind in get_type_hints(TrialRow).items() if kind is str}
    return not any(isinstance(row[name], str | list) for name in TrialRow._fields if name not in text)


def draw_table(result: Result, out: Path) -> list[Path]:
    """Draw the figures of trials or of an experiment into a directory; return the paths of the PNG files."""
    if result.name == GRASP:
        return draw_figures(result.rows, result.settings, out)
    return EXPERIMENTS[result.name].draw(result.rows, out) if result.name in EXPERIMENTS else []


def files_in(directory: Path, pattern: str) -> Iterator[Path]:
    """Yield the files that match a pattern, sorted, without those reached by links that lead out of the directory."""
    inside = directory.resolve()
    for path in sorted(directory.glob(pattern)):
        if path.is_file() and path.resolve().is_relative_to(inside):
            yield path


def _name(path: Path, settings: Mapping[str, Any]) -> str | None:
    """Name of a table; None for one that a report does not use."""
    if path.name == TRIALS:
        return GRASP
    if path.name == SEARCH:
        return f"evolve-{settings['method']}" if settings.get("method") in METHODS else None
    name = str(settings.get("experiment"))
    return name if name in EXPERIMENTS and path.name == EXPERIMENTS[name].table else None


def searches_of(results: Sequence[Result]) -> dict[str, tuple[Rows, Mapping[str, Any]]]:
    """Rows and settings of searches by their methods."""
    return {result.settings["method"]: (result.rows, result.settings) for result in results}


def topics_of(results: Results) -> list[Topic]:
    """All topics with their findings."""
    listed = []
    for name, title in TITLES.items():
        mine = [r for r in results.used.values() if r.name == name or (name == EVOLUTION and "evolve-" in r.name)]
        made = samples_of(searches_of(mine)) if name == EVOLUTION else None
        findings = mine[0].findings if mine and not made else findings_on(name, made)
        listed.append(Topic(name, title, findings, mine))
    return listed


def tally(findings: Sequence[Finding]) -> tuple[list[str], dict[str, list[int]]]:
    """The kinds that occur, and the number of statements of each by verdict."""
    kinds = [kind for kind in KINDS if any(finding.kind == kind for finding in findings)]
    counts = Counter((finding.verdict, finding.kind) for finding in findings)
    verdicts = dict.fromkeys(finding.verdict for finding in findings)
    return kinds, {verdict: [counts[verdict, kind] for kind in kinds] for verdict in verdicts}


def findings_files(topics: Sequence[Topic]) -> dict[Path, Sequence[Finding]]:
    """Findings by the files beside the tables that they are based on, for the evolution beside its first table."""
    return {topic.results[0].path.with_name(FINDINGS): topic.findings for topic in topics if topic.results}


def write_findings(topics: Sequence[Topic]) -> None:
    """Write `findings_files`.

    Raises:
        UserError: one of them cannot be written.
    """
    for path, findings in findings_files(topics).items():
        write_csv(path, [finding._asdict() for finding in findings])
