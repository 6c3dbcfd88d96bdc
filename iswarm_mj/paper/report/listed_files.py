"""Files in a directory of results: what they are and how to open them."""

import re
from collections.abc import Iterator, Mapping
from fnmatch import fnmatch
from pathlib import Path
from typing import Any
from zipfile import is_zipfile

from tqdm import tqdm

from iswarm_mj.output.loading import read_result
from iswarm_mj.output.trajectory import RESULT, TRAJECTORY
from iswarm_mj.strategy.library import STRATEGIES, TASKS, PluginKind, naming, offered
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.operating_system import shell_line
from iswarm_mj.workflows import grasp
from iswarm_mj.workflows.fit import SETTINGS_FILE
from iswarm_mj.workflows.tip import STL

_MAX_FILES = 20
"""Maximum number of files that are listed."""
_CLEANING_CLASS = type(CLEANING).__name__
"""Class of the paper's task, to which strategies and tasks without a class belong."""
FILES = {
    "result.json": "measures and settings: iswarm_mj.load({parent!r}).result; "
    "iswarm clean --config {path} repeats it",
    "fit.toml": "settings: iswarm grasp --config {path}, or iswarm clean --config {path}",
    "tip.json": "forces of the tip: iswarm grasp --tip {path}",
    "tip.stl": "solid of the tip, in um",
    "profile.csv": "points of the tip: iswarm tip --profile {path}",
    "trajectory.npz": "what was recorded: iswarm_mj.load({parent!r}).robots, .balls, .links, "
    ".steps",
    "*.rrd": "recording: rerun {path}",
    "compare.json": "result of a comparison: effects with intervals, and what differs",
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
    "*.gif": "video",
    "*.webp": "video, or a picture",
}
"""What a file is and how to open it, by the pattern of its name."""


def how_to_open(path: Path) -> str:
    """Return what a file is, and how to open it; nothing for a file that no command writes."""
    for pattern, text in FILES.items():
        if fnmatch(path.name, pattern):
            # Python takes the path as it is; a shell needs quotes.
            is_python = "!r" in text and "--config" not in text
            name = str(path) if is_python else shell_line([str(path)])
            return text.format(path=name, parent=str(path.parent))
    return ""


def file_lines(directory: Path) -> Iterator[str]:
    """Yield the name and size of each file in a directory, and how to open it."""
    files = [
        path
        for path in sorted(directory.rglob("*"))
        if path.is_file() and not path.name.startswith(".")
    ]
    listed = {str(path.relative_to(directory)): path for path in files[:_MAX_FILES]}
    width = max(map(len, listed), default=0)
    for name, path in listed.items():
        size = tqdm.format_sizeof(path.stat().st_size, "B")
        yield f"{name:<{width}}  {size:>8}  {_opening_text(path)}"
    if len(files) > _MAX_FILES:
        yield f"{len(files) - _MAX_FILES} more files"


def _opening_text(path: Path) -> str:
    """Return how to open a file, by its content where the name does not tell."""
    if path.name == RESULT and is_of_bench(path):
        command = f"iswarm grasp --config {shell_line([str(path)])}"
        return f"measures and settings: {command} repeats it"
    if path.name == RESULT and is_of_fit(path):
        return "estimates, predictions, residuals and the next measurement, in SI"
    if path.name == RESULT and is_of_tip(path):
        command = f"iswarm tip --config {shell_line([str(path)])}"
        return f"voltages, tolerances and settings: {command} repeats it"
    if path.name == RESULT:
        return how_to_open(path).replace("iswarm clean", _repeating_command(read_result(path)))
    if path.name == TRAJECTORY and not is_zipfile(path):
        return "cut off; the same command records it again"
    return how_to_open(path)


def is_of_bench(result: Path) -> bool:
    """Return whether a result.json is of `iswarm grasp`, whose tables say more."""
    return any((result.parent / name).is_file() for name in (grasp.TABLE, grasp.CURVES))


def is_of_fit(result: Path) -> bool:
    """Return whether a result.json is of `iswarm fit`."""
    return (result.parent / SETTINGS_FILE).is_file()


def is_of_tip(result: Path) -> bool:
    """Return whether a result.json is of `iswarm tip`."""
    return (result.parent / STL).is_file()


def _repeating_command(content: Mapping[str, Any]) -> str:
    """Return the command that repeats a run, with flags for classes that no package offers.

    Args:
        content: content of result.json.
    """
    task = content.get("task")
    is_cleaning = (
        not isinstance(task, Mapping) or task.get("class", _CLEANING_CLASS) == _CLEANING_CLASS
    )
    words = ["iswarm clean" if is_cleaning else "iswarm run"]
    for kind in (STRATEGIES, TASKS):
        words += _flags_of_class(kind, content.get(kind.word))
    return " ".join(words)


def _flags_of_class(kind: PluginKind, settings: Any) -> list[str]:
    """Return the flag that names the class of a strategy or a task, if it is needed.

    Args:
        kind: strategies or tasks.
        settings: class and fields of the strategy or the task, from result.json.
    """
    if not isinstance(settings, Mapping):
        return []
    class_name = str(settings.get("class", _CLEANING_CLASS))
    if class_name == _CLEANING_CLASS:
        return []
    field_names = {*settings} - {"class"}
    if offered(kind, class_name, field_names) is not None:
        return []
    return [naming(kind, class_name)]


def recording_lines(directory: Path, at_least: int = 2) -> Iterator[str]:
    """Yield how to open all recordings of a directory at once, if there are enough.

    Args:
        directory: where the recordings are, at any depth.
        at_least: number of recordings from which on there is a line.
    """
    recordings = [path for path in sorted(directory.rglob("*.rrd")) if path.is_file()]
    if len(recordings) < at_least:
        return

    # The shell finds the numbers of worlds and trials, but in no name that it has to quote.
    patterns = {}
    for path in recordings:
        name = str(path.relative_to(directory))
        quoted = shell_line([name])
        pattern = re.sub(r"\d+", "*", name) if quoted == name else quoted
        patterns[f"{shell_line([str(directory)])}/{pattern}"] = None

    if len(recordings) == 1:
        subject = "recording"
    else:
        subject = f"all {len(recordings)} recordings as one dataset"
    yield f"{subject}: rerun {' '.join(patterns)}"
