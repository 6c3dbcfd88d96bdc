"""A picture of a run, from its directory."""

from pathlib import Path

from PIL import Image

from iswarm_mj.output.stage import Shot, Stage, recorded
from iswarm_mj.output.trajectory import areas_of
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.files import atomic_write, make_output_directory

STEP = 100
"""The step that is shown by default."""


def render(directory: Path, step: int | None, shot: Shot, out: Path) -> int:
    """Render one frame of a run to a PNG; return its step.

    Args:
        directory: the `--out` of the run.
        step: control step, from 0 for the start; None for step 100, or the last one of a shorter run.
        shot: camera, size and quality.
        out: the file to write.

    Raises:
        UserError: no such run, step or camera, or no off-screen OpenGL, or `out` is not writable.
    """
    check("out", str(out), "a name ending in .png", out.suffix in Image.registered_extensions())
    run = recorded(directory)
    frames = run.arrays
    last = int(frames["step"][-1])
    step = min(STEP, last) if step is None else step
    check("step", step, f"a step of the run, 0 to {last}", 0 <= step <= last)
    make_output_directory(out.parent, given=out)
    with run.explained(), Stage(run.config, frames, shot, run.robot_file) as stage:
        names = ("pose", "is_loaded", "ball_position", "box_pose")
        pose, is_loaded, balls, boxes = (frames[name][step] for name in names)
        pixels = stage.show(pose, is_loaded, balls, boxes, areas_of(frames, step))
    with atomic_write(out) as part:
        Image.fromarray(pixels).save(part)
    return step
