"""`iswarm video`."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import UserError


@dataclass(frozen=True)
class Video:
    """Render a recorded run to an mp4 video, off-screen."""

    directory: tyro.conf.Positional[Path] = Path("runs/clean")
    """The --out of a run of `iswarm clean`."""
    title: str = ""
    """Stands in the upper left corner."""
    steps: int | None = None
    """Control steps from the start; all by default."""
    frames_per_step: int = 2
    """Frames in each control step, at 24 a second."""
    camera: str = "oblique"
    """above or oblique."""
    width: int = 1280
    """[pixels]"""
    height: int = 720
    """[pixels]"""
    ball_scale: float = 15.0
    """The balls are drawn this many times larger, or they would not show."""
    out: Path = Path("swarm.mp4")
    """The file to write."""

    def run(self) -> None:
        """Run the command."""
        for name in ("width", "height"):
            value = getattr(self, name)
            check(name, value, "an even number between 64 and 4096 pixels", 64 <= value <= 4096 and value % 2 == 0)
        check("steps", self.steps, "at least 1", self.steps is None or self.steps >= 1)
        check("frames_per_step", self.frames_per_step, "between 1 and 24", 1 <= self.frames_per_step <= 24)
        check("ball_scale", self.ball_scale, "between 1 and 1000", 1 <= self.ball_scale <= 1000)
        if self.out.suffix != ".mp4":
            raise UserError(f"--out was {self.out}; it must be a name ending in .mp4: give such a one.")
        from iswarm_mj.output.video import write_video

        write_video(
            self.directory, self.out, self.title, self.steps, self.frames_per_step, (self.width, self.height),
            self.camera, self.ball_scale,
        )  # fmt: skip
