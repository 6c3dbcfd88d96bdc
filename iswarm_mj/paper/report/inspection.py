"""What a directory of results holds, in words: of runs, experiments, searches and trials,
interrupted ones included."""

import re
import shlex
from collections.abc import Iterator, Mapping
from fnmatch import fnmatch
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

from tqdm import tqdm

from iswarm_mj.output.loading import read_result
from iswarm_mj.output.trajectory import RESULT, TRAJECTORY
from iswarm_mj.paper.report import results
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.search import sweep
from iswarm_mj.search.best import best_of
from iswarm_mj.search.journal import RUNS, count
from iswarm_mj.search.search import BEST, CHECKPOINT
from iswarm_mj.strategy.library import STRATEGIES, TASKS, naming, offered
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.tables import aligned, read_table
from iswarm_mj.workflows import grasp
from iswarm_mj.workflows.clean import strategy_of, summary

_JOURNALS = {RUNS: "an experiment or a sweep", CHECKPOINT: "a search"}
_TABLES = (
    results.SEARCH,
    results.TRIALS,
    grasp.CURVES,
    sweep.SWEEP,
    *(experiment.table for experiment in EXPERIMENTS.values()),
)
_KNOWN = (RESULT, *_TABLES, *_JOURNALS)
_USUAL = type(CLEANING).__name__
_MAX_LISTED = 20
FILES = {
    "result.json": "measures and settings: iswarm_mj.load({parent!r}).result; iswarm clean --config {path} repeats it",
    "trajectory.npz": "what was recorded: iswarm_mj.load({parent!r}).robots, .balls, .links, .steps",
    "*.rrd": "recording: rerun {path}",
    "best*.json": "best genome: iswarm clean --genome {path}",
    "runs.sqlite": "finished runs, which are not repeated",
    "checkpoint.sqlite": "finished runs, with which the same command goes on",
    "findings.csv": "statements and verdicts, a row each",
    "*.parquet": "table: pyarrow.parquet.read_table({path!r})",
    "*.csv": "the same table for spreadsheets",
    "*.html": "page for a browser",
    "*.png": "figure or picture",
    "*.svg": "the same figure, for print",
    "*.mp4": "video",
}
"""By the pattern of its name: what it is and how to open it."""


def inspection(directory: Path) -> str:
    """Return what a directory holds; of one that only holds others, a paragraph for each of these.

    Raises:
        UserError: it does not exist, or there are no results in it or below.
    """
    if not directory.is_dir():
        raise UserError(f"{directory} is no directory; give the --out of a command.")
    found = sorted(
        {path.parent for name in _KNOWN for path in directory.glob(f"**/{name}") if path.is_file()}
    )
    if not found:
        raise UserError(
            f"{directory} holds no results; give the --out of a command, or a directory of such."
        )
    if directory in found:
        return "\n".join([*_about(directory), "", *_files(directory), *_recordings(directory)])
    if len(found) > 1 and all(
        (place / RESULT).is_file() and not _is_of_bench(place / RESULT) for place in found
    ):
        return "\n".join(_of_many({place: read_result(place / RESULT) for place in found}))
    paragraphs = (
        [str(place), *(f"  {line}" for line in (*_about(place), *_recordings(place, 1)))]
        for place in found
    )
    return "\n\n".join(map("\n".join, paragraphs))


def _of_many(runs: Mapping[Path, Mapping[str, Any]]) -> list[str]:
    """A line for each run, with means over its worlds."""

    def mean(value: Any) -> str:
        known = [
            v for v in (value if isinstance(value, list) else [value]) if isinstance(v, int | float)
        ]
        return f"{sum(known) / len(known):.5g}" if known else "-"

    facts, measures = (
        ("engine", "n_robots", "n_worlds", "steps"),
        ("delivered", "finished_at", "collisions"),
    )
    lines = [
        ["directory", "rules", "engine", "robots", "worlds", "steps"]
        + [name.replace("_", " ") for name in measures]
    ]
    for place, content in runs.items():
        about = map(str, (place, strategy_of(content), *map(content.get, facts)))
        lines.append([*about, *(mean(content.get(name)) for name in measures)])
    return aligned(lines)


def _is_of_bench(result: Path) -> bool:
    """Whether a result.json is of `iswarm grasp`, whose tables say more."""
    return any((result.parent / name).is_file() for name in (results.TRIALS, grasp.CURVES))


def _about(directory: Path) -> Iterator[str]:
    """Say what ran, and its outcome."""
    there = [directory / name for name in (RESULT, *_TABLES) if (directory / name).is_file()]
    there = [path for path in there if not (path.name == RESULT and _is_of_bench(path))]
    for path in there:
        try:
            with results.as_named(path):
                yield from (
                    _run(read_result(path), directory) if path.name == RESULT else _table(path)
                )
        except UserError as error:
            yield str(error)
    for name, kind in _JOURNALS.items():
        if (directory / name).is_file():
            kept = f"{count(directory / name)} finished runs of {kind} are kept in {name}"
            # A search writes its table as it goes on, and its best genome at the end; a training
            # its figure.
            last = (BEST, "learning.png")
            ended = (
                any((directory / one).is_file() for one in last)
                if name == CHECKPOINT
                else bool(there)
            )
            yield kept if ended else f"interrupted: {kept}; the same command goes on"


def _run(content: Mapping[str, Any], directory: Path) -> Iterator[str]:
    """Of `iswarm clean` and `iswarm run`."""
    engine = " ".join(str(content[name]) for name in ("engine", "impl") if name in content)
    kind = "cleaning run" if "delivered" in content else "run of a task"
    yield f"{kind} on {engine or 'mujoco'}, version {content.get('version', 'unknown')}"
    if content.get("interrupted"):
        yield f"interrupted after {content.get('steps')} of {content.get('max_steps')} control steps"
    yield summary(content, directory)
    faults = list(content["faults"])
    yield from (f"fault: {fault}" for fault in faults[:_MAX_LISTED])
    if len(faults) > _MAX_LISTED:
        yield f"{len(faults) - _MAX_LISTED} more faults are in {RESULT}"


def _table(path: Path) -> list[str]:
    """Of an experiment, a sweep, a search, trials or curves."""
    rows, settings = read_table(path)
    about = f"version {settings.get('version')}, seed {settings.get('seed')}"
    match path.name:
        case sweep.SWEEP:
            arguments = shlex.join([settings["command"], *settings["arguments"]])
            title = f"sweep of {arguments}, {len(rows)} worlds, version {settings['version']}"
            return [title, *sweep.summary(rows, settings["over"])]
        case results.SEARCH:
            best, made = best_of(rows), len({row["generation"] for row in rows})
            done = f"{made} of {settings['generations']} generations, {len(rows)} runs, {about}"
            last = f"best {best.fitness:z.0f} on average over its {best.n_runs} run(s), in {BEST}"
            return [f"search by {settings['method']}: {done}", last]
        case results.TRIALS:
            trials = [grasp.TrialRow(*map(row.__getitem__, grasp.TrialRow._fields)) for row in rows]
            n_trials = len({(row.radius, row.relative_humidity, row.repeat) for row in trials})
            lines = (f"{name:>12}  {text}" for name, text in grasp.outcome_lines(trials))
            return [f"{path.stem}: {n_trials} trials in {len(rows)} rows, {about}", *lines]
        case grasp.CURVES:
            return [f"{path.stem}: {len(rows)} rows, {about}"]
    name, quick = str(settings.get("experiment")), " --quick" * bool(settings["quick"])
    title = f"experiment {name}{quick} on {settings['engine']}: {len(rows)} runs, {about}"
    findings = EXPERIMENTS[name].findings(rows)
    return [title, *(f"  {each.verdict or '-'}: {each.claim}: {each.ours}" for each in findings)]


def _files(directory: Path) -> Iterator[str]:
    """Name the files, and say how to open each."""
    files = [
        path
        for path in sorted(directory.rglob("*"))
        if path.is_file() and not path.name.startswith(".")
    ]
    names = [str(path.relative_to(directory)) for path in files[:_MAX_LISTED]]
    width = max(map(len, names), default=0)
    for name, path in zip(names, files, strict=False):
        text = opening(path)
        if path.name == RESULT and _is_of_bench(path):
            text = (
                f"measures and settings: iswarm grasp --config {shlex.quote(str(path))} repeats it"
            )
        elif path.name == RESULT:
            text = text.replace("iswarm clean", _repeating(read_result(path)))
        elif path.name == TRAJECTORY and not is_zipfile(path):
            text = "cut off; the same command records it again"
        yield f"{name:<{width}}  {tqdm.format_sizeof(path.stat().st_size, 'B'):>8}  {text}"
    if len(files) > _MAX_LISTED:
        yield f"{len(files) - _MAX_LISTED} more files"


def _repeating(content: Mapping[str, Any]) -> str:
    """The command that repeats a run, with flags for classes that no package offers."""
    task = content.get("task")
    is_cleaning = not isinstance(task, Mapping) or task.get("class", _USUAL) == _USUAL
    words = ["iswarm clean" if is_cleaning else "iswarm run"]
    for offer in (STRATEGIES, TASKS):
        own = content.get(offer.word)
        cls = str(own.get("class", _USUAL)) if isinstance(own, Mapping) else _USUAL
        if cls != _USUAL and offered(offer, cls, {*(own or {})} - {"class"}) is None:
            words.append(naming(offer, cls))
    return " ".join(words)


def _recordings(directory: Path, at_least: int = 2) -> Iterator[str]:
    """Say how to open all recordings at once, with the numbers of worlds and trials left to the
    shell."""
    found = [path for path in sorted(directory.rglob("*.rrd")) if path.is_file()]
    if len(found) >= at_least:
        names = [shlex.quote(str(path.relative_to(directory))) for path in found]
        names = dict.fromkeys(name if "'" in name else re.sub(r"\d+", "*", name) for name in names)
        opened = " ".join(f"{shlex.quote(str(directory))}/{name}" for name in names)
        yield f"{'recording' if len(found) == 1 else f'all {len(found)} recordings as one dataset'}: rerun {opened}"


def opening(path: Path) -> str:
    """Return what a file is, and how to open it; nothing for a file that no command writes."""
    text = next((text for pattern, text in FILES.items() if fnmatch(path.name, pattern)), "")
    is_python = "!r" in text
    name = str(path) if is_python and "--config" not in text else shlex.quote(str(path))
    return text.format(path=name, parent=str(path.parent))
