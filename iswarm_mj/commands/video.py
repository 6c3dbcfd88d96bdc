"""`iswarm video`."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from iswarm_mj.commands.render_options import RenderOptions
from iswarm_mj.utils.constraints import Within, check


@dataclass(frozen=True)
class Video(RenderOptions):
    """Render a recorded run to an mp4 video, off-screen."""

    title: str = ""
    """Text in the upper left corner."""
    steps: Annotated[int | None, Within(1)] = None
    """Number of control steps from the start; all by default."""
    frames_per_step: Annotated[int, Within(1, 24)] = 2
    """Frames per control step; a second has 24."""
    camera: Literal["above", "oblique"] = "oblique"
    width: Annotated[int, Within(64, 4096, "pixels")] = 1280
    """[pixels]"""
    height: Annotated[int, Within(64, 4096, "pixels")] = 720
    """[pixels]"""
    out: Path = Path("swarm.mp4")
    """The file to write."""

    def __post_init__(self):
        super().__post_init__()
        for name in ("width", "height"):
            check(name, getattr(self, name), "an even number of pixels", getattr(self, name) % 2 == 0)
        check("out", str(self.out), "a name ending in .mp4", self.out.suffix == ".mp4")

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.output.stage import Shot
        from iswarm_mj.output.video import Film, write_video

        shot = Shot(self.camera, (self.width, self.height), self.ball_scale, fine=False)
        write_video(self.directory, self.out, Film(self.title, self.steps, self.frames_per_step, shot))
        print(f"video of {self.directory}: {self.out}")
