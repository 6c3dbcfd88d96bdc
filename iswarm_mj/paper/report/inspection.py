"""Descriptions of directories of results: of runs, experiments, searches and trials.

Interrupted ones are described as far as they came.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from iswarm_mj.output.loading import REMEDY, read_result
from iswarm_mj.output.trajectory import RESULT
from iswarm_mj.paper.report.listed_files import (
    file_lines,
    is_of_bench,
    is_of_fit,
    is_of_tip,
    recording_lines,
)
from iswarm_mj.paper.report.results import SEARCH, TRIALS, explaining_damage
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.search import comparison, grasp_sweep, sweep
from iswarm_mj.search.best import best_of
from iswarm_mj.search.journal import RUNS, count
from iswarm_mj.search.rows import Row, Rows
from iswarm_mj.search.search import BEST, CHECKPOINT
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import read_json
from iswarm_mj.utils.operating_system import shell_line
from iswarm_mj.utils.tables import aligned, read_table
from iswarm_mj.workflows import grasp
from iswarm_mj.workflows.clean import strategy_of, summary
from iswarm_mj.workflows.grasp_summary import (
    no_contact_lines,
    pull_off_lines,
    pull_offs,
    table_lines,
)

_JOURNALS = {RUNS: "an experiment, a sweep or a comparison", CHECKPOINT: "a search"}
"""Names of journals, and what their runs are of."""
_TABLES = (
    SEARCH,
    TRIALS,
    grasp.CURVES,
    sweep.SWEEP,
    comparison.TABLE,
    *(experiment.table for experiment in EXPERIMENTS.values()),
)
"""Names of tables that are described."""
_DESCRIBED = (RESULT, *_TABLES, *_JOURNALS)
"""Names of all files that are described."""
_ENDS_OF_SEARCH = (BEST, "learning.png")
"""Files of which a search writes one at its end: its best genome, or the figure of a training."""
_RUN_FACTS = ("engine", "n_robots", "n_worlds", "steps")
_RUN_MEASURES = ("delivered", "finished_at", "collisions")
_MAX_FAULTS = 20
"""Maximum number of faults that are listed."""


def describe_directory(directory: Path) -> str:
    """Return what a directory holds.

    If it only holds other directories with results, there is a paragraph for each, or one table if
    all of them are single runs.

    Raises:
        UserError: it does not exist, or there are no results in it or below.
    """
    if not directory.is_dir():
        raise UserError(f"{directory} is no directory; give the --out of a command.")
    places = _directories_with_results(directory)
    if not places:
        raise UserError(
            f"{directory} holds no results; give the --out of a command, or a directory of such."
        )

    if directory in places:
        lines = [*_describe(directory), "", *file_lines(directory), *recording_lines(directory)]
        return "\n".join(lines)
    if len(places) > 1 and all(_holds_a_run(place) for place in places):
        return "\n".join(_table_of_runs({place: read_result(place / RESULT) for place in places}))
    return "\n\n".join(_paragraph(place) for place in places)


def _directories_with_results(directory: Path) -> list[Path]:
    """Return the directories with results at any depth, itself included."""
    files = (path for name in _DESCRIBED for path in directory.glob(f"**/{name}"))
    return sorted({path.parent for path in files if path.is_file()})


def _holds_a_run(directory: Path) -> bool:
    """Return whether a directory holds a run of a task."""
    result = directory / RESULT
    return result.is_file() and not any(
        is_of(result) for is_of in (is_of_bench, is_of_fit, is_of_tip)
    )


def _paragraph(directory: Path) -> str:
    """Return the name of a directory and, indented, what it holds."""
    lines = [*_describe(directory), *recording_lines(directory, at_least=1)]
    return "\n".join([str(directory), *(f"  {line}" for line in lines)])


# --- Several runs ---


def _table_of_runs(results: Mapping[Path, Mapping[str, Any]]) -> list[str]:
    """Return a line for each run, with means over its worlds.

    Args:
        results: contents of result.json by their directories.
    """
    headings = [name.replace("_", " ") for name in _RUN_MEASURES]
    lines = [["directory", "rules", "engine", "robots", "worlds", "steps", *headings]]
    for place, content in results.items():
        facts = [str(content.get(name)) for name in _RUN_FACTS]
        means = [_mean_text(content.get(name)) for name in _RUN_MEASURES]
        lines.append([str(place), str(strategy_of(content)), *facts, *means])
    return aligned(lines)


def _mean_text(value: Any) -> str:
    """Return the mean of a number, or of a list of them, over those that are known."""
    values = value if isinstance(value, list) else [value]
    numbers = [number for number in values if isinstance(number, int | float)]
    return f"{sum(numbers) / len(numbers):.5g}" if numbers else "-"


# --- One directory ---


def _describe(directory: Path) -> Iterator[str]:
    """Yield lines on what ran in a directory, and on its outcome."""
    files = [directory / name for name in (RESULT, *_TABLES) if (directory / name).is_file()]
    described = [path for path in files if path.name != RESULT or not is_of_bench(path)]
    for path in described:
        yield from _describe_file(path)

    for name, kind in _JOURNALS.items():
        journal = directory / name
        if journal.is_file():
            # A search writes its table as it goes on.
            if name == CHECKPOINT:
                has_ended = any((directory / end).is_file() for end in _ENDS_OF_SEARCH)
            else:
                has_ended = bool(described)
            kept = f"{count(journal)} finished runs of {kind} are kept in {name}"
            yield kept if has_ended else f"interrupted: {kept}; the same command goes on"


def _describe_file(path: Path) -> Iterator[str]:
    """Yield lines on a result or a table; the error if it is damaged."""
    try:
        with explaining_damage(path):
            if path.name == RESULT and is_of_fit(path):
                fitted = read_json(path, REMEDY)["fit"]
                yield f"fit of {fitted['rows']} rows of {fitted['source']}"
                yield from fitted["statements"]
            elif path.name == RESULT and is_of_tip(path):
                yield from read_json(path, REMEDY)["summary"]
            elif path.name == RESULT:
                yield from _describe_run(read_result(path), path.parent)
            else:
                yield from _describe_table(path)
    except UserError as error:
        yield str(error)


def _describe_run(content: Mapping[str, Any], directory: Path) -> Iterator[str]:
    """Yield lines on a run of `iswarm clean` or `iswarm run`.

    Args:
        content: content of result.json.
        directory: directory of the run.
    """
    # Other tasks may count deliveries, too, as those do that derive from Cleaning.
    task = content["task"].get("class", "Cleaning")
    kind = "cleaning run" if task == "Cleaning" else f"run of the task {task}"
    engine = " ".join(str(content[name]) for name in ("engine", "impl") if name in content)
    yield f"{kind} on {engine or 'mujoco'}, version {content.get('version', 'unknown')}"
    if content.get("interrupted"):
        steps = f"{content.get('steps')} of {content.get('max_steps')}"
        yield f"interrupted after {steps} control steps"
    yield summary(content, directory)

    faults = list(content["faults"])
    for fault in faults[:_MAX_FAULTS]:
        yield f"fault: {fault}"
    if len(faults) > _MAX_FAULTS:
        yield f"{len(faults) - _MAX_FAULTS} more faults are in {RESULT}"


def _describe_table(path: Path) -> Sequence[str]:
    """Return lines on the table of an experiment, a sweep, a search, trials or curves."""
    rows, settings = read_table(path)
    if path.name == sweep.SWEEP:
        return _describe_sweep(rows, settings)
    if path.name == comparison.TABLE:
        title = f"comparison of {', '.join(settings['candidates'])}, version {settings['version']}"
        return [title, *settings["result"]]
    if path.name == SEARCH:
        return _describe_search(rows, settings)
    if path.name == TRIALS:
        return _describe_trials(path.stem, rows, settings)
    if path.name == grasp.CURVES:
        title = f"{path.stem}: {len(rows)} rows, {_version_and_seed(settings)}"
        return [title, *pull_off_lines(pull_offs(rows))]
    return _describe_experiment(rows, settings)


def _version_and_seed(settings: Mapping[str, Any]) -> str:
    """Return version and seed of a table."""
    return f"version {settings.get('version')}, seed {settings.get('seed')}"


def _describe_sweep(rows: Rows, settings: Mapping[str, Any]) -> list[str]:
    """Return lines on the table of a sweep."""
    command = shell_line([settings["command"], *settings["arguments"]])
    if settings["command"] == "grasp":
        title = f"sweep of {command}, version {settings['version']}"
        return [title, *grasp_sweep.summary(rows, settings["over"])]
    title = f"sweep of {command}, {len(rows)} worlds, version {settings['version']}"
    return [title, *sweep.summary(rows, settings["over"])]


def _describe_search(rows: Rows, settings: Mapping[str, Any]) -> list[str]:
    """Return lines on the table of a search."""
    n_generations = len({row["generation"] for row in rows})
    progress = f"{n_generations} of {settings['generations']} generations, {len(rows)} runs"
    best = best_of(rows)
    return [
        f"search by {settings['method']}: {progress}, {_version_and_seed(settings)}",
        f"best {best.fitness:z.0f} on average over its {best.n_runs} run(s), in {BEST}",
    ]


def _describe_trials(name: str, rows: Rows, settings: Mapping[str, Any]) -> list[str]:
    """Return lines on the table of trials with this name."""
    trial_rows = [_trial_row(row) for row in rows]
    n_trials = len({(row.radius, row.relative_humidity, row.repeat) for row in trial_rows})
    counts = f"{n_trials} trials in {len(rows)} rows"
    without_contact = [f"{name:>12}  {text}" for name, text in no_contact_lines(trial_rows)]
    title = f"{name}: {counts}, {_version_and_seed(settings)}"
    return [title, *table_lines(trial_rows), *without_contact]


def _trial_row(row: Row) -> grasp.TrialRow:
    """Return a row of the table of trials with named fields; others are left out."""
    return grasp.TrialRow(**{name: row[name] for name in grasp.TrialRow._fields})


def _describe_experiment(rows: Rows, settings: Mapping[str, Any]) -> list[str]:
    """Return lines on the table of an experiment: what ran, and a line for each finding."""
    name = str(settings.get("experiment"))
    quick = " --quick" if settings["quick"] else ""
    title = f"experiment {name}{quick} on {settings['engine']}: {len(rows)} runs"
    findings = [
        f"  {finding.verdict or '-'}: {finding.claim}: {finding.ours}"
        for finding in EXPERIMENTS[name].findings(rows)
    ]
    return [f"{title}, {_version_and_seed(settings)}", *findings]
