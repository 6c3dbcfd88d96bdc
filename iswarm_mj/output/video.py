"""A video of a run, H.264 in an mp4 file, rendered off-screen by MuJoCo from the run's directory."""

import re
import subprocess
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile

import imageio_ffmpeg
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from iswarm_mj.output.saved import SavedRun
from iswarm_mj.output.stage import Shot, Stage, recorded
from iswarm_mj.output.trajectory import METRIC
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, check_name, make_output_directory
from iswarm_mj.utils.progress import Progress

RATE = 24
"""Frames per second."""
RATE_FACTOR = 30
"""Constant rate factor of x264: from 0, without loss, to 51."""


def write_video(
    directory: Path, out: Path, shot: Shot, frames_per_step: int = 2, steps: int | None = None, title: str = ""
) -> None:
    """Write a video of a run.

    Args:
        directory: the `--out` of a run of `iswarm clean`.
        out: the file to write, ending in .mp4.
        shot: camera, size and quality; width and height are even.
        frames_per_step: frames per control step; robots move straight between two steps.
        steps: control steps from the start; None for all.
        title: text in the upper left corner, above time and deliveries.

    Raises:
        UserError: no recorded run, no such camera, no off-screen OpenGL, or ffmpeg could not write the file.
    """
    check_name(out, ".mp4")
    run = recorded(directory)
    frames = run.arrays
    last = len(frames["step"]) - 1 if steps is None else min(steps, len(frames["step"]) - 1)
    make_output_directory(out.parent, given=out)
    bar = Progress(last * frames_per_step + 1, "frame", out.stem)
    with run.explained():
        made = Stage(run.config, frames, shot, run.robot_file)
    with atomic_write(out) as part, made as stage, bar:
        # What fails in the encoder is no matter of the arrays.
        encode(_pictures(stage, run, title, frames_per_step, last, bar), part, shot.size)


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


def _pictures(
    stage: Stage, run: SavedRun, title: str, frames_per_step: int, last: int, bar: Progress
) -> Iterator[np.ndarray]:
    """Frames with their captions, up to the step `last`."""
    frames = run.arrays
    metrics = frames["scene_metric_names"].tolist()
    for number in range(last * frames_per_step + 1):
        step, part = divmod(number, frames_per_step)
        with run.explained():
            delivered = f"{frames['delivered'][step]} of {frames['ball_state'].shape[1]} balls delivered"
            counts = [f"{name} {frames[METRIC + name][step]:.3g}" for name in metrics] or [delivered]
            shown = _captioned(stage.show(frames, step, part / frames_per_step), [title, f"step {step}", *counts])
        yield shown
        bar.update()


def _captioned(pixels: np.ndarray, lines: list[str]) -> np.ndarray:
    image = Image.fromarray(pixels)
    draw, height = ImageDraw.Draw(image), max(10, pixels.shape[0] // 30)
    font = ImageFont.load_default(size=height)
    for row, line in enumerate(lines):
        draw.text((height, height * (0.8 + 1.3 * row)), line, fill=(40, 44, 52), font=font)
    return np.asarray(image)
