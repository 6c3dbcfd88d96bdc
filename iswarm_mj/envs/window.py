"""A window that shows pictures as they are drawn."""

from typing import Any

import numpy as np
from jaxtyping import UInt8

from iswarm_mj.utils.errors import UserError

_WITHOUT = {"agg", "cairo", "pdf", "pgf", "ps", "svg", "template"}
"""Backends of matplotlib that only write files."""


class Window:
    """A window of matplotlib."""

    def __init__(self):
        """Open it with the first picture.

        Raises:
            UserError: matplotlib has no display.
        """
        from matplotlib import pyplot

        self._pyplot, self._image = pyplot, None
        if (backend := pyplot.get_backend().lower()) in _WITHOUT:
            raise UserError(
                f"render_mode human needs a display (matplotlib draws by {backend}); use rgb_array, or record=FILE.rrd"
            )

    def show(self, pixels: UInt8[np.ndarray, "height width 3"]) -> None:
        """Show a picture."""
        image: Any = self._image
        if image is None:
            figure, axes = self._pyplot.subplots(figsize=(6, 6), num="iswarm", clear=True)
            figure.subplots_adjust(0, 0, 1, 1)
            axes.axis("off")
            image = self._image = axes.imshow(pixels)
        image.set_data(pixels)
        self._pyplot.pause(0.001)  # which draws, and takes events

    def close(self) -> None:
        """Close it."""
        if self._image is not None:
            self._pyplot.close(self._image.figure)
        self._image = None
