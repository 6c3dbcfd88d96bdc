"""Obstacles from a black-and-white picture."""

from pathlib import Path

import numpy as np
from jaxtyping import Bool, Int

from iswarm_mj.geometry.obstacles import Obstacle
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.files import check_file

MOST = 1000
"""Boxes of a picture at most."""


def boxes_of_picture(path: Path, width: float, height: float) -> tuple[Obstacle, ...]:
    """Return boxes that cover the dark pixels of a picture, which is stretched over a rectangle about the origin.

    Args:
        path: of the picture, in any format that Pillow reads; what is transparent is white.
        width: of the rectangle [rd].
        height: of it [rd].

    Raises:
        ConfigError: it is no picture, has no dark pixel, or needs too many boxes.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        check_file(path)
        with Image.open(path) as picture:
            shown = picture.convert("RGBA")
            white = Image.new("RGBA", shown.size, "white")
            pixels = np.asarray(Image.alpha_composite(white, shown).convert("L"))
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError, ValueError) as error:
        raise ConfigError("maze", str(path), f"a picture, as PNG ({error})") from None
    found = rectangles(pixels < 128)
    if not 0 < len(found) <= MOST:
        remedy = "draw fewer and straighter walls with fewer pixels" if len(found) else "draw walls in black"
        raise ConfigError("maze", f"{len(found)} boxes in {path}", f"a picture of 1 to {MOST} boxes", remedy)
    rows, columns = pixels.shape
    x, y = found[:, [0, 2]] * (width / columns) - width / 2, height / 2 - found[:, [1, 3]] * (height / rows)
    boxes = np.column_stack([x.mean(axis=1), y.mean(axis=1), np.diff(x)[:, 0] / 2, -np.diff(y)[:, 0] / 2, 0 * x[:, 0]])
    return tuple(map(tuple, boxes.tolist()))


def rectangles(dark: Bool[np.ndarray, "H W"]) -> Int[np.ndarray, "K 4"]:
    """Return rectangles that cover what is dark: first column and row, and those after the last.

    Runs of dark pixels of a row go on in the next row as long as they begin and end alike.
    """
    found, going = [], {}
    for row, line in enumerate(np.vstack([dark, np.zeros_like(dark[:1])])):
        edges = np.flatnonzero(np.diff(line, prepend=False, append=False)).reshape(-1, 2)
        runs = {(int(first), int(last)) for first, last in edges}
        found += [(first, begun, last, row) for (first, last), begun in going.items() if (first, last) not in runs]
        going = {run: going.get(run, row) for run in sorted(runs)}
    return np.array(found, int).reshape(-1, 4)
