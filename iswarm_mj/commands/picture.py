"""`iswarm picture`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from iswarm_mj.commands.render_options import RenderOptions
from iswarm_mj.utils.constraints import Within


@dataclass(frozen=True)
class Picture(RenderOptions):
    """Render one step of a recorded run to a PNG, off-screen."""

    step: Annotated[int | None, Within(0)] = None
    """Control step, from 0 for the start; 100 by default, or the last one of a shorter run."""
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

        shot = Shot(self.camera, (self.width, self.height), self.ball_scale)
        step = render(self.directory, self.step, shot, self.out)
        print(f"step {step} of {self.directory}, {self.camera}: {self.out}")
