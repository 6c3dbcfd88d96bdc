"""Video of a run, H.264 in an mp4 file, rendered off-screen by MuJoCo from the run's directory."""

import re
import subprocess
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import IO

import imageio_ffmpeg
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from iswarm_mj.output.loading import SavedRun
from iswarm_mj.output.offscreen import ArenaRenderer, Shot, load_recorded
from iswarm_mj.output.trajectory import METRIC, Arrays
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, check_name, make_output_directory
from iswarm_mj.utils.operating_system import own_group
from iswarm_mj.utils.progress import Progress

RATE = 24
"""Frames per second."""
RATE_FACTOR = 30
"""Constant rate factor of x264: from 0, without loss, to 51."""
_TEXT_COLOUR = (40, 44, 52)
_MIN_TEXT_HEIGHT = 10
"""Minimum height of the caption's font [pixels]."""


def write_video(
    directory: Path,
    out: Path,
    shot: Shot,
    frames_per_step: int = 2,
    steps: int | None = None,
    title: str = "",
) -> None:
    """Write a video of a run.

    Args:
        directory: the `--out` of a run of `iswarm clean`.
        out: the file to write, ending in .mp4.
        shot: camera, size and quality; width and height are even.
        frames_per_step: frames per control step; robots move straight between two steps.
        steps: number of control steps from the start; None for all.
        title: text in the upper left corner, above time and deliveries.

    Raises:
        UserError: no recorded run, no such camera, no off-screen OpenGL, or ffmpeg could not write
            the file.
    """
    check_name(out, ".mp4")
    run = load_recorded(directory)
    frames = run.arrays
    last_step = len(frames["step"]) - 1
    if steps is not None:
        last_step = min(steps, last_step)
    make_output_directory(out.parent, given=out)
    bar = Progress(last_step * frames_per_step + 1, "frame", out.stem)
    with run.explained():
        opened = ArenaRenderer(run.config, frames, shot, run.robot_file)
    # Outside of `explained`, since errors of the encoder are not due to the arrays.
    with atomic_write(out) as part, opened as renderer, bar:
        pictures = _pictures(renderer, run, title, frames_per_step, last_step)
        encode(_counted(pictures, bar), part, shot.size)


def encode(pictures: Iterable[np.ndarray], out: Path, size: tuple[int, int]) -> None:
    """Encode pictures as H.264, yuv420p, at `RATE`; the file begins with its index.

    Args:
        pictures: pictures (height, width, 3) uint8.
        out: the file to write.
        size: width and height [pixels].

    Raises:
        UserError: ffmpeg could not write the file.
    """
    width, height = size
    input_flags = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {RATE} -i -"
    output_flags = (
        f"-an -c:v libx264 -pix_fmt yuv420p -crf {RATE_FACTOR} -movflags +faststart -f mp4"
    )
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y"]
    command += [*input_flags.split(), *output_flags.split(), f"file:{out}"]
    with TemporaryFile() as log:
        status = _pipe(pictures, command, log)
        log.seek(0)
        messages = _messages(log.read().decode(errors="replace"))
    if status:
        # The first message names the cause.
        reason = messages[0] if messages else f"it ended with status {status}"
        raise UserError(
            f"ffmpeg could not write the video ({reason}); make room or choose another `out`"
        )


def _pipe(pictures: Iterable[np.ndarray], command: list[str], log: IO[bytes]) -> int:
    """Send pictures to a process, and return its exit status.

    Args:
        pictures: pictures (height, width, 3) uint8.
        command: command of the process.
        log: file of its standard error.
    """
    # In a group of its own, so that Ctrl-C reaches this process alone.
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=log, **own_group())
    assert process.stdin is not None
    try:
        # The log explains a broken pipe better than the exception.
        with suppress(BrokenPipeError), process.stdin as stdin:
            for picture in pictures:
                stdin.write(np.ascontiguousarray(picture).data)
        return process.wait()
    finally:
        process.kill()
        process.wait()


def _messages(log: str) -> list[str]:
    """Return the messages of ffmpeg's log, without the names of its parts in square brackets."""
    lines = [re.sub(r"^\[[^]]*\] *", "", line).strip(" .") for line in log.split("\n")]
    return [line for line in lines if line]


def _pictures(
    renderer: ArenaRenderer, run: SavedRun, title: str, frames_per_step: int, last_step: int
) -> Iterator[np.ndarray]:
    """Yield frames with their captions, up to the last step."""
    for number in range(last_step * frames_per_step + 1):
        step, frame_of_step = divmod(number, frames_per_step)
        with run.explained():
            lines = [title, f"step {step}", *_counts(run.arrays, step)]
            pixels = renderer.show(run.arrays, step, frame_of_step / frames_per_step)
        yield _captioned(pixels, lines)


def _counted(pictures: Iterable[np.ndarray], bar: Progress) -> Iterator[np.ndarray]:
    """Yield pictures, and count each on a progress bar when it has been used."""
    for picture in pictures:
        yield picture
        bar.update()


def _counts(frames: Arrays, step: int) -> list[str]:
    """Return the lines of a caption with the metrics of the task, or else with the deliveries."""
    metrics = frames["scene_metric_names"].tolist()
    if metrics:
        return [f"{name} {frames[METRIC + name][step]:.3g}" for name in metrics]
    n_balls = frames["ball_state"].shape[1]
    return [f"{frames['delivered'][step]} of {n_balls} balls delivered"]


def _captioned(pixels: np.ndarray, lines: list[str]) -> np.ndarray:
    """Return a picture with lines of text in its upper left corner."""
    image = Image.fromarray(pixels)
    draw = ImageDraw.Draw(image)
    text_height = max(_MIN_TEXT_HEIGHT, pixels.shape[0] // 30)
    font = ImageFont.load_default(size=text_height)
    for row, line in enumerate(lines):
        position = (text_height, text_height * (0.8 + 1.3 * row))
        draw.text(position, line, fill=_TEXT_COLOUR, font=font)
    return np.asarray(image)
