"""`iswarm picture`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from iswarm_mj.utils.constraints import Within, validate


@dataclass(frozen=True)
class Picture:
    """Render one step of a recorded run to a PNG, off-screen."""

    directory: tyro.conf.Positional[Path] = Path("runs/clean")
    """The --out of a run of `iswarm clean`."""
    step: int = 100
    """Control step, from 0 for the start."""
    camera: str = "above"
    """above or oblique."""
    width: Annotated[int, Within(16, 8192, "pixels")] = 1280
    """[pixels]"""
    height: Annotated[int, Within(16, 8192, "pixels")] = 1280
    """[pixels]"""
    ball_scale: Annotated[float, Within(1, 1000)] = 15.0
    """Magnification of the balls, which are too small to see at their true size."""
    out: Path = Path("swarm.png")
    """The file to write."""

    def __post_init__(self):
        validate(self)

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.output.render import render
        from iswarm_mj.output.stage import Shot

        render(self.directory, self.step, Shot(self.camera, (self.width, self.height), self.ball_scale), self.out)
