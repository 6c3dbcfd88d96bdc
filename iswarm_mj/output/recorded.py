"""The recorded world of a run, as pictures and videos read it from the run's directory."""

import os
import sys
from pathlib import Path

import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.output.reading import REMEDY, no_trajectory, read_result, read_trajectory
from iswarm_mj.output.trajectory import RESULT, TRAJECTORY
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.serialization import restored

_DRAWN = ("pose", "ball_position", "scene_ball_radius", "scene_robot_size")
"""Numbers of pictures and videos."""


def load(directory: Path) -> tuple[SwarmConfig, dict[str, np.ndarray]]:
    """Return the configuration and the arrays of the trajectory of a recorded run.

    If the run was interrupted, this says so on the standard error.

    Raises:
        UserError: the directory holds no recorded run, or a damaged one.
    """
    result, path = read_result(directory / RESULT), directory / TRAJECTORY
    try:
        config = restored(SwarmConfig, result["config"])
    except (KeyError, TypeError, AttributeError, ValueError, UserError) as error:
        raise UserError(f"{directory / RESULT} states no configuration ({error}); {REMEDY}.") from None
    if not os.path.lexists(path):
        raise no_trajectory(directory, result)
    frames = read_trajectory(path)
    steps = frames["step"]
    if not len(steps) or not np.array_equal(steps, np.arange(len(steps))):
        raise UserError(f"{path} has no steps that count from 0; {REMEDY}.")
    for name in _DRAWN:
        if not np.isfinite(frames[name]).all():
            raise UserError(f"{path}: `{name}` does not hold finite numbers; {REMEDY}.")
    if result.get("interrupted"):
        print(f"iswarm: the run in {directory} was interrupted after step {steps[-1]}.", file=sys.stderr)
    return config, frames


def robot_file_of(directory: Path) -> Path | None:
    """Return the MJCF file of the robots of a recorded run, which `load` has read; None for `models/robot.xml`."""
    robot = read_result(directory / RESULT).get("robot")
    file = robot.get("file") if isinstance(robot, dict) else None
    return Path(file) if isinstance(file, str) else None
