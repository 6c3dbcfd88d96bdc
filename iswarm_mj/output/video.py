"""Encodes pictures by ffmpeg: H.264 in MP4, animated GIF and animated WebP."""

import re
import subprocess
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from tempfile import NamedTemporaryFile, TemporaryFile
from typing import IO, NamedTuple

import imageio_ffmpeg
import numpy as np
from jaxtyping import UInt8
from PIL import Image

from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.operating_system import own_group

RATE_FACTOR = 30
"""Constant rate factor of x264: from 0, without loss, to 51."""
_CODECS = {
    ".mp4": f"-c:v libx264 -preset veryfast -pix_fmt yuv420p -crf {RATE_FACTOR} "
    "-movflags +faststart -f mp4",
    ".gif": "-loop 0 -f gif",
    ".webp": "-c:v libwebp_anim -pix_fmt yuv420p -quality 75 -compression_level 2 -loop 0 -f webp",
}
"""Flags of ffmpeg by suffix; MP4 begins with its index, GIF and WebP repeat without end."""
SUFFIXES = tuple(_CODECS)
"""Suffixes of the names of videos."""
_N_COLOURS = 256
"""Colours of a GIF."""
_PALETTE_EDGE = 16
"""Edge of the picture that holds these colours [pixels]."""

Picture = UInt8[np.ndarray, "height width 4"]
"""Red, green, blue and opacity."""


class Clip(NamedTuple):
    """Pictures of a video."""

    pictures: Iterable[Picture]
    """Pictures of one size."""
    size: tuple[int, int]
    """Width and height, even numbers [pixels]."""
    rate: float
    """Pictures per second."""


def encode(clip: Clip, out: Path, suffix: str, samples: Iterable[Picture] = ()) -> None:
    """Encode pictures.

    Args:
        clip: pictures, their size and rate.
        out: the file to write.
        suffix: kind of file, one of `SUFFIXES`.
        samples: some of the pictures, which have all colours of a GIF.

    Raises:
        UserError: ffmpeg could not write the file.
    """
    width, height = clip.size
    pipe = f"-f rawvideo -pix_fmt rgba -s {width}x{height} -r {clip.rate:g} -i -".split()
    with TemporaryFile() as log, NamedTemporaryFile(suffix=".png") as palette_file:
        inputs = pipe
        if suffix == ".gif":
            _palette(samples).save(palette_file)
            palette_file.flush()
            # Flat colours need no dithering, and compress badly with it.
            inputs = [*pipe, "-i", palette_file.name, "-lavfi", "paletteuse=dither=none"]
        command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-y", *inputs]
        command += ["-an", *_CODECS[suffix].split(), f"file:{out}"]
        status = _pipe(clip.pictures, command, log)
        log.seek(0)
        messages = _messages(log.read().decode(errors="replace"))
    if status:
        # The first message names the cause.
        reason = messages[0] if messages else f"it ended with status {status}"
        raise UserError(
            f"ffmpeg could not write the video ({reason}); make room or choose another `out`"
        )


def _palette(samples: Iterable[Picture]) -> Image.Image:
    """Return a picture of the colours that show some pictures best, 16 x 16 pixels."""
    # Pictures may be views of one canvas, which the next one overwrites.
    pictures = [np.array(picture)[..., :3] for picture in samples]
    quantized = Image.fromarray(np.concatenate(pictures)).quantize(_N_COLOURS)
    colours = quantized.getpalette() or []
    values = np.zeros((_N_COLOURS, 3), np.uint8)
    found = np.array(colours, np.uint8).reshape(-1, 3)[:_N_COLOURS]
    values[: len(found)] = found
    return Image.fromarray(values.reshape(_PALETTE_EDGE, _PALETTE_EDGE, 3))


def _pipe(pictures: Iterable[Picture], command: list[str], log: IO[bytes]) -> int:
    """Send pictures to a process, and return its exit status.

    Args:
        pictures: pictures.
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
