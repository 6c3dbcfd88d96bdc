"""The recorded world of a run, as pictures and videos read it from the run's directory."""

import os
import sys
from pathlib import Path

import numpy as np

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.output.reading import REMEDY, no_trajectory, read_result, read_trajectory
from iswarm_mj.output.trajectory import RESULT, TRAJECTORY
from iswarm_mj.utils.errors import UserError

_DRAWN = ("pose", "is_loaded", "ball_position", "delivered", "scene_is_scout", "scene_ball_radius")
"""Arrays that pictures and videos need beside the steps."""


def load(directory: Path) -> tuple[SwarmConfig, dict[str, np.ndarray]]:
    """Return the configuration of the arena and the arrays of the trajectory of a recorded run.

    If the run was interrupted, this says so on the standard error.

    Raises:
        UserError: the directory holds no recorded run, or a damaged one.
    """
    result = read_result(directory / RESULT)
    try:
        config = SwarmConfig(arena=ArenaConfig(**result["config"]["arena"]))
    except (KeyError, TypeError, UserError) as error:
        raise UserError(f"{directory / RESULT} states no arena ({error}); {REMEDY}.") from None
    if not os.path.lexists(directory / TRAJECTORY):
        raise no_trajectory(directory, result)
    frames = read_trajectory(directory / TRAJECTORY)
    _check_drawn(directory / TRAJECTORY, frames)
    if result.get("interrupted"):
        print(f"iswarm: the run in {directory} was interrupted after step {frames['step'][-1]}.", file=sys.stderr)
    return config, frames


def robot_file_of(directory: Path) -> Path | None:
    """Return the MJCF file of the robots of a recorded run, which `load` has read; None for `models/robot.xml`."""
    robot = read_result(directory / RESULT).get("robot")
    file = robot.get("file") if isinstance(robot, dict) else None
    return Path(file) if isinstance(file, str) else None


def _check_drawn(path: Path, frames: dict[str, np.ndarray]) -> None:
    """Refuse a trajectory without steps, and one that lacks or garbles what is drawn."""
    steps = frames["step"]
    if not len(steps) or not np.array_equal(steps, np.arange(len(steps))):
        raise UserError(f"{path} has no steps that count from 0; {REMEDY}.")
    for name in _DRAWN:
        if name not in frames:
            raise UserError(f"{path} has no array `{name}`, which pictures need; {REMEDY}.")
        if frames[name].dtype.kind not in "biuf" or not np.isfinite(frames[name]).all():
            raise UserError(f"{path}: `{name}` does not hold finite numbers; {REMEDY}.")
