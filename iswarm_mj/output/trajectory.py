"""Names of a run's files and of the arrays in them, and the constants of a recorded world."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

RESULT, TRAJECTORY, RECORDING = "result.json", "trajectory.npz", "clean.rrd"
"""Names of the files of a run."""
OTHER_RECORDING = "run.rrd"
"""Name of the recording of another task than cleaning."""
ABOUT = "about"
"""Of a trajectory's arrays, the one that holds version, settings, genome and configuration as JSON."""
AREA, METRIC, SCENE = "area_", "metric_", "scene_"
"""Prefixes of the arrays that a task adds, its areas on the floor and its metrics, and of those of `Scene`."""

Arrays = Mapping[str, np.ndarray]
"""Arrays of a trajectory by their names: `Frames`, and with the prefix scene_ `Scene`."""


class Scene(NamedTuple):
    """Constants of one world with N robots, K balls and A dust areas. SI units throughout.

    Rectangles are x_min, y_min, x_max, y_max.
    """

    robot_size: Float[np.ndarray, "N 3"]
    """Length, width and height of each robot [m]."""
    is_scout: Bool[np.ndarray, "N"]
    ball_radius: Float[np.ndarray, "K"]
    """[m]"""
    arena_size: float
    """Edge of the arena, which is centred on the origin, or of the square around its `corners` [m]."""
    dump: Float[np.ndarray, "4"]
    """Rectangle [m]; of no size where the task has no dump."""
    dust_areas: Float[np.ndarray, "A 4"]
    """Rectangles [m]."""
    control_period: float
    """Time between two frames [s]."""
    is_alive: Bool[np.ndarray, "N"]
    """At the start; the others are dead, they only stand in the way."""
    payload: str
    """What messages carry, in JSON; with it and `n_leds`, `message_columns` decodes the frames' messages."""
    world: int
    """Number of the world in its run."""
    n_leds: int
    """LEDs of a robot, which decide the layout of messages."""
    kind: Int[np.ndarray, "N"]
    """Index of each robot's kind in `Robots.kinds`."""
    memory_names: tuple[str, ...] = ()
    """What is recorded of the robots' memory, see `Frames.memory`."""
    memory_units: tuple[str, ...] = ()
    """Unit of each; empty where the strategy states none."""
    memory_sizes: tuple[int, ...] = ()
    """How many numbers each has for a robot."""
    area_names: tuple[str, ...] = ()
    """Areas on the floor beside dump and dust, see `Frames.task`."""
    area_colours: tuple[tuple[int, int, int], ...] = ()
    """Red, green and blue of each."""
    area_shapes: tuple[str, ...] = ()
    """Whether each is of squares or of discs."""
    metric_names: tuple[str, ...] = ()
    """Metrics of the task, see `Frames.task`."""
    metric_units: tuple[str, ...] = ()
    """Unit of each; empty for numbers without one."""
    metric_descriptions: tuple[str, ...] = ()
    obstacles: Float[np.ndarray, "O 5"] = np.zeros((0, 5))
    """Boxes in the arena: x, y, half edges [m], yaw [rad]."""
    boxes: Float[np.ndarray, "M 4"] = np.zeros((0, 4))
    """Half edges [m], mass [kg] and friction of the boxes that robots push."""
    corners: Float[np.ndarray, "C 2"] = np.zeros((0, 2))
    """Of the arena, anticlockwise [m]; none: of the square."""
    team_names: tuple[str, ...] = ()
    """Teams of the robots, see `strategy.teams`; none where they are one."""
    team_sizes: tuple[int, ...] = ()
    """Number of robots of each."""

    @property
    def length(self) -> float:
        """Of the longest robots [m]."""
        return float(np.max(self.robot_size[..., 0]))

    @property
    def height(self) -> float:
        """Of all robots [m]."""
        return float(np.max(self.robot_size[..., 2]))

    @property
    def team(self) -> Int[np.ndarray, "N"]:
        """Number of each robot's team; 0 without teams."""
        sizes = self.team_sizes or (len(self.is_scout),)
        return np.repeat(np.arange(len(sizes)), sizes)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return its values as arrays by their names in a trajectory."""
        return {SCENE + name: np.asarray(value) for name, value in self._asdict().items()}

    @property
    def memory(self) -> list[tuple[str, str, int]]:
        """Name, unit and number of numbers of what is recorded of the robots' memory."""
        return list(zip(self.memory_names, self.memory_units, self.memory_sizes, strict=True))
