"""Tidy tables of a recorded world: one row a robot, ball, box, link or control step.

Each column states its unit and its description in the metadata of its field.
"""

from collections.abc import Callable, Iterable, Iterator
from operator import itemgetter
from typing import NamedTuple

import numpy as np
import pyarrow as pa
from jaxtyping import Bool, Float, Shaped

from iswarm_mj.output.memory_vectors import RecordedVector, recorded_vectors
from iswarm_mj.output.message_columns import MESSAGE_PREFIX, message_columns
from iswarm_mj.output.schema import (
    ARRAYS,
    SCENE_COLUMNS,
    Column,
    acted,
    axes_of,
    column_values,
    columns_of,
)
from iswarm_mj.output.trajectory import METRIC, SCENE, Arrays, Scene
from iswarm_mj.sensors.messages import PRIORITY

Get = Callable[[Arrays], Shaped[np.ndarray, "..."]]
"""Function from the arrays of a trajectory to values that broadcast to the shape of the table."""
Columns = list[tuple[Column, Get]]


class _Rows(NamedTuple):
    """The rows of a table."""

    array: str
    """Quantity whose axes the table has; of links also the mask of its rows."""
    numbered: dict[str, Column]
    """Column with the number along each axis after that of the steps."""


_ROWS = {
    "robots": _Rows("pose", {"N": Column("robot", description="number of the robot")}),
    "balls": _Rows("ball_position", {"K": Column("ball", description="number of the ball")}),
    "boxes": _Rows("box_pose", {"M": Column("box", description="number of the box")}),
    "links": _Rows(
        "link_valid",
        {
            "N": Column("receiver", description="number of the robot that receives"),
            "S": Column("side", description="side that receives: 0 front, 1 left, 2 back, 3 right"),
        },
    ),
    "steps": _Rows("step", {}),
}
"""The array that defines the axes of each table."""
WORLD = Column("world", description="number of the world")
"""First column of each table."""


def _time(arrays: Arrays) -> Float[np.ndarray, "T"]:
    """Return the time at the end of each step [s]."""
    return arrays["step"] * float(arrays["scene_control_period"])


def _distance(arrays: Arrays) -> Float[np.ndarray, "T N S"]:
    """Return the distances between centres as the step began, where the frame before left them."""
    positions = np.roll(arrays["pose"][..., :2], 1, axis=0)
    sender = np.where(arrays["link_valid"], arrays["link_sender"], 0)
    frame = np.arange(len(positions))[:, None, None]
    offset = positions[frame, sender] - positions[:, :, None]
    return np.hypot(offset[..., 0], offset[..., 1])


_DERIVED: dict[str, Columns] = {
    "steps": [(Column("time", "s", "time at the end of the step"), _time)],
    "links": [
        (Column("distance", "m", "distance between the centres as the step began"), _distance)
    ],
}
"""Columns that are computed from several quantities."""


def _schema_columns(table: str) -> Iterator[tuple[Column, Get]]:
    """Yield the columns that a table has for every strategy and task."""
    name, numbered = _ROWS[table]
    axes = ("T", *numbered)

    # The numbers of rows: step, then robot, ball, box or receiver and side.
    yield Column("step", description="control step, 0 for the start"), _numbers_along(name, 0)
    for axis, column in enumerate(numbered.values(), start=1):
        yield column, _numbers_along(name, axis)

    # The quantities of the schema with the axes of this table.
    for quantity in ARRAYS:
        if axes_of(quantity) == axes:
            for place, column in enumerate(columns_of(quantity)):
                yield column, _quantity_getter(quantity, place)

    # Constants, repeated in each step, and what follows from several quantities.
    for constant, column in SCENE_COLUMNS.items():
        axes_of_constant = (Scene.__annotations__[constant].dim_str,)
        if axes_of_constant == axes[1:]:
            yield column, itemgetter(SCENE + constant)
    yield from _DERIVED.get(table, [])


def _numbers_along(name: str, axis: int) -> Get:
    """Return a getter of the numbers along an axis of an array; steps have their own numbers."""

    def get(arrays: Arrays) -> Shaped[np.ndarray, "..."]:
        array = arrays[name]
        numbers = np.arange(array.shape[axis], dtype=np.int32) if axis else arrays["step"]
        n_axes = len(axes_of(name))
        return numbers.reshape([-1 if k == axis else 1 for k in range(n_axes)])

    return get


def _quantity_getter(quantity: str, place: int) -> Get:
    return lambda arrays: column_values(arrays, quantity, place)


TABLES: dict[str, Columns] = {table: list(_schema_columns(table)) for table in _ROWS}
"""Columns of each table for every strategy and task, after the number of the world."""


def memory_columns(memory: Iterable[tuple[str, str, int]]) -> Columns:
    """Return the columns of the recorded parts of the robots' memory.

    Vectors with a flag have columns for their parts ahead and to the left, which are null where the
    vector is unknown. Any other part has as many columns as numbers, such as `home_0` and `home_1`.

    Args:
        memory: name, unit and size (numbers a robot) of each part.
    """
    memory = list(memory)
    names = {name for name, _, _ in memory}
    vector_of = {}
    for vector in recorded_vectors(memory):
        if vector.known in names:
            vector_of |= dict.fromkeys((vector.name, vector.known, vector.hop), vector)

    columns: Columns = []
    for name, unit, size in memory:
        if name in vector_of:
            columns_of_part = _vector_columns(name, unit, vector_of[name])
        else:
            names_of_numbers = [name] if size == 1 else [f"{name}_{k}" for k in range(size)]
            columns_of_part = [
                Column(name_of_number, unit, "remembered") for name_of_number in names_of_numbers
            ]
        for place, column in enumerate(columns_of_part):
            columns.append((column, _memory_getter(name, place)))
    return columns


def _vector_columns(name: str, unit: str, vector: RecordedVector) -> list[Column]:
    """Return the columns of one of the arrays that belong to a remembered vector.

    Their values are null for robots that do not know the vector. So the array of flags needs no
    column, and has none.

    Args:
        name: name of the array: that of the vectors, of their hop counts or of their flags.
        unit: unit of its numbers.
        vector: names of the three arrays.
    """
    known = itemgetter(vector.known)
    if name == vector.name:
        place = f"of the remembered {vector.stem} vector, in the robot's own frame"
        return [
            Column(f"{vector.stem}_x", unit, f"ahead, {place}", known),
            Column(f"{vector.stem}_y", unit, f"left, {place}", known),
        ]
    if name == vector.hop:
        description = f"number of robots that the {vector.stem} vector came through"
        return [Column(name, unit, description, known)]
    return []


def _memory_getter(name: str, place: int) -> Get:
    """Return a getter of one of the numbers of a part of the memory, (T, N)."""

    def get(arrays: Arrays) -> Shaped[np.ndarray, "T N"]:
        array = arrays[name]
        n_steps, n_robots = array.shape[:2]
        return array.reshape(n_steps, n_robots, -1)[..., place]

    return get


def _user_columns(table: str, arrays: Arrays, scene: Scene) -> Iterator[tuple[str, Column, Get]]:
    """Yield the columns that strategy and task name, each after a prefix for names that are taken.

    Args:
        table: name of the table.
        arrays: arrays of the trajectory.
        scene: constants of the world.
    """
    if table == "robots":
        for column, values in message_columns(scene, arrays["message"]):
            if column.name == MESSAGE_PREFIX + PRIORITY:
                flag = column._replace(known=acted)
                yield MESSAGE_PREFIX, flag, itemgetter("has_priority")
            else:
                yield MESSAGE_PREFIX, column, lambda _, values=values: values
        if scene.kind.any():
            kind = Column("kind", description="number of the robot's kind, from 0")
            yield "robot_", kind, lambda _: scene.kind
        if scene.team_names:
            team = Column("team", description="team of the robot", words=scene.team_names)
            yield "robot_", team, lambda _: scene.team
        for column, get in memory_columns(scene.memory):
            yield "memory_", column, get
    if table == "steps":
        for name, unit, description in zip(
            scene.metric_names, scene.metric_units, scene.metric_descriptions, strict=True
        ):
            yield "metric_", Column(name, unit, description), itemgetter(METRIC + name)


def _with_distinct_names(
    columns: Columns, user_columns: Iterable[tuple[str, Column, Get]]
) -> Columns:
    """Return columns and those of strategy and task, renamed by their prefixes as far as needed."""
    taken = {WORLD.name, *(column.name for column, _ in columns)}
    all_columns = list(columns)
    for prefix, column, get in user_columns:
        while column.name in taken:
            column = column._replace(name=prefix + column.name)
        taken.add(column.name)
        all_columns.append((column, get))
    return all_columns


def make_table(table: str, arrays: Arrays, scene: Scene) -> pa.Table:
    """Return a table of one world.

    Args:
        table: name of the table, one of `TABLES`.
        arrays: arrays of the trajectory.
        scene: constants of the world.
    """
    columns = _with_distinct_names(TABLES[table], _user_columns(table, arrays, scene))
    is_row = _row_mask(table, arrays)
    world_numbers = np.full(np.count_nonzero(is_row), scene.world, np.int32)

    fields = [_field(WORLD, pa.int32())]
    arrow_arrays = [pa.array(world_numbers)]
    for column, get in columns:
        values = _arrow_values(column, get(arrays), arrays, is_row)
        fields.append(_field(column, values.type))
        arrow_arrays.append(values)
    return pa.Table.from_arrays(arrow_arrays, schema=pa.schema(fields))


def _row_mask(table: str, arrays: Arrays) -> Bool[np.ndarray, "..."]:
    """Return which elements of the arrays of a table are rows: all, except for missing links."""
    name, numbered = _ROWS[table]
    if table == "links":
        return arrays[name]
    n_axes = 1 + len(numbered)
    return np.ones(arrays[name].shape[:n_axes], bool)


def _arrow_values(
    column: Column,
    values: Shaped[np.ndarray, "..."],
    arrays: Arrays,
    is_row: Bool[np.ndarray, "..."],
) -> pa.Array:
    """Return the values of a column, null where they are masked or unknown.

    Args:
        column: the column.
        values: its values, which broadcast to the rows.
        arrays: arrays of the trajectory.
        is_row: elements that are rows.
    """
    if column.words:
        values = np.array(column.words)[values]
    is_known = column.known(arrays) if column.known else True
    is_null = np.ma.getmaskarray(values) | np.logical_not(is_known)
    return pa.array(
        np.broadcast_to(np.ma.getdata(values), is_row.shape)[is_row],
        mask=np.broadcast_to(is_null, is_row.shape)[is_row],
    )


def _field(column: Column, arrow_type: pa.DataType) -> pa.Field:
    metadata = {"unit": column.unit, "description": column.description}
    return pa.field(column.name, arrow_type, metadata=metadata)
