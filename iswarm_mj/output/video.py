"""A video of a run, H.264 in an mp4 file, rendered off-screen by MuJoCo from the run's directory."""

import subprocess
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import imageio_ffmpeg
import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont
from tqdm import tqdm

from iswarm_mj.output.stage import Shot, Stage, load
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write

RATE = 24
"""Frames per second."""
QUALITY = 4
"""From 0 to 10; 4 is a constant rate factor of 30 of x264."""


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
    config, frames = load(directory)
    last = len(frames["step"]) - 1 if film.steps is None else min(film.steps, len(frames["step"]) - 1)
    total = last * film.frames_per_step + 1
    with atomic_write(out) as part, Stage(config, frames, film.shot) as stage:
        pictures = _pictures(stage, frames, film, last)
        encode(tqdm(pictures, out.stem, total, unit="frame", disable=not sys.stderr.isatty()), part, film.shot.size)


def encode(pictures: Iterable[np.ndarray], out: Path, size: tuple[int, int]) -> None:
    """Encode pictures (height, width, 3) uint8 as H.264, yuv420p, at `RATE`; the file begins with its index.

    Raises:
        UserError: ffmpeg could not write the file.
    """
    writer = imageio_ffmpeg.write_frames(
        str(out),
        size,
        fps=RATE,
        codec="libx264",
        pix_fmt_out="yuv420p",
        macro_block_size=2,
        quality=QUALITY,
        output_params=["-movflags", "+faststart", "-f", "mp4"],
        ffmpeg_log_level="error",
    )
    try:
        writer.send(None)
        for picture in pictures:
            writer.send(np.ascontiguousarray(picture))
    except (OSError, subprocess.SubprocessError) as error:
        raise UserError(f"The video {out} could not be written ({error}); choose a writable directory.") from None
    finally:
        writer.close()


def _pictures(stage: Stage, frames: dict[str, np.ndarray], film: Film, last: int) -> Iterator[np.ndarray]:
    """Frames with their captions, up to the step `last`."""
    for number in range(last * film.frames_per_step + 1):
        step, part = divmod(number, film.frames_per_step)
        share = part / film.frames_per_step
        pose, balls = (interpolated(frames[name], step, share) for name in ("pose", "ball_position"))
        pixels = stage.show(pose, frames["is_loaded"][step], balls)
        n_dust = frames["ball_position"].shape[1]
        yield _captioned(
            pixels, [film.title, f"step {step}", f"{frames['delivered'][step]} of {n_dust} balls delivered"]
        )


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
