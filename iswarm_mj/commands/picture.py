"""`iswarm picture`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from iswarm_mj.commands.render_options import RenderOptions
from iswarm_mj.utils.constraints import Within


@dataclass(frozen=True)
class Picture(RenderOptions):
    """Render one step of a recorded run to a PNG, off-screen."""

    step: Annotated[int, Within(0)] = 100
    """Control step, from 0 for the start."""
    width: Annotated[int, Within(16, 8192, "pixels")] = 1280
    """[pixels]"""
    height: Annotated[int, Within(16, 8192, "pixels")] = 1280
    """[pixels]"""
    out: Path = Path("swarm.png")
    """The file to write."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.output.render import render
        from iswarm_mj.output.stage import Shot

        render(self.directory, self.step, Shot(self.camera, (self.width, self.height), self.ball_scale), self.out)
        print(f"step {self.step} of {self.directory}, {self.camera}: {self.out}")
