"""Obstacles from a black-and-white picture."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from iswarm_mj.geometry.obstacles import Obstacle
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.files import check_file

MAX_BOXES = 1000
"""Maximum number of boxes of a picture."""
_DARK = 128
"""Brightness below which a pixel is dark, of 255."""


def boxes_of_picture(path: Path, width: float, height: float) -> tuple[Obstacle, ...]:
    """Return boxes that cover the dark pixels of a picture.

    The picture is stretched over a rectangle about the origin.

    Args:
        path: of the picture, in any format that Pillow reads; what is transparent is white.
        width: of the rectangle [rd].
        height: of the rectangle [rd].

    Raises:
        ConfigError: it is no picture, has no dark pixel, or needs too many boxes.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        check_file(path)
        with Image.open(path) as picture:
            colours = picture.convert("RGBA")
            white = Image.new("RGBA", colours.size, "white")
            pixels = np.asarray(Image.alpha_composite(white, colours).convert("L"))
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError, ValueError) as error:
        raise ConfigError("maze", str(path), f"a picture, as PNG ({error})") from None

    in_pixels = rectangles(pixels < _DARK)
    n_boxes = len(in_pixels)
    if not 0 < n_boxes <= MAX_BOXES:
        remedy = "draw walls in black"
        if n_boxes:
            remedy = "draw fewer and straighter walls with fewer pixels"
        allowed = f"a picture of 1 to {MAX_BOXES} boxes"
        raise ConfigError("maze", f"{n_boxes} boxes in {path}", allowed, remedy)

    # Columns run along x, rows against y.
    n_rows, n_columns = pixels.shape
    x = in_pixels[:, [0, 2]] * (width / n_columns) - width / 2
    y = height / 2 - in_pixels[:, [1, 3]] * (height / n_rows)
    half_x = np.diff(x)[:, 0] / 2
    half_y = -np.diff(y)[:, 0] / 2
    yaw = np.zeros(n_boxes)
    boxes = np.column_stack([x.mean(axis=1), y.mean(axis=1), half_x, half_y, yaw])
    return tuple(map(tuple, boxes.tolist()))


def rectangles(dark: Bool[np.ndarray, "H W"]) -> Int[np.ndarray, "K 4"]:
    """Return rectangles that cover what is dark: first column and row, and those after the last.

    A run of dark pixels of a row continues in the next row if it begins and ends at the same
    columns.
    """
    closed = []
    first_row_of: dict[tuple[int, int], int] = {}  # by the first column, and that after the last
    below = np.zeros_like(dark[:1])  # closes all
    for row, line in enumerate(np.vstack([dark, below])):
        edges = np.flatnonzero(np.diff(line, prepend=False, append=False)).reshape(-1, 2)
        runs = {(int(first), int(last)) for first, last in edges}
        for (first, last), first_row in first_row_of.items():
            if (first, last) not in runs:
                closed.append((first, first_row, last, row))
        first_row_of = {run: first_row_of.get(run, row) for run in sorted(runs)}
    return np.array(closed, int).reshape(-1, 4)
