"""Flags of the commands that render a recorded run."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from iswarm_mj.utils.constraints import Within, validate


@dataclass(frozen=True)
class RenderOptions:
    """Which run is rendered, and how the camera shows it."""

    directory: tyro.conf.Positional[Path] = Path("runs/clean")
    """The --out of a run of `iswarm clean`."""
    camera: Literal["above", "oblique"] = "above"
    """Where the camera is."""
    ball_scale: Annotated[float, Within(1, 1000)] = 15.0
    """Magnification of the balls, which are too small to see at their true size."""

    def __post_init__(self):
        validate(self)
