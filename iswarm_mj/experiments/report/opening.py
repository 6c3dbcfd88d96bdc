"""How to open each file that the commands write."""

import shlex
from fnmatch import fnmatch
from pathlib import Path

FILES = {
    "result.json": "measures and settings: iswarm_mj.load({parent!r}).result; iswarm clean --config {path} repeats it",
    "trajectory.npz": "what was recorded: iswarm_mj.load({parent!r}).robots, .balls, .links, .steps",
    "*.rrd": "recording: rerun {path}",
    "best*.json": "best genome: iswarm clean --genome {path}",
    "runs.sqlite": "finished runs, which are not repeated",
    "checkpoint.sqlite": "finished runs, with which --resume goes on",
    "findings.*": "statements and verdicts, a row each",
    "*.parquet": "table: pyarrow.parquet.read_table({path!r})",
    "*.csv": "the same table for spreadsheets",
    "*.html": "page for a browser",
    "*.png": "figure or picture",
    "*.svg": "the same figure, for print",
    "*.mp4": "video",
    "*.md": "text",
}
"""By the pattern of its name: what it is and how to open it."""


def opening(path: Path) -> str:
    """Return what a file is, and how to open it; nothing for a file that no command writes."""
    text = next((text for pattern, text in FILES.items() if fnmatch(path.name, pattern)), "")
    is_python = "!r" in text
    name = str(path) if is_python and "--config" not in text else shlex.quote(str(path))
    return text.format(path=name, parent=str(path.parent))
