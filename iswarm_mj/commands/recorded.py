"""`iswarm inspect`, `iswarm picture`, `iswarm video`: what recorded runs hold and look like."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from iswarm_mj.player.film import VIDEO_SUFFIXES, Film
from iswarm_mj.utils.constraints import Within, check, validate
from iswarm_mj.utils.errors import printable
from iswarm_mj.utils.extras import require
from iswarm_mj.utils.files import check_name


@dataclass(frozen=True)
class Inspect:
    """Summarise a directory of results: what ran, measures, faults, and how to open each file."""

    directory: tyro.conf.Positional[Path] = Path("runs")
    """The --out of a finished or interrupted command, or a directory of several."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.paper.report.inspection import describe_directory

        print("\n".join(map(printable, describe_directory(self.directory).split("\n"))))


@dataclass(frozen=True)
class RenderOptions:
    """Which run is rendered, and how the camera shows it."""

    directory: tyro.conf.Positional[Path] = Path("runs/clean")
    """The --out of a run of `iswarm clean`."""
    camera: Literal["above", "oblique"] = "above"
    """Camera position."""

    def __post_init__(self):
        validate(self)


@dataclass(frozen=True)
class Picture(RenderOptions):
    """Render one step of a recorded run to a PNG, off-screen."""

    step: Annotated[int | None, Within(0)] = None
    """Control step, 0 for the start; 100 by default, or the last one of a shorter run."""
    width: Annotated[int, Within(16, 8192, "pixels")] = 1280
    """Width of the picture."""
    height: Annotated[int, Within(16, 8192, "pixels")] = 1280
    """Height of the picture."""
    out: Path = Path("swarm.png")
    """The file to write."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.output.offscreen import Shot, render

        shot = Shot(self.camera, (self.width, self.height))
        step = render(self.directory, self.step, shot, self.out)
        print(f"step {step} of {self.directory}, {self.camera}: {self.out}")


@dataclass(frozen=True)
class Video(Film):
    """Draw a recorded run as a video: MP4, animated GIF or animated WebP."""

    directory: tyro.conf.Positional[Path] = Path("runs/clean")
    """The --out of a run of `iswarm clean` or `iswarm run`."""
    last: Annotated[int | None, Within(1)] = None
    """Control step with which it ends; by default that of the run."""
    speed: Annotated[float, Within(0.1, 60, "1/s")] = 12.0
    """Control steps a second."""
    camera: Literal["above", "oblique"] = "oblique"
    """Camera position."""
    legend: bool = True
    """Explain the colours."""
    width: Annotated[int, Within(64, 4096, "pixels")] = 1280
    """Width of the frames, an even number."""
    height: Annotated[int, Within(64, 4096, "pixels")] = 720
    """Height of the frames, an even number."""
    out: Path = Path("swarm.mp4")
    """The file to write: .mp4, .gif or .webp."""

    def __post_init__(self):
        super().__post_init__()
        for name in ("width", "height"):
            pixels = getattr(self, name)
            check(name, pixels, "an even number of pixels", pixels % 2 == 0)
        check_name(self.out, *VIDEO_SUFFIXES)

    def run(self) -> None:
        """Run the command."""
        require("video")
        from iswarm_mj.output.offscreen import load_recorded
        from iswarm_mj.player.video import write_video

        size = (self.width, self.height)
        run = load_recorded(self.directory)
        last = write_video(
            run, self, self.out, camera=self.camera, size=size, has_legend=self.legend
        )
        print(f"steps {self.first} to {last} of {self.directory}: {self.out}")


@dataclass(frozen=True)
class Replay(Film):
    """Make one HTML file of a recorded run, which opens in any browser without a server."""

    directory: tyro.conf.Positional[Path] = Path("runs/clean")
    """The --out of a run of `iswarm clean` or `iswarm run`."""
    out: Path = Path("replay.html")
    """The file to write."""

    def __post_init__(self):
        super().__post_init__()
        check_name(self.out, ".html")

    def run(self) -> None:
        """Run the command."""
        require("play")
        from iswarm_mj.output.offscreen import load_recorded
        from iswarm_mj.player.replay import write_replay

        run = load_recorded(self.directory)
        last = write_replay(run, self, self.out)
        end = int(run.arrays["step"][-1])
        is_cut = self.last is None and last < end
        more = f"; --last {end} shows all" if is_cut else ""
        print(f"steps {self.first} to {last} of {self.directory}: {self.out}{more}")
