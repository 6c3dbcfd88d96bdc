"""The recorded world of a run, as pictures and videos read it from the run's directory."""

import json
import sys
from pathlib import Path

import numpy as np

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.output.trajectory import RESULT, TRAJECTORY
from iswarm_mj.utils.errors import UserError

LARGEST_RESULT = 2**28
"""Size up to which a result.json is read [bytes]."""
_SHAPES = {
    "step": "T",
    "pose": "TN3",
    "is_loaded": "TN",
    "ball_position": "TK3",
    "delivered": "T",
    "scene_is_scout": "N",
    "scene_ball_radius": "K",
}
"""Arrays that pictures and videos need, which are checked, with T steps, N robots and K balls."""


def load(directory: Path) -> tuple[SwarmConfig, dict[str, np.ndarray]]:
    """Return the configuration of the arena and the arrays of the trajectory of a recorded run.

    If the run was interrupted, this says so on the standard error.

    Raises:
        UserError: the directory holds no recorded run, or a damaged one.
    """
    try:
        result = _result(directory / RESULT)
        config = SwarmConfig(arena=ArenaConfig(**result["config"]["arena"]))
        frames = _frames(directory / TRAJECTORY)
    except Exception as error:  # bytes that another program wrote may break each part of the readers
        reason = " ".join(str(error).split()) or type(error).__name__
        raise UserError(
            f"{directory} holds no readable {RESULT} with {TRAJECTORY} ({reason}); "
            "give the --out of a run that `iswarm clean` recorded."
        ) from None
    if result.get("interrupted"):
        print(f"iswarm: the run in {directory} was interrupted after step {frames['step'][-1]}.", file=sys.stderr)
    return config, frames


def robot_file_of(directory: Path) -> Path | None:
    """Return the MJCF file of the robots of a recorded run, which `load` has read; None for `models/robot.xml`."""
    robot = _result(directory / RESULT).get("robot")
    file = robot.get("file") if isinstance(robot, dict) else None
    return Path(file) if isinstance(file, str) else None


def _result(path: Path) -> dict:
    check_file(path)
    if path.stat().st_size > LARGEST_RESULT:
        raise ValueError(f"{path.name} has more than {LARGEST_RESULT} bytes")
    return json.loads(path.read_text(encoding="utf-8"))


def _frames(path: Path) -> dict[str, np.ndarray]:
    check_file(path)
    with np.load(path, allow_pickle=False) as file:
        frames = dict(file)
    sizes = dict(zip("TNK3", (*frames["pose"].shape[:2], len(frames["scene_ball_radius"]), 3), strict=True))
    for name, axes in _SHAPES.items():
        shape = tuple(sizes[axis] for axis in axes)
        if frames[name].shape != shape or frames[name].dtype.kind not in "biuf":
            raise ValueError(f"{name} must have numbers of shape {shape}, has {frames[name].shape}")
        if not np.isfinite(frames[name]).all():
            raise ValueError(f"{name} has numbers that are not finite")
    if not np.array_equal(frames["step"], np.arange(sizes["T"])) or not sizes["T"]:
        raise ValueError("its steps do not count from 0")
    return frames


def check_file(path: Path) -> None:
    """Raise an OSError if the path is something that may never end, such as a pipe or a device."""
    if path.exists() and not path.is_file():
        raise OSError(f"{path.name} is no file")
