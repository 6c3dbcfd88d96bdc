"""Names of a run's files and of the arrays in them, and the constants of a recorded world."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

# Names of the files of a run.
RESULT = "result.json"
TRAJECTORY = "trajectory.npz"
RECORDING = "clean.rrd"
"""Name of the recording of a task that counts deliveries, such as cleaning."""
OTHER_RECORDING = "run.rrd"
"""Name of the recording of any other task."""

ABOUT = "about"
"""Array of a trajectory that holds version, settings, genome and configuration as JSON."""

# Prefixes of arrays of a trajectory.
AREA = "area_"
"""Prefix of the areas on the floor that a task adds."""
METRIC = "metric_"
"""Prefix of the metrics that a task adds."""
SCENE = "scene_"
"""Prefix of the fields of `Scene`."""

Arrays = Mapping[str, np.ndarray]
"""Arrays of a trajectory by name: fields of `Frames`, and fields of `Scene` with their prefix."""


class Scene(NamedTuple):
    """Constants of one world with N robots, K balls and A dust areas. SI units throughout.

    Rectangles are x_min, y_min, x_max, y_max.
    """

    robot_size: Float[np.ndarray, "N 3"]
    """Length, width and height of each robot [m]."""
    is_scout: Bool[np.ndarray, "N"]
    ball_radius: Float[np.ndarray, "K"]
    """Radius of each ball [m]."""
    arena_size: float
    """Edge of the arena, or of the square around its `corners`, centred on the origin [m]."""
    dump: Float[np.ndarray, "4"]
    """Rectangle of the dump [m]; of no size where the task has no dump."""
    dust_areas: Float[np.ndarray, "A 4"]
    """Rectangles of the dust areas [m]."""
    control_period: float
    """Time between two frames [s]."""
    is_alive: Bool[np.ndarray, "N"]
    """Robots that work at the start; a dead robot is only an obstacle."""
    payload: str
    """Fields of messages in JSON; with it and `n_leds`, `message_columns` decodes messages."""
    world: int
    """Number of the world in its run."""
    n_leds: int
    """Number of LEDs of a robot, which decides the layout of messages."""
    kind: Int[np.ndarray, "N"]
    """Index of each robot's kind in `Robots.kinds`."""
    memory_names: tuple[str, ...] = ()
    """Names of the recorded parts of the robots' memory, see `Frames.memory`."""
    memory_units: tuple[str, ...] = ()
    """Unit of each part; empty where the strategy states none."""
    memory_sizes: tuple[int, ...] = ()
    """Number of values that each part has for a robot."""
    area_names: tuple[str, ...] = ()
    """Names of the areas that the task adds, see `Frames.task`."""
    area_colours: tuple[tuple[int, int, int], ...] = ()
    """Red, green and blue of each of these areas."""
    area_shapes: tuple[str, ...] = ()
    """Shape of each of these areas, "square" or "disc"."""
    metric_names: tuple[str, ...] = ()
    """Names of the metrics that the task adds, see `Frames.task`."""
    metric_units: tuple[str, ...] = ()
    """Unit of each metric; empty for numbers without one."""
    metric_descriptions: tuple[str, ...] = ()
    """Description of each metric."""
    obstacles: Float[np.ndarray, "O 5"] = np.zeros((0, 5))
    """Fixed boxes in the arena: x, y, half edges [m], yaw [rad]."""
    boxes: Float[np.ndarray, "M 4"] = np.zeros((0, 4))
    """Half edges [m], mass [kg] and friction of the boxes that robots push."""
    corners: Float[np.ndarray, "C 2"] = np.zeros((0, 2))
    """Corners of the arena, anticlockwise [m]; none for a square arena."""
    team_names: tuple[str, ...] = ()
    """Names of the robots' teams, see `strategy.teams`; none without teams."""
    team_sizes: tuple[int, ...] = ()
    """Number of robots of each team."""

    @property
    def length(self) -> float:
        """Length of the longest robots [m]."""
        return float(np.max(self.robot_size[..., 0]))

    @property
    def height(self) -> float:
        """Height of the robots, which all kinds share [m]."""
        return float(np.max(self.robot_size[..., 2]))

    @property
    def team(self) -> Int[np.ndarray, "N"]:
        """Number of each robot's team; 0 without teams."""
        sizes = self.team_sizes or (len(self.is_scout),)
        return np.repeat(np.arange(len(sizes)), sizes)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return the fields as arrays by their names in a trajectory."""
        return {SCENE + name: np.asarray(value) for name, value in self._asdict().items()}

    @property
    def memory(self) -> list[tuple[str, str, int]]:
        """Name, unit and size (numbers a robot) of each recorded part of the robots' memory."""
        return list(zip(self.memory_names, self.memory_units, self.memory_sizes, strict=True))
