"""A picture of a run, from its directory."""

from pathlib import Path

from iswarm_mj.output.stage import Shot, Stage, load
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import UserError


def render(directory: Path, step: int, shot: Shot, out: Path) -> None:
    """Render one frame of a run to a PNG.

    Args:
        directory: the `--out` of the run.
        step: control step, from 0 for the start.
        shot: camera, size and quality.
        out: the file to write.

    Raises:
        UserError: no such run, step or camera, or no off-screen OpenGL, or `out` is not writable.
    """
    config, frames = load(directory)
    last = int(frames["step"][-1])
    check("step", step, f"a step of the run, 0 to {last}", 0 <= step <= last)
    with Stage(config, frames, shot) as stage:
        pixels = stage.frame(frames, step)
    from PIL import Image

    try:
        Image.fromarray(pixels).save(out)
    except (OSError, ValueError) as error:
        raise UserError(
            f"--out must be a writable name ending in .png (got {out}, which cannot be written: {error})"
        ) from None
