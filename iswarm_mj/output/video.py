"""A video of a run, H.264 in an mp4 file, rendered off-screen by MuJoCo from the run's directory."""

import re
import subprocess
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import NamedTuple

import imageio_ffmpeg
import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont

from iswarm_mj.output.stage import Shot, Stage, recorded
from iswarm_mj.output.trajectory import METRIC, Arrays, areas_of
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, make_output_directory
from iswarm_mj.utils.progress import Progress

RATE = 24
"""Frames per second."""
RATE_FACTOR = 30
"""Constant rate factor of x264: from 0, without loss, to 51."""


class Film(NamedTuple):
    """What a video shows, and how."""

    title: str = ""
    """Text in the upper left corner, above time and deliveries."""
    steps: int | None = None
    """Control steps from the start; None for all."""
    frames_per_step: int = 2
    """Frames per control step; robots move straight between two steps."""
    shot: Shot = Shot("oblique", (1280, 720), fine=False)
    """Camera, size and quality; width and height are even."""


def write_video(directory: Path, out: Path, film: Film) -> None:
    """Write a video of a run.

    Args:
        directory: the `--out` of a run of `iswarm clean`.
        out: the file to write, ending in .mp4.
        film: what it shows.

    Raises:
        UserError: no recorded run, no such camera, no off-screen OpenGL, or ffmpeg could not write the file.
    """
    run = recorded(directory)
    frames = run.arrays
    last = len(frames["step"]) - 1 if film.steps is None else min(film.steps, len(frames["step"]) - 1)
    make_output_directory(out.parent, given=out)
    bar = Progress(last * film.frames_per_step + 1, "frame", out.stem)
    with (
        run.explained(),
        atomic_write(out) as part,
        Stage(run.config, frames, film.shot, run.robot_file) as stage,
        bar,
    ):
        encode(_pictures(stage, frames, film, last, bar), part, film.shot.size)


def encode(pictures: Iterable[np.ndarray], out: Path, size: tuple[int, int]) -> None:
    """Encode pictures (height, width, 3) uint8 as H.264, yuv420p, at `RATE`; the file begins with its index.

    Raises:
        UserError: ffmpeg could not write the file.
    """
    given = f"-f rawvideo -pix_fmt rgb24 -s {size[0]}x{size[1]} -r {RATE} -i -"
    wanted = f"-an -c:v libx264 -pix_fmt yuv420p -crf {RATE_FACTOR} -movflags +faststart -f mp4"
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y", *given.split(), *wanted.split(), f"file:{out}"]
    with TemporaryFile() as told:
        # In a group of its own, so that Ctrl-C reaches this process alone.
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=told, process_group=0)
        assert process.stdin is not None
        try:
            with suppress(BrokenPipeError), process.stdin as stdin:  # ffmpeg's own words say more
                for picture in pictures:
                    stdin.write(np.ascontiguousarray(picture).data)
            status = process.wait()
        finally:
            process.kill()
            process.wait()
        told.seek(0)
        lines = [
            re.sub(r"^\[[^]]*\] *", "", line).strip(" .") for line in told.read().decode(errors="replace").split("\n")
        ]
    if status:
        reason = next(filter(None, lines), f"it ended with status {status}")  # the first line names the cause
        raise UserError(f"ffmpeg could not write the video ({reason}); make room or choose another `out`")


def _pictures(stage: Stage, frames: Arrays, film: Film, last: int, bar: Progress) -> Iterator[np.ndarray]:
    """Frames with their captions, up to the step `last`."""
    metrics = frames["scene_metric_names"].tolist()
    for number in range(last * film.frames_per_step + 1):
        step, part = divmod(number, film.frames_per_step)
        moving = frames["pose"], frames["ball_position"], frames["box_pose"]
        pose, balls, boxes = (interpolated(values, step, part / film.frames_per_step) for values in moving)
        delivered = f"{frames['delivered'][step]} of {balls.shape[0]} balls delivered"
        counts = [f"{name} {frames[METRIC + name][step]:.3g}" for name in metrics] or [delivered]
        yield _captioned(
            stage.show(pose, frames["is_loaded"][step], balls, boxes, areas_of(frames, step)),
            [film.title, f"step {step}", *counts],
        )
        bar.update()


def interpolated(values: Float[np.ndarray, "T *shape"], step: int, part: float) -> Float[np.ndarray, "*shape"]:
    """Values at a fraction of the way from a step to the next, interpolated linearly."""
    here = values[step].astype(float)
    return here + part * (values[step + 1] - here) if part else here


def _captioned(pixels: np.ndarray, lines: list[str]) -> np.ndarray:
    image = Image.fromarray(pixels)
    draw, height = ImageDraw.Draw(image), max(10, pixels.shape[0] // 30)
    font = ImageFont.load_default(size=height)
    for row, line in enumerate(lines):
        draw.text((height, height * (0.8 + 1.3 * row)), line, fill=(40, 44, 52), font=font)
    return np.asarray(image)
