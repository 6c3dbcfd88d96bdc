"""Records of a run: the constants of a world, and its frames over time."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8, UInt32

RESULT, TRAJECTORY, RECORDING = "result.json", "trajectory.npz", "clean.rrd"
"""Names of the files of a run."""
OTHER_RECORDING = "run.rrd"
"""Name of the recording of another task than cleaning."""
ABOUT = "about"
"""Of a trajectory's arrays, the one that holds version, settings, genome and configuration as JSON."""
AREA, METRIC = "area_", "metric_"
"""Of the names of arrays that a task adds: its areas on the floor and its metrics."""


class Scene(NamedTuple):
    """Constants of one world with N robots, K balls and A dust areas. SI units throughout.

    Rectangles are x_min, y_min, x_max, y_max.
    """

    robot_size: Float[np.ndarray, "3"]
    """Edges of a robot [m]."""
    is_scout: Bool[np.ndarray, "N"]
    ball_radius: Float[np.ndarray, "K"]
    """[m]"""
    arena_size: float
    """Edge of the square arena, which is centred on the origin [m]."""
    dump: Float[np.ndarray, "4"]
    """Rectangle [m]; of no size where the task has no dump."""
    dust_areas: Float[np.ndarray, "A 4"]
    """Rectangles [m]."""
    control_period: float
    """Time between two frames [s]."""
    is_alive: Bool[np.ndarray, "N"]
    """The others are dead: they only stand in the way."""
    payload: str
    """What messages carry, in JSON; with it and `n_leds`, `output.said` reads the frames' messages."""
    world: int
    """Number of the world in its run."""
    n_leds: int
    """LEDs of a robot, which decide the layout of messages."""
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

    @property
    def arrows(self) -> list[str]:
        """Names of the recorded vectors [m] of the plane, in the robots' own frames."""
        each = zip(self.memory_names, self.memory_units, self.memory_sizes, strict=True)
        return [name for name, unit, size in each if (unit, size) == ("m", 2)]


def _stored(dtype: type, *units: str) -> dict[str, Any]:
    """Metadata of a field: the dtype of its arrays, and their unit, or one for each entry of the last axis."""
    return {"dtype": dtype, "units": units}


@dataclass(frozen=True)
class Frames:
    """T consecutive frames of one world with N robots, of S photodiode sectors, and K balls. SI units throughout.

    Frame 0 is the start; frame t is the state after control step t. The metadata of each field has the `dtype` and the
    `units` of its arrays.
    """

    step: Int[np.ndarray, "T"] = field(metadata=_stored(np.int32))
    """Control step."""
    is_running: Bool[np.ndarray, "T"] = field(metadata=_stored(np.bool_))
    """The world took this step; false once it is finished or faulty."""
    pose: Float[np.ndarray, "T N 3"] = field(metadata=_stored(np.float32, "m", "m", "rad"))
    """x, y, and yaw, counted from the x axis and not wrapped."""
    is_loaded: Bool[np.ndarray, "T N"] = field(metadata=_stored(np.bool_))
    has_priority: Bool[np.ndarray, "T N"] = field(metadata=_stored(np.bool_))
    """Whether the robot sends the flag `priority`; nobody does where messages have none."""
    message: UInt32[np.ndarray, "T N"] = field(metadata=_stored(np.uint32))
    """The 32 bits that the robot's first LED sent as the step began; those of its other LEDs differ in number and
    check. No meaning in frame 0, where the world did not take the step, and for dead robots."""
    command: Float[np.ndarray, "T N 2"] = field(metadata=_stored(np.float32, "rad", "m"))
    """Turn and distance ahead that the drive carried out in the step, within its limits and with its errors."""
    ball_position: Float[np.ndarray, "T K 3"] = field(metadata=_stored(np.float32, "m"))
    """Centres of the balls."""
    ball_state: UInt8[np.ndarray, "T K"] = field(metadata=_stored(np.uint8))
    """0 on the floor, 1 held, 2 delivered."""
    ball_holder: Int[np.ndarray, "T K"] = field(metadata=_stored(np.int16))
    """The robot that holds the ball, or the last one that did."""
    link_sender: Int[np.ndarray, "T N S"] = field(metadata=_stored(np.int16))
    """The robot that photodiode sector s receives; meaningless where not `link_valid`."""
    link_valid: Bool[np.ndarray, "T N S"] = field(metadata=_stored(np.bool_))
    link_led: UInt8[np.ndarray, "T N S"] = field(metadata=_stored(np.uint8))
    """The sender's LED; like what follows, no meaning where not `link_valid`."""
    link_bearing: Float[np.ndarray, "T N S"] = field(metadata=_stored(np.float32, "rad"))
    """Measured direction of the sender in the receiver's frame."""
    link_distance: Float[np.ndarray, "T N S"] = field(metadata=_stored(np.float32, "m"))
    """Distance of the sender, as the receiver measured it."""
    link_heard: Bool[np.ndarray, "T N S"] = field(metadata=_stored(np.bool_))
    """The sender's message arrived, and its check is right, if that is looked at."""
    delivered: Int[np.ndarray, "T"] = field(metadata=_stored(np.int32))
    """Balls delivered so far."""
    picked: Int[np.ndarray, "T"] = field(metadata=_stored(np.int32))
    """Balls picked up so far."""
    collisions: Int[np.ndarray, "T"] = field(metadata=_stored(np.int32))
    """Collisions so far."""
    mean_speed: Float[np.ndarray, "T"] = field(metadata=_stored(np.float32, "m/s"))
    """Distance moved in the control step over its duration, averaged over the robots."""
    memory: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Arrays (T, N, ...) of what the strategy wants recorded of its memory (`strategy.declared`), lengths in m.

    Those of the paper's strategy are `dust_vector`, the remembered vector to the dust in the robot's own frame (x
    ahead, y left), `dust_known`, whether there is one, and `dust_hop`, its hop count; likewise for the dump.
    """
    task: Mapping[str, np.ndarray] = field(default_factory=dict)
    """What the task adds: `area_NAME` (T, M, 3), x, y and half the width, or the radius, of M areas [m], and
    `metric_NAME` (T,). Cleaning adds nothing: its metrics are `delivered` and `picked`."""

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.step)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all arrays by their names, those of memory and task included."""
        return {name: getattr(self, name) for name in ARRAYS} | dict(self.memory) | dict(self.task)

    def __getitem__(self, steps: slice) -> "Frames":
        """Return some of the frames."""
        return _frames({name: array[steps] for name, array in self.arrays().items()})

    @staticmethod
    def concatenate(blocks: "list[Frames]") -> "Frames":
        """Join blocks along time."""
        each = [block.arrays() for block in blocks]
        return _frames({name: np.concatenate([arrays[name] for arrays in each]) for name in each[0]})


ARRAYS = tuple(f.name for f in fields(Frames) if f.name not in ("memory", "task"))
"""Names of the arrays that all trajectories have."""


def _frames(arrays: Mapping[str, np.ndarray]) -> Frames:
    """Frames of these arrays, of which those with other names are the memory's or the task's."""
    task = {name: array for name, array in arrays.items() if name.startswith((AREA, METRIC))}
    memory = {name: array for name, array in arrays.items() if name not in ARRAYS and name not in task}
    return Frames(**{name: arrays[name] for name in ARRAYS}, memory=memory, task=task)
