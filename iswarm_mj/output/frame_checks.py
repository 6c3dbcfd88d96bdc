"""What a block of frames must be for the viewer to draw it."""

from typing import Any

import numpy as np

from iswarm_mj.output import rerun_swarm_view as look
from iswarm_mj.output.remembered import is_known
from iswarm_mj.output.trajectory import Frames, Scene
from iswarm_mj.utils.errors import SimulationFault


def check_frames(scene: Scene, frames: Frames, last_step: int) -> None:
    """Refuse values that the viewer would silently draw wrong.

    Args:
        scene: constants of the run.
        frames: at least one.
        last_step: that of the latest block, -1 before the first one.

    Raises:
        SimulationFault: a pose, a ball or a known vector is not finite.
        ValueError: steps do not increase.
    """
    steps = np.diff(frames.step, prepend=last_step)
    if np.any(steps <= 0):
        raise ValueError(f"Steps must increase: {frames.step[0]}..{frames.step[-1]} after {last_step}.")
    everything: dict[str, tuple[str, Any]] = {
        "pose": ("robots", ~np.isfinite(frames.pose).all(-1)),
        "position": ("balls", ~np.isfinite(frames.ball_position).all(-1)),
    }
    for name in scene.arrows:
        is_finite = np.isfinite(frames.memory[name]).all(axis=-1)
        everything[look.title(name)] = ("robots", np.logical_and(is_known(frames, name), ~is_finite))
    for name, (kind, is_bad) in everything.items():
        if is_bad.any():
            t = int(np.argmax(is_bad.any(axis=1)))
            which = ", ".join(map(str, np.flatnonzero(is_bad[t])[:10]))
            raise SimulationFault(f"Step {frames.step[t]}: the {name} of {kind} {which} is not finite.")
