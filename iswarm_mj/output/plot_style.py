"""The common style of all figures, which are written as PNG and SVG."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from iswarm_mj.output.palette import DARK
from iswarm_mj.utils.files import atomic_write

STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "legend.frameon": False,
    "figure.dpi": 100,
    "savefig.dpi": 200,
    "svg.hashsalt": "iswarm_mj",
    "text.parse_math": False,
}
_METADATA: dict[str, Any] = {".png": {"Software": None}, ".svg": {"Date": None}}
"""Metadata of files by their suffixes, without what would differ between two runs."""


@contextmanager
def figure(
    path: Path,
    rows: int = 1,
    columns: int = 1,
    size: tuple[float, float] = (4.5, 3.2),
    caption: str = "",
) -> Iterator[list[Axes]]:
    """Yield axes to draw on, row by row, and write the figure on exit.

    It is written as PNG and as SVG, each completely or not at all.

    Args:
        path: path of the files, without suffix.
        rows: number of rows of axes.
        columns: number of columns of axes.
        size: width and height of one of the axes [inch].
        caption: text below the axes: what is drawn, of how many runs, and by which test.
    """
    with matplotlib.rc_context(STYLE):
        drawing, axes = blank(rows, columns, size)
        if caption:
            drawing.supxlabel(caption, x=0.01, ha="left", fontsize=7, color=DARK)
        yield axes
        for suffix, metadata in _METADATA.items():
            with atomic_write(path.with_name(path.name + suffix)) as part:
                drawing.savefig(part, format=suffix[1:], metadata=metadata)


def blank(
    rows: int = 1, columns: int = 1, size: tuple[float, float] = (4.5, 3.2)
) -> tuple[Figure, list[Axes]]:
    """Return a figure and its empty axes, see `figure` for the arguments."""
    width, height = size
    drawing = Figure(figsize=(width * columns, height * rows), layout="constrained")
    FigureCanvasAgg(drawing)
    return drawing, list(drawing.subplots(rows, columns, squeeze=False).flat)
