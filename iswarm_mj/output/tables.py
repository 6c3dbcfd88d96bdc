"""Tidy tables of a recorded world: one row a robot, ball, link or control step, units in the metadata of columns."""

import math
from collections.abc import Callable, Iterable, Iterator
from operator import itemgetter

import numpy as np
import pyarrow as pa
from jaxtyping import Float, Shaped

from iswarm_mj.output.memory_vectors import vector
from iswarm_mj.output.message_columns import decoded, message_columns, payload_of
from iswarm_mj.output.schema import ARRAYS, SCENE_COLUMNS, Column, acted, axes_of, columns_of
from iswarm_mj.output.trajectory import METRIC, SCENE, Arrays, Scene
from iswarm_mj.sensors.messages import PRIORITY

Get = Callable[[Arrays], Shaped[np.ndarray, "..."]]
"""From the arrays of a trajectory to values that broadcast to the shape of the table; masked where there is none."""
Columns = list[tuple[Column, Get]]

_ROWS = {
    "robots": ("is_loaded", {"N": Column("robot", "", "its number")}),
    "balls": ("ball_state", {"K": Column("ball", "", "its number")}),
    "links": (
        "link_valid",
        {
            "N": Column("receiver", "", "number of the robot that receives"),
            "S": Column("side", "", "that receives: 0 front, 1 left, 2 back, 3 right"),
        },
    ),
    "steps": ("step", {}),
}
"""Of each table an array of its shape, and the numbers along its axes after that of steps."""


_FIELD = "message."
"""Prefix of arrays of the fields of messages; no other name of an array has a dot."""


def _distance(arrays: Arrays) -> Float[np.ndarray, "T N S"]:
    """Between the centres as the step began, where the frame before left them."""
    before = np.roll(arrays["pose"][..., :2], 1, axis=0)
    sender = np.where(arrays["link_valid"], arrays["link_sender"], 0)
    apart = before[np.arange(len(before))[:, None, None], sender] - before[:, :, None]
    return np.hypot(apart[..., 0], apart[..., 1])


_DERIVED: dict[str, Columns] = {
    "steps": [(Column("time", "s", "at the end of the step"), lambda a: a["step"] * float(a["scene_control_period"]))],
    "links": [(Column("distance", "m", "between the centres as the step began"), _distance)],
}


def _stored(name: str, column: Column, place: int | None = None) -> tuple[Column, Get]:
    """An array of the trajectory, or of one of the numbers along its last axes, as a column."""

    def get(arrays: Arrays) -> np.ndarray:
        values = arrays[name]
        values = values if place is None else values.reshape(*values.shape[:2], math.prod(values.shape[2:]))[..., place]
        values = np.array(column.words)[values] if column.words else values
        if column.known is None:
            return values
        return np.ma.masked_where(np.broadcast_to(~column.known(arrays), values.shape), values)

    return column, get


def _numbers(name: str, axis: int, n_axes: int) -> Get:
    """Numbers along an axis of the table's array."""
    shape = [-1 if k == axis else 1 for k in range(n_axes)]
    return lambda arrays: np.arange(arrays[name].shape[axis], dtype=np.int32).reshape(shape)


def _fixed(table: str) -> Iterator[tuple[Column, Get]]:
    """Columns that the schema gives."""
    name, numbers = _ROWS[table]
    axes = ("T", *numbers)
    over_steps = (-1, *[1] * len(numbers))
    yield Column("step", "", "control step, 0 for the start"), lambda arrays: arrays["step"].reshape(over_steps)
    yield from ((column, _numbers(name, axes.index(axis), len(axes))) for axis, column in numbers.items())
    for quantity, f in ARRAYS.items():
        if axes_of(quantity) == axes:
            has_parts = len(f.type.dim_str.split()) > len(axes)
            for place, column in enumerate(columns_of(quantity)):
                yield _stored(quantity, column, place if has_parts else None)
    for constant, column in SCENE_COLUMNS.items():
        if (Scene.__annotations__[constant].dim_str,) == axes[1:]:
            yield _stored(SCENE + constant, column)
    yield from _DERIVED.get(table, [])


TABLES: dict[str, Columns] = {table: list(_fixed(table)) for table in _ROWS}
"""Columns of each table whatever strategy and task, after the number of the world."""
WORLD = Column("world", "", "number of the world")


def memory_columns(memory: Iterable[tuple[str, str, int]]) -> Columns:
    """Return the columns of what is recorded of the robots' memory.

    Vectors that a flag says to be known have their parts ahead and to the left, where they are known. Of what else a
    robot has several numbers of there are as many columns, as `home_0` and `home_1`.

    Args:
        memory: name, unit and number of numbers of each part.
    """
    parts = {name: (unit, size) for name, unit, size in memory}
    own = [vector(name) for name, about in parts.items() if about == ("m", 2) and vector(name).known in parts]
    of = {name: each for each in own for name in (each.name, each.known, each.hop)}
    found: Columns = []
    for name, (unit, size) in parts.items():
        v = of.get(name)
        if v is None:
            numbered = [name] if size == 1 else [f"{name}_{place}" for place in range(size)]
            found += [_stored(name, Column(each, unit, "remembered"), k) for k, each in enumerate(numbered)]
            continue
        known, where = itemgetter(v.known), f"of the remembered {v.title}, in the robot's own frame"
        if name == v.name:
            found.append(_stored(name, Column(f"{v.stem}_x", unit, f"ahead, {where}", known), 0))
            found.append(_stored(name, Column(f"{v.stem}_y", unit, f"left, {where}", known), 1))
        elif name == v.hop:
            found.append(_stored(name, Column(name, unit, f"robots that the {v.title} came through", known)))
    return found


def _said(scene: Scene) -> Iterator[tuple[Column, Get]]:
    """Columns of what the robots' messages carried, whose arrays `table_of` adds."""
    for column in message_columns(payload_of(scene.payload)):
        said = column._replace(name=f"said_{column.name}")
        if column.name == PRIORITY:
            yield _stored("has_priority", said._replace(known=acted))
        else:
            yield _stored(_FIELD + column.name, said)


def _own_columns(table: str, scene: Scene) -> Iterator[tuple[str, Columns]]:
    """Columns that the strategy and the task name, with the prefixes of those whose names are taken."""
    if table == "robots":
        yield "said_", list(_said(scene))
        yield "memory_", memory_columns(zip(scene.memory_names, scene.memory_units, scene.memory_sizes, strict=True))
    if table == "steps":
        metrics = zip(scene.metric_names, scene.metric_units, scene.metric_descriptions, strict=True)
        yield "metric_", [_stored(METRIC + about[0], Column(*about)) for about in metrics]


def table_of(table: str, arrays: Arrays, scene: Scene) -> pa.Table:
    """Return a table of one world.

    Args:
        table: its name, one of `TABLES`.
        arrays: of the trajectory.
        scene: of the world.
    """
    if table == "robots":
        said = decoded(payload_of(scene.payload), int(scene.n_leds), arrays["message"])
        arrays = {**arrays, **{_FIELD + name: values for name, values in said.items()}}
    found = list(TABLES[table])
    taken = {WORLD.name, *(column.name for column, _ in found)}
    for prefix, columns in _own_columns(table, scene):
        for column, get in columns:
            while column.name in taken:
                column = column._replace(name=prefix + column.name)
            taken.add(column.name)
            found.append((column, get))
    rows = arrays[_ROWS[table][0]]
    select = rows if table == "links" else np.ones(rows.shape, bool)
    parts = [pa.array(np.full(np.count_nonzero(select), scene.world, np.int32))]
    for _, get in found:
        values = get(arrays)
        mask = np.ma.getmaskarray(values)[select] if np.ma.isMaskedArray(values) else None
        parts.append(pa.array(np.broadcast_to(np.ma.getdata(values), select.shape)[select], mask=mask))
    about = {c.name: {"unit": c.unit, "description": c.description} for c in (WORLD, *(column for column, _ in found))}
    fields = [pa.field(name, part.type, metadata=m) for (name, m), part in zip(about.items(), parts, strict=True)]
    return pa.Table.from_arrays(parts, schema=pa.schema(fields))
