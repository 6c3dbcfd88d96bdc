"""The common style of all figures: those of results are PNG and SVG, those of pages SVG.

Matplotlib is imported when a figure is drawn: it belongs to an extra, and modules that draw also
read tables, which needs no more than the core.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from iswarm_mj.output.palette import BLUE, DARK, ORANGE, SKY, YELLOW
from iswarm_mj.utils.files import atomic_write

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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
    import matplotlib

    with matplotlib.rc_context(STYLE):
        drawing, axes = blank(rows, columns, size)
        if caption:
            drawing.supxlabel(caption, x=0.01, ha="left", fontsize=7, color=DARK)
        yield axes
        for suffix, metadata in _METADATA.items():
            with atomic_write(path.with_name(path.name + suffix)) as part:
                drawing.savefig(part, format=suffix[1:], metadata=metadata)


class Theme(NamedTuple):
    """Colours of a figure on a light or on a dark page."""

    suffix: str
    """End of the file's name, before ".svg"."""
    ink: str
    """Colour of text and axes."""
    ours: str
    """Colour of what is simulated."""
    pale: str
    """Colour of bars and areas of what is simulated."""
    paper: str
    """Colour of the paper's values."""


LIGHT_PAGE = Theme("", "#222222", BLUE, "#a8c8e4", ORANGE)
DARK_PAGE = Theme("-dark", "#d5d8e0", SKY, "#2c5878", YELLOW)


def write_themed(path: Path, draw: Callable[[list[Axes], Theme], None], **layout: Any) -> None:
    """Draw a figure for light and for dark pages, as SVG files with a transparent ground.

    Letters are text, in the sans serif of the reader's browser.

    Args:
        path: path of the light figure, without suffix; that of the dark one ends with "-dark".
        draw: draws on the axes in the colours of a theme.
        layout: rows, columns and size, see `figure`.
    """
    import matplotlib

    for theme in (LIGHT_PAGE, DARK_PAGE):
        style = {
            **STYLE,
            "svg.fonttype": "none",
            "font.family": "sans-serif",
            "savefig.transparent": True,
            "axes.titlesize": 9,
        }
        inked = ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color")
        with matplotlib.rc_context({**style, **dict.fromkeys(inked, theme.ink)}):
            drawing, axes = blank(**layout)
            draw(axes, theme)
            with atomic_write(path.with_name(f"{path.name}{theme.suffix}.svg")) as part:
                drawing.savefig(part, format="svg", metadata=_METADATA[".svg"])


def blank(
    rows: int = 1, columns: int = 1, size: tuple[float, float] = (4.5, 3.2)
) -> tuple[Figure, list[Axes]]:
    """Return a figure and its empty axes, see `figure` for the arguments."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    width, height = size
    drawing = Figure(figsize=(width * columns, height * rows), layout="constrained")
    FigureCanvasAgg(drawing)
    return drawing, list(drawing.subplots(rows, columns, squeeze=False).flat)
