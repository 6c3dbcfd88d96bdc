"""A video of a run, H.264 in an mp4 file, rendered off-screen by MuJoCo from the run's directory."""

import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from PIL import Image, ImageDraw, ImageFont
from tqdm import tqdm

from iswarm_mj.output.render import Stage, load
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write

RATE = 24
"""Frames per second."""
QUALITY = 4
"""From 0 to 10; 4 is a constant rate factor of 30 of x264."""


def write_video(
    directory: Path, out: Path, title: str = "", steps: int | None = None, frames_per_step: int = 2,
    size: tuple[int, int] = (1280, 720), camera: str = "oblique", ball_scale: float = 15.0,
) -> None:  # fmt: skip
    """Write a video of a run.

    Args:
        directory: the `--out` of a run of `iswarm clean`.
        out: the file to write, ending in .mp4.
        title: stands in its upper left corner, above time and deliveries.
        steps: control steps from the start; None for all.
        frames_per_step: frames in each control step; robots go straight between two of them.
        size: width and height, even numbers [pixels].
        camera: name of a camera in `models/arena.xml`.
        ball_scale: the balls are drawn this many times larger.

    Raises:
        UserError: no recorded run, no such camera, no off-screen OpenGL, or ffmpeg could not write the file.
    """
    config, frames = load(directory)
    last = len(frames["step"]) - 1 if steps is None else min(steps, len(frames["step"]) - 1)
    total = last * frames_per_step + 1
    with atomic_write(out) as part, Stage(config, frames, camera, size, ball_scale, fine=False) as stage:
        pictures = _pictures(stage, frames, title, last, frames_per_step)
        encode(tqdm(pictures, out.stem, total, unit="frame", disable=not sys.stderr.isatty()), part, size)


def encode(pictures: Iterable[np.ndarray], out: Path, size: tuple[int, int]) -> None:
    """Encode pictures (height, width, 3) uint8 as H.264, yuv420p, at `RATE`; the file begins with its index.

    Raises:
        UserError: ffmpeg could not write the file.
    """
    options = ["-movflags", "+faststart", "-f", "mp4"]
    writer = imageio_ffmpeg.write_frames(
        str(out), size, fps=RATE, codec="libx264", pix_fmt_out="yuv420p", macro_block_size=2, quality=QUALITY,
        output_params=options, ffmpeg_log_level="error",
    )  # fmt: skip
    try:
        writer.send(None)
        for picture in pictures:
            writer.send(np.ascontiguousarray(picture))
    except (OSError, subprocess.SubprocessError) as error:
        raise UserError(f"The video {out} could not be written ({error}); give a directory of yours.") from None
    finally:
        writer.close()


def _pictures(
    stage: Stage, frames: dict[str, np.ndarray], title: str, last: int, frames_per_step: int
) -> Iterator[np.ndarray]:
    """Frames with their captions."""
    for number in range(last * frames_per_step + 1):
        step, part = divmod(number, frames_per_step)
        pose, balls = (between(frames[name], step, part / frames_per_step) for name in ("pose", "ball_position"))
        pixels = stage.show(pose, frames["is_loaded"][step], balls)
        n_dust = frames["ball_position"].shape[1]
        yield _captioned(pixels, [title, f"step {step}", f"{frames['delivered'][step]} of {n_dust} balls delivered"])


def between(values: np.ndarray, step: int, part: float) -> np.ndarray:
    """Values at a part of the way from a step to the next one, along straight lines; (T, ...) -> (...)."""
    here = values[step].astype(float)
    return here + part * (values[step + 1] - here) if part else here


def _captioned(pixels: np.ndarray, lines: list[str]) -> np.ndarray:
    image = Image.fromarray(pixels)
    draw, height = ImageDraw.Draw(image), max(10, pixels.shape[0] // 30)
    font = ImageFont.load_default(size=height)
    for row, line in enumerate(lines):
        draw.text((height, height * (0.8 + 1.3 * row)), line, fill=(40, 44, 52), font=font)
    return np.asarray(image)
