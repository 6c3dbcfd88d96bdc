"""What a run leaves behind: the scene once, and frames along time."""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

RESULT, TRAJECTORY, RECORDING = "result.json", "trajectory.npz", "clean.rrd"
"""Names of a run's files."""


class Scene(NamedTuple):
    """What does not change during the run of one world. SI units throughout."""

    robot_size: np.ndarray
    """(3,) edge lengths of a robot [m]."""
    is_scout: np.ndarray
    """(N,) bool."""
    ball_radius: np.ndarray
    """(K,) radii of the balls [m]."""
    arena_size: float
    """Edge length of the square arena, which is centred on the origin [m]."""
    dump: np.ndarray
    """(4,) rectangle x_min, y_min, x_max, y_max [m]."""
    dust_areas: np.ndarray
    """(A, 4) rectangles, as for the dump [m]."""
    control_period: float
    """Time between two frames [s]."""


@dataclass(frozen=True)
class Frames:
    """T consecutive frames of one world with N robots and K balls. SI units throughout.

    Frame 0 is the start; frame t is the state after control step t.
    """

    step: np.ndarray
    """(T,) int32, control step."""
    pose: np.ndarray
    """(T, N, 3) float32: x [m], y [m], yaw [rad, counted from the x axis, not wrapped]."""
    is_loaded: np.ndarray
    """(T, N) bool."""
    has_priority: np.ndarray
    """(T, N) bool: the robot sends the priority flag."""
    ball_position: np.ndarray
    """(T, K, 3) float32: the balls' centres [m]."""
    ball_state: np.ndarray
    """(T, K) uint8: 0 on the floor, 1 held, 2 delivered."""
    link_sender: np.ndarray
    """(T, N, S) int16: whom photodiode sector s of a robot hears; meaningless where not `link_valid`."""
    link_valid: np.ndarray
    """(T, N, S) bool."""
    dust_vector: np.ndarray
    """(T, N, 2) float32: remembered vector to dust, in the robot's own frame (x ahead, y left) [m]."""
    dust_known: np.ndarray
    """(T, N) bool: the memory holds a vector to dust."""
    dump_vector: np.ndarray
    """(T, N, 2) float32: remembered vector to the dump [m]."""
    dump_known: np.ndarray
    """(T, N) bool."""
    delivered: np.ndarray
    """(T,) int32, balls delivered so far."""
    picked: np.ndarray
    """(T,) int32, balls picked up so far."""
    collisions: np.ndarray
    """(T,) int32, collisions so far."""
    mean_speed: np.ndarray
    """(T,) float32, mean distance moved per control step over the robots, per second [m/s]."""

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.step)

    @staticmethod
    def concatenate(blocks: "list[Frames]") -> "Frames":
        """Join blocks along time."""
        return Frames(**{f.name: np.concatenate([getattr(b, f.name) for b in blocks]) for f in fields(Frames)})
