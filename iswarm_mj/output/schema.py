"""The schema of a recorded world: each quantity once, with its type, unit and meaning, and how a step record gives it.

Trajectories, the tables of `iswarm_mj.load`, the numbers in recordings and docs/files.md follow from it: a field of
`Frames` is all that a new quantity needs.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from operator import attrgetter
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Int32, Shaped, UInt8, UInt32

from iswarm_mj.output.trajectory import AREA, METRIC, Arrays
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import MM

if TYPE_CHECKING:
    from iswarm_mj.gripper.handling import Balls
    from iswarm_mj.simulation.state import StepRecord

LYING, HELD, DELIVERED = 0, 1, 2
"""States of a ball."""

ROBOTS, BALLS, LINKS = "world/robots/body", "world/balls/true_size", "world/links"
"""Entities of recordings that show quantities of single robots, balls and links."""
IN_FILES = {"mm": ("m", MM), "mm/s": ("m/s", MM)}
"""Units of the model, what they become in files, and the factor."""


class Observed(NamedTuple):
    """What the getters of `Frames` see: T steps of one world with K balls."""

    record: "StepRecord"
    balls: "Balls"
    """(T, K); no balls where the task has none."""
    ball_centres: Float[np.ndarray, "T K 3"]
    """After each step [mm]."""


class Column(NamedTuple):
    """A column of a table."""

    name: str
    unit: str = ""
    """Empty for numbers without one, and for what is no number."""
    description: str = ""
    known: Callable[[Arrays], Bool[np.ndarray, "..."]] | None = None
    """Where the trajectory has a value, an array that broadcasts; by default everywhere."""
    words: tuple[str, ...] = ()
    """Names of the values 0, 1, ... of an enumeration."""
    shown: str = ""
    """Entity of recordings that shows it: a time series, or `ROBOTS`, `BALLS` or `LINKS` where one is selected."""


def took_step(arrays: Arrays) -> Bool[np.ndarray, "T"]:
    """Which frames are after a step of the world: not the start, nor those after its end."""
    return (arrays["step"] > 0) & arrays["is_running"]


def acted(arrays: Arrays) -> Bool[np.ndarray, "T 1"]:
    """`took_step` for all robots."""
    return took_step(arrays)[:, None]


def spoke(arrays: Arrays) -> Bool[np.ndarray, "T N"]:
    """Which robots sent messages; the dead keep silent."""
    return acted(arrays) & arrays["is_alive"]


SCENE_COLUMNS = {
    "is_scout": Column("is_scout", "", "it scouts"),
    "ball_radius": Column("radius", "m", "of the ball"),
}
"""Constants of robots and balls that tables repeat in each step."""


_PLACE = "of the centre after the step"


def quantity(get: str | Callable[[Observed], Shaped[Array, "..."]], *columns: Column) -> Any:
    """Return a field of `Frames`, whose annotation has its type and its axes.

    Args:
        get: its values in arena units, where lengths are in mm; the name of a part of `Observed`, or a function.
        columns: of the tables; of arrays with a last axis of numbers, one for each.
    """
    return field(metadata={"get": attrgetter(get) if isinstance(get, str) else get, "columns": columns})


def _ball_state(seen: Observed) -> Int[np.ndarray, "T K"]:
    return np.where(seen.balls.is_held, HELD, np.where(seen.balls.is_delivered, DELIVERED, LYING))


@dataclass(frozen=True)
class Frames:
    """T consecutive frames of one world with N robots, of S photodiode sectors, K balls and M boxes. SI units
    throughout.

    Frame 0 is the start; frame t is the state after control step t. The axes of a quantity decide its table: T `steps`,
    T N `robots`, T K `balls`, T M `boxes`, T N S `links`.
    """

    step: Int[np.ndarray, "T"] = quantity("record.step")
    is_running: Bool[np.ndarray, "T"] = quantity(
        "record.is_running", Column("is_running", "", "the world took this step")
    )
    pose: Float[np.ndarray, "T N 3"] = quantity(
        lambda seen: seen.record.poses.astype(np.float32),
        Column("x", "m", f"{_PLACE}; the arena is centred on the origin"),
        Column("y", "m", _PLACE),
        Column("yaw", "rad", "after the step, anticlockwise from the x axis, not wrapped"),
    )
    is_alive: Bool[np.ndarray, "T N"] = quantity(
        "record.swarm.is_alive", Column("is_alive", "", "it moves; a dead robot only stands in the way")
    )
    is_loaded: Bool[np.ndarray, "T N"] = quantity("record.swarm.is_loaded", Column("is_loaded", "", "it holds a ball"))
    has_priority: Bool[np.ndarray, "T N"] = quantity("record.has_priority")
    """Whether the robot sends the flag `priority`; nobody does where messages have none."""
    message: UInt32[np.ndarray, "T N"] = quantity(
        "record.message", Column("message", "", "the 32 bits that its first LED sent", spoke, shown=ROBOTS)
    )
    """As the step began; those of its other LEDs differ in number and check."""
    command: Float[np.ndarray, "T N 2"] = quantity(
        lambda seen: np.stack([*seen.record.command], axis=-1),
        Column("turn", "rad", "carried out in the step, anticlockwise", acted, shown=ROBOTS),
        Column("forward", "m", "walked in the step if nothing is in the way", acted, shown=ROBOTS),
    )
    """What the drive carried out, within its limits and with its errors."""
    ball_position: Float[np.ndarray, "T K 3"] = quantity(
        lambda seen: seen.ball_centres.astype(np.float32),
        Column("x", "m", _PLACE),
        Column("y", "m", _PLACE),
        Column("z", "m", f"{_PLACE}, above the floor"),
    )
    ball_state: UInt8[np.ndarray, "T K"] = quantity(
        _ball_state, Column("state", "", "lying, held or delivered", words=("lying", "held", "delivered"))
    )
    ball_holder: Int32[np.ndarray, "T K"] = quantity(
        "balls.holder",
        Column("holder", "", "the robot that holds it", lambda arrays: arrays["ball_state"] == HELD, shown=BALLS),
    )
    """Where no robot holds the ball, the last one that did."""
    box_pose: Float[np.ndarray, "T M 3"] = quantity(
        lambda seen: np.zeros((len(seen.record.poses), 0, 3)) if seen.record.boxes is None else seen.record.boxes,
        Column("x", "m", _PLACE),
        Column("y", "m", _PLACE),
        Column("yaw", "rad", "after the step, anticlockwise from the x axis, not wrapped"),
    )
    link_sender: Int32[np.ndarray, "T N S"] = quantity(
        "record.links.sender", Column("sender", "", "number of the robot that sends", shown=LINKS)
    )
    """Like all of links undefined where not `link_valid`."""
    link_valid: Bool[np.ndarray, "T N S"] = quantity("record.links.valid")
    """Photodiode sector s receives a robot; rows of the table are these alone."""
    link_led: UInt8[np.ndarray, "T N S"] = quantity(
        "record.links.led", Column("led", "", "LED that sends, counted as the sides", shown=LINKS)
    )
    link_bearing: Float[np.ndarray, "T N S"] = quantity(
        "record.links.measured_bearing",
        Column("bearing", "rad", "direction of the sender in the receiver's frame, as measured"),
    )
    link_distance: Float[np.ndarray, "T N S"] = quantity(
        "record.measured_distance", Column("measured_distance", "m", "as the receiver measured it")
    )
    link_heard: Bool[np.ndarray, "T N S"] = quantity(
        "record.is_heard", Column("is_heard", "", "the message arrived undamaged", shown=LINKS)
    )
    """Its check is right, if that is looked at."""
    delivered: Int[np.ndarray, "T"] = quantity(
        lambda seen: seen.balls.is_delivered.sum(axis=1),
        Column("delivered", "", "balls delivered so far", shown="series/balls/delivered"),
    )
    picked: Int[np.ndarray, "T"] = quantity(
        lambda seen: seen.balls.was_picked.sum(axis=1),
        Column("picked", "", "balls picked up so far", shown="series/balls/picked"),
    )
    collisions: Int[np.ndarray, "T"] = quantity(
        "record.collisions", Column("collisions", "", "so far", shown="series/collisions")
    )
    mean_speed: Float[np.ndarray, "T"] = quantity(
        "record.speed", Column("mean_speed", "m/s", "of the robots in the step", shown="series/mean_speed")
    )
    """Distance moved in the control step over its duration, averaged over the robots."""
    memory: Arrays = field(default_factory=dict)
    """Arrays (T, N, ...) of what the strategy wants recorded of its memory (`strategy.declared`), lengths in m.

    Those of the paper's strategy are `dust_vector`, the remembered vector to the dust in the robot's own frame (x
    ahead, y left), `dust_known`, whether there is one, and `dust_hop`, its hop count; also for the dump.
    """
    task: Arrays = field(default_factory=dict)
    """What the task adds: `area_NAME` (T, M, 3), x, y and half the width, or the radius, of M areas [m], and
    `metric_NAME` (T,). Cleaning adds nothing: its metrics are `delivered` and `picked`."""

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.step)

    @staticmethod
    def of(arrays: Arrays) -> "Frames":
        """Frames of these arrays; those with names of their own are the memory's, or with a prefix the task's."""
        task = {name: array for name, array in arrays.items() if name.startswith((AREA, METRIC))}
        memory = {name: array for name, array in arrays.items() if name not in ARRAYS and name not in task}
        return Frames(**{name: arrays[name] for name in ARRAYS}, memory=memory, task=task)

    @staticmethod
    def observed(seen: Observed, memory: Arrays, task: Arrays) -> "Frames":
        """Return the frames of a record, in SI.

        Args:
            seen: steps of one world, in arena units.
            memory: arrays of the robots' memory, in SI.
            task: arrays of the task, in SI.
        """
        return Frames(**{name: _stored(name, seen) for name in ARRAYS}, memory=memory, task=task)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all arrays by their names, those of memory and task included."""
        return {name: getattr(self, name) for name in ARRAYS} | dict(self.memory) | dict(self.task)

    def __getitem__(self, steps: slice) -> "Frames":
        """Return some of the frames."""
        return Frames.of({name: array[steps] for name, array in self.arrays().items()})


ARRAYS = {f.name: f for f in fields(Frames) if "get" in f.metadata}
"""Quantities of trajectories, by their names."""


def _stored(name: str, seen: Observed) -> np.ndarray:
    """Values of a quantity in SI."""
    values, factors = np.asarray(ARRAYS[name].metadata["get"](seen)), dict(IN_FILES.values())
    scale = [factors.get(column.unit, 1.0) for column in columns_of(name)]
    return (values if set(scale) <= {1.0} else values * np.array(scale, values.dtype)).astype(dtype_of(name))


def columns_of(name: str) -> tuple[Column, ...]:
    """Columns of a quantity."""
    return ARRAYS[name].metadata["columns"]


def numbers(arrays: Arrays, name: str, place: int) -> Shaped[np.ndarray, "T *axes"]:
    """Values of a column of a quantity, by its place among those of the quantity."""
    return arrays[name] if len(axes_of(name)) == arrays[name].ndim else arrays[name][..., place]


def dtype_of(name: str) -> np.dtype:
    """Type in which a quantity is stored; numbers without one in their annotation have 32 bits."""
    found = ARRAYS[name].type.dtypes
    return np.dtype(next(kind for kind in ("float32", "int32", *found) if kind in found))


def axes_of(name: str) -> tuple[str, ...]:
    """Axes of a quantity, as ("T", "N"), without a last one of numbers."""
    return tuple(axis for axis in ARRAYS[name].type.dim_str.split() if not axis.isdigit())
