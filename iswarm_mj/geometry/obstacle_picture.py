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
        path: file of the picture, in any format that Pillow reads; transparent pixels are white.
        width: width of the rectangle [rd].
        height: height of the rectangle [rd].

    Raises:
        ConfigError: the file holds no picture, or the picture has no dark pixel, or needs too many
            boxes.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        check_file(path)
        with Image.open(path) as picture:
            colours = picture.convert("RGBA")
            white = Image.new("RGBA", colours.size, "white")
            pixels = np.asarray(Image.alpha_composite(white, colours).convert("L"))
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        remedy = f"choose another ({reason})"
        raise ConfigError("maze", str(path), "a picture, as PNG", remedy) from None

    corners = rectangles(pixels < _DARK)
    n_boxes = len(corners)
    if not 0 < n_boxes <= MAX_BOXES:
        remedy = "draw walls in black"
        if n_boxes:
            remedy = "draw fewer and straighter walls with fewer pixels"
        allowed = f"a picture of 1 to {MAX_BOXES} boxes"
        raise ConfigError("maze", f"{n_boxes} boxes in {path}", allowed, remedy)

    # Columns run along x, rows against y.
    n_rows, n_columns = pixels.shape
    x = corners[:, [0, 2]] * (width / n_columns) - width / 2
    y = height / 2 - corners[:, [1, 3]] * (height / n_rows)
    half_x = np.diff(x)[:, 0] / 2
    half_y = -np.diff(y)[:, 0] / 2
    yaw = np.zeros(n_boxes)
    boxes = np.column_stack([x.mean(axis=1), y.mean(axis=1), half_x, half_y, yaw])
    return tuple(map(tuple, boxes.tolist()))


def rectangles(dark: Bool[np.ndarray, "H W"]) -> Int[np.ndarray, "K 4"]:
    """Return rectangles that cover the dark pixels.

    A run of dark pixels in a row belongs to the rectangle above it if both begin and end at the
    same columns.

    Returns:
        Left column, top row, and the column and the row after the last ones of each rectangle.
    """
    closed = []
    top_of_run: dict[tuple[int, int], int] = {}  # top row of each open rectangle, by its run
    blank_row = np.zeros_like(dark[:1])  # closes all rectangles
    for row, pixels in enumerate(np.vstack([dark, blank_row])):
        previous_runs = top_of_run
        top_of_run = {run: previous_runs.get(run, row) for run in _runs(pixels)}

        # Close the rectangles that do not continue.
        for run, top in previous_runs.items():
            if run not in top_of_run:
                left, right = run
                closed.append((left, top, right, row))
    return np.array(closed, int).reshape(-1, 4)


def _runs(pixels: Bool[np.ndarray, "W"]) -> list[tuple[int, int]]:
    """Return the runs of dark pixels of a row: the first column, and that after the last."""
    edges = np.flatnonzero(np.diff(pixels, prepend=False, append=False)).tolist()
    return list(zip(edges[::2], edges[1::2], strict=True))
