"""`iswarm picture`."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from iswarm_mj.utils.constraints import check


@dataclass(frozen=True)
class Picture:
    """Render one step of a recorded run to a PNG, off-screen."""

    directory: tyro.conf.Positional[Path] = Path("runs/clean")
    """The --out of a run of `iswarm clean`."""
    step: int = 100
    """Control step, from 0 for the start."""
    camera: str = "above"
    """above or oblique."""
    width: int = 1280
    """[pixels]"""
    height: int = 1280
    """[pixels]"""
    ball_scale: float = 15.0
    """The balls are drawn this many times larger, or they would not show."""
    out: Path = Path("swarm.png")
    """The file to write."""

    def run(self) -> None:
        """Run the command."""
        check("width", self.width, "between 16 and 8192 pixels", 16 <= self.width <= 8192)
        check("height", self.height, "between 16 and 8192 pixels", 16 <= self.height <= 8192)
        check("ball_scale", self.ball_scale, "between 1 and 1000", 1 <= self.ball_scale <= 1000)
        from iswarm_mj.output.render import render

        render(self.directory, self.step, self.camera, (self.width, self.height), self.ball_scale, self.out)
