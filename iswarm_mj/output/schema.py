"""The schema of a recorded world: each quantity once, with its type, unit, meaning and source.

Trajectories, the tables of `iswarm_mj.load`, the numbers in recordings and docs/files.md follow
from it: a field of `Frames` is all that a new quantity needs.
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

# States of a ball.
LYING = 0
HELD = 1
DELIVERED = 2
BALL_STATES = ("lying", "held", "delivered")
"""Names of the states of a ball, in the order of their numbers."""

# Entities of recordings that show quantities of single robots, balls and links.
ROBOTS = "world/robots/body"
BALLS = "world/balls/true_size"
LINKS = "world/links"

FILE_UNITS = {"mm": ("m", MM), "mm/s": ("m/s", MM)}
"""Unit in files, and the factor to it, for each unit of the model that files do not use."""


class Observed(NamedTuple):
    """T steps of one world with K balls, from which the getters of `Frames` take quantities."""

    record: "StepRecord"
    balls: "Balls"
    """The balls (T, K); no balls where the task has none."""
    ball_centres: Float[np.ndarray, "T K 3"]
    """Centres of the balls after each step [mm]."""


class Column(NamedTuple):
    """A column of a table."""

    name: str
    unit: str = ""
    """Unit of the values; empty for numbers without one, and for values that are no numbers."""
    description: str = ""
    known: Callable[[Arrays], Bool[np.ndarray, "..."]] | None = None
    """Mask of the values that exist, which broadcasts to them; None if all do."""
    words: tuple[str, ...] = ()
    """Names of the values 0, 1, ... of an enumeration."""
    shown: str = ""
    """Entity of recordings that shows the column.

    It is a time series, or `ROBOTS`, `BALLS` or `LINKS`, which show it where one is selected.
    """


def took_step(arrays: Arrays) -> Bool[np.ndarray, "T"]:
    """Return which frames are after a step of the world: not the start, nor those after its end."""
    return (arrays["step"] > 0) & arrays["is_running"]


def acted(arrays: Arrays) -> Bool[np.ndarray, "T 1"]:
    """Return `took_step` as a mask of all robots."""
    return took_step(arrays)[:, None]


def spoke(arrays: Arrays) -> Bool[np.ndarray, "T N"]:
    """Return which robots sent messages; dead robots are silent."""
    return acted(arrays) & arrays["is_alive"]


SCENE_COLUMNS = {
    "is_scout": Column("is_scout", description="the robot is a scout"),
    "ball_radius": Column("radius", "m", "radius of the ball"),
}
"""Columns with constants of robots and balls, which tables repeat in each step."""


_CENTRE = "position of the centre after the step"
_YAW = "heading after the step, anticlockwise from the x axis, not wrapped"


def quantity(get: str | Callable[[Observed], Shaped[Array, "..."]], *columns: Column) -> Any:
    """Return a field of `Frames`, whose annotation states its type and axes.

    Args:
        get: the values in arena units, where lengths are in mm: path of an attribute of `Observed`,
            or a function.
        columns: columns of the tables, one for each number along a last axis of numbers.
    """
    getter = attrgetter(get) if isinstance(get, str) else get
    return field(metadata={"get": getter, "columns": columns})


def _ball_state(observed: Observed) -> Int[np.ndarray, "T K"]:
    """Return the state of each ball."""
    on_floor = np.where(observed.balls.is_delivered, DELIVERED, LYING)
    return np.where(observed.balls.is_held, HELD, on_floor)


def _box_pose(observed: Observed) -> Any:
    """Return the poses of the boxes, (T, 0, 3) without boxes."""
    boxes = observed.record.boxes
    if boxes is None:
        return np.zeros((len(observed.record.poses), 0, 3))
    return boxes


@dataclass(frozen=True)
class Frames:
    """T consecutive frames of one world with N robots, S photodiode sectors, K balls and M boxes.

    All quantities are in SI units. Frame 0 is the start; frame t is the state after control step t.
    The axes of a quantity decide its table: T `steps`, T N `robots`, T K `balls`, T M `boxes`,
    T N S `links`.
    """

    step: Int[np.ndarray, "T"] = quantity("record.step")
    is_running: Bool[np.ndarray, "T"] = quantity(
        "record.is_running",
        Column("is_running", description="the world took this step"),
    )
    pose: Float[np.ndarray, "T N 3"] = quantity(
        lambda observed: observed.record.poses.astype(np.float32),
        Column("x", "m", f"{_CENTRE}; the arena is centred on the origin"),
        Column("y", "m", _CENTRE),
        Column("yaw", "rad", _YAW),
    )
    is_alive: Bool[np.ndarray, "T N"] = quantity(
        "record.swarm.is_alive",
        Column("is_alive", description="the robot works; a dead robot is only an obstacle"),
    )
    is_loaded: Bool[np.ndarray, "T N"] = quantity(
        "record.swarm.is_loaded",
        Column("is_loaded", description="the robot holds a ball"),
    )
    has_priority: Bool[np.ndarray, "T N"] = quantity("record.has_priority")
    """The robot sends the flag `priority`; nobody does where messages have none."""
    message: UInt32[np.ndarray, "T N"] = quantity(
        "record.message",
        Column(
            "message",
            description="the 32 bits that the robot's first LED sent",
            known=spoke,
            shown=ROBOTS,
        ),
    )
    """Message sent as the step began; those of the other LEDs differ in number and check."""
    command: Float[np.ndarray, "T N 2"] = quantity(
        lambda observed: np.stack([*observed.record.command], axis=-1),
        Column(
            "turn",
            "rad",
            "turn carried out in the step, anticlockwise",
            known=acted,
            shown=ROBOTS,
        ),
        Column(
            "forward",
            "m",
            "distance walked in the step if nothing is in the way",
            known=acted,
            shown=ROBOTS,
        ),
    )
    """Turn and walk that the drive carried out, within its limits and with its errors."""
    ball_position: Float[np.ndarray, "T K 3"] = quantity(
        lambda observed: observed.ball_centres.astype(np.float32),
        Column("x", "m", _CENTRE),
        Column("y", "m", _CENTRE),
        Column("z", "m", f"{_CENTRE}, above the floor"),
    )
    ball_state: UInt8[np.ndarray, "T K"] = quantity(
        _ball_state,
        Column("state", description="lying, held or delivered", words=BALL_STATES),
    )
    ball_holder: Int32[np.ndarray, "T K"] = quantity(
        "balls.holder",
        Column(
            "holder",
            description="number of the robot that holds the ball",
            known=lambda arrays: arrays["ball_state"] == HELD,
            shown=BALLS,
        ),
    )
    """Number of the robot that holds the ball or, where no robot does, of the last one that did."""
    box_pose: Float[np.ndarray, "T M 3"] = quantity(
        _box_pose,
        Column("x", "m", _CENTRE),
        Column("y", "m", _CENTRE),
        Column("yaw", "rad", _YAW),
    )
    link_sender: Int32[np.ndarray, "T N S"] = quantity(
        "record.links.sender",
        Column("sender", description="number of the robot that sends", shown=LINKS),
    )
    """Number of the sender; like all quantities of links undefined where not `link_valid`."""
    link_valid: Bool[np.ndarray, "T N S"] = quantity("record.links.valid")
    """Photodiode sector s receives a robot; only these links are rows of the table."""
    link_led: UInt8[np.ndarray, "T N S"] = quantity(
        "record.links.led",
        Column("led", description="LED that sends, numbered like the sides", shown=LINKS),
    )
    link_bearing: Float[np.ndarray, "T N S"] = quantity(
        "record.links.measured_bearing",
        Column("bearing", "rad", "measured direction of the sender in the receiver's frame"),
    )
    link_distance: Float[np.ndarray, "T N S"] = quantity(
        "record.measured_distance",
        Column("measured_distance", "m", "distance of the sender as the receiver measured it"),
    )
    link_heard: Bool[np.ndarray, "T N S"] = quantity(
        "record.is_heard",
        Column("is_heard", description="the message arrived undamaged", shown=LINKS),
    )
    """The check of the message is right, or receivers ignore it."""
    delivered: Int[np.ndarray, "T"] = quantity(
        lambda observed: observed.balls.is_delivered.sum(axis=1),
        Column(
            "delivered",
            description="balls delivered so far",
            shown="series/balls/delivered",
        ),
    )
    picked: Int[np.ndarray, "T"] = quantity(
        lambda observed: observed.balls.was_picked.sum(axis=1),
        Column(
            "picked",
            description="balls picked up so far",
            shown="series/balls/picked",
        ),
    )
    collisions: Int[np.ndarray, "T"] = quantity(
        "record.collisions",
        Column("collisions", description="collisions so far", shown="series/collisions"),
    )
    mean_speed: Float[np.ndarray, "T"] = quantity(
        "record.speed",
        Column("mean_speed", "m/s", "mean speed of the robots", shown="series/mean_speed"),
    )
    """Distance moved in the control step over its duration, averaged over the robots."""
    memory: Arrays = field(default_factory=dict)
    """Recorded arrays (T, N, ...) of the robots' memory (`strategy.attributes`), lengths in m.

    Those of the paper's strategy are `dust_vector`, the remembered vector to the dust in the
    robot's own frame (x ahead, y left), `dust_known`, the flag of robots that have one, and
    `dust_hop`, its hop count; also for the dump.
    """
    task: Arrays = field(default_factory=dict)
    """Arrays that the task adds: `area_NAME` and `metric_NAME`.

    `area_NAME` (T, M, 3) holds x, y and half the width, or the radius, of M areas [m];
    `metric_NAME` is (T,). Cleaning adds nothing: its metrics are `delivered` and `picked`.
    """

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.step)

    @staticmethod
    def from_arrays(arrays: Arrays) -> "Frames":
        """Return the frames that these arrays hold.

        Arrays that are no fields belong to the task if they have one of its prefixes, else to the
        memory.
        """
        memory = {}
        task = {}
        for name, array in arrays.items():
            if name.startswith((AREA, METRIC)):
                task[name] = array
            elif name not in ARRAYS:
                memory[name] = array
        return Frames(**{name: arrays[name] for name in ARRAYS}, memory=memory, task=task)

    @staticmethod
    def from_record(observed: Observed, memory: Arrays, task: Arrays) -> "Frames":
        """Return the frames of a record, in SI.

        Args:
            observed: steps of one world, in arena units.
            memory: arrays of the robots' memory, in SI.
            task: arrays of the task, in SI.
        """
        arrays = {name: _stored(name, observed) for name in ARRAYS}
        return Frames(**arrays, memory=memory, task=task)

    def arrays(self) -> dict[str, np.ndarray]:
        """Return all arrays by their names, those of memory and task included."""
        own_arrays = {name: getattr(self, name) for name in ARRAYS}
        return own_arrays | dict(self.memory) | dict(self.task)

    def __getitem__(self, steps: slice) -> "Frames":
        """Return some of the frames."""
        return Frames.from_arrays({name: array[steps] for name, array in self.arrays().items()})


ARRAYS = {f.name: f for f in fields(Frames) if "get" in f.metadata}
"""Fields of `Frames` that are quantities, by name."""


def _stored(name: str, observed: Observed) -> np.ndarray:
    """Return the values of a quantity in SI and in the type in which it is stored."""
    values = np.asarray(ARRAYS[name].metadata["get"](observed))
    si_factors = dict(FILE_UNITS.values())
    factors = [si_factors.get(column.unit, 1.0) for column in columns_of(name)]
    if any(factor != 1.0 for factor in factors):
        values = values * np.array(factors, values.dtype)
    return values.astype(dtype_of(name))


def columns_of(name: str) -> tuple[Column, ...]:
    """Return the columns of a quantity."""
    return ARRAYS[name].metadata["columns"]


def column_values(arrays: Arrays, name: str, place: int) -> Shaped[np.ndarray, "T *axes"]:
    """Return the values of a column.

    Args:
        arrays: arrays of a trajectory.
        name: the quantity that the column belongs to.
        place: place of the column among those of the quantity.
    """
    has_axis_of_columns = arrays[name].ndim > len(axes_of(name))
    return arrays[name][..., place] if has_axis_of_columns else arrays[name]


def dtype_of(name: str) -> np.dtype:
    """Return the type in which a quantity is stored.

    It has 32 bits where the annotation does not state a size.
    """
    allowed = ARRAYS[name].type.dtypes
    for preferred in ("float32", "int32"):
        if preferred in allowed:
            return np.dtype(preferred)
    return np.dtype(allowed[0])


def axes_of(name: str) -> tuple[str, ...]:
    """Return the axes of a quantity, such as ("T", "N"), without a last axis of numbers."""
    return tuple(axis for axis in ARRAYS[name].type.dim_str.split() if not axis.isdigit())
