"""Which part of a run a replay or a video shows, and how; also flags of their commands."""

from dataclasses import dataclass
from typing import Annotated

from iswarm_mj.utils.constraints import Within, validate

VIDEO_SUFFIXES = (".mp4", ".gif", ".webp")
"""Suffixes of the names of videos."""


@dataclass(frozen=True)
class Film:
    """The part of a run that is shown, and how."""

    first: Annotated[int, Within(0)] = 0
    """Control step with which it begins."""
    last: Annotated[int | None, Within(1)] = None
    """Control step with which it ends; by default that of the run, at most 200 after the first."""
    speed: Annotated[float, Within(0.1, 1000, "1/s")] = 8.0
    """Control steps a second."""
    frames_per_step: Annotated[float, Within(0.001, 24)] = 2.0
    """Pictures for each control step; more are smoother, and the file is larger; below 1 not all
    steps are shown."""
    colour_by: str = "state"
    """Meaning of the robots' colours: state; or hops to, says or remembers, and a name, as "hops to
    dust"."""
    draw: tuple[str, ...] = ("links",)
    """Lines that are drawn: links, trails, and the names of vectors that robots remember."""
    title: str = ""
    """Text in the upper left corner."""
    dark: bool = False
    """Light on dark."""

    def __post_init__(self):
        validate(self)
