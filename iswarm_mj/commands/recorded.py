"""`iswarm inspect`, `iswarm picture`, `iswarm video`: what recorded runs hold and look like."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from iswarm_mj.utils.constraints import Within, check, validate
from iswarm_mj.utils.errors import printable


@dataclass(frozen=True)
class Inspect:
    """Say what a directory of results holds: what ran, its measures and faults, its files and how to open them."""

    directory: tyro.conf.Positional[Path] = Path("runs")
    """The --out of a command, also of an interrupted one, or a directory of several."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.experiments.report.inspection import inspection

        print("\n".join(map(printable, inspection(self.directory).split("\n"))))


@dataclass(frozen=True)
class RenderOptions:
    """Which run is rendered, and how the camera shows it."""

    directory: tyro.conf.Positional[Path] = Path("runs/clean")
    """The --out of a run of `iswarm clean`."""
    camera: Literal["above", "oblique"] = "above"
    """Where the camera is."""

    def __post_init__(self):
        validate(self)


@dataclass(frozen=True)
class Picture(RenderOptions):
    """Render one step of a recorded run to a PNG, off-screen."""

    step: Annotated[int | None, Within(0)] = None
    """Control step, from 0 for the start; 100 by default, or the last one of a shorter run."""
    width: Annotated[int, Within(16, 8192, "pixels")] = 1280
    """Of the picture."""
    height: Annotated[int, Within(16, 8192, "pixels")] = 1280
    """Of the picture."""
    out: Path = Path("swarm.png")
    """The file to write."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.output.render import render
        from iswarm_mj.output.stage import Shot

        shot = Shot(self.camera, (self.width, self.height))
        step = render(self.directory, self.step, shot, self.out)
        print(f"step {step} of {self.directory}, {self.camera}: {self.out}")


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
    """Of the frames; even."""
    height: Annotated[int, Within(64, 4096, "pixels")] = 720
    """Of the frames; even."""
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

        shot = Shot(self.camera, (self.width, self.height), fine=False)
        write_video(self.directory, self.out, Film(self.title, self.steps, self.frames_per_step, shot))
        print(f"video of {self.directory}: {self.out}")
