"""Tidy tables of a recorded world: one row a robot, ball, box, link or control step, with the units of columns."""

from collections.abc import Callable, Iterable, Iterator
from operator import itemgetter

import numpy as np
import pyarrow as pa
from jaxtyping import Float, Shaped

from iswarm_mj.output.memory import vectors
from iswarm_mj.output.message_columns import said
from iswarm_mj.output.schema import ARRAYS, SCENE_COLUMNS, Column, acted, axes_of, columns_of, numbers
from iswarm_mj.output.trajectory import METRIC, SCENE, Arrays, Scene
from iswarm_mj.sensors.messages import PRIORITY

Get = Callable[[Arrays], Shaped[np.ndarray, "..."]]
"""From the arrays of a trajectory to values that broadcast to the shape of the table."""
Columns = list[tuple[Column, Get]]

_ROWS = {
    "robots": ("pose", {"N": Column("robot", "", "its number")}),
    "balls": ("ball_position", {"K": Column("ball", "", "its number")}),
    "boxes": ("box_pose", {"M": Column("box", "", "its number")}),
    "links": (
        "link_valid",
        {
            "N": Column("receiver", "", "number of the robot that receives"),
            "S": Column("side", "", "that receives: 0 front, 1 left, 2 back, 3 right"),
        },
    ),
    "steps": ("step", {}),
}
"""Of each table an array with its axes, and the numbers along those after that of steps."""


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


def _fixed(table: str) -> Iterator[tuple[Column, Get]]:
    """Columns that the schema gives."""
    name, along = _ROWS[table]
    axes, ones = ("T", *along), [1] * len(along)
    yield Column("step", "", "control step, 0 for the start"), lambda a: a["step"].reshape(-1, *ones)
    for axis, column in enumerate(along.values(), start=1):
        shape = [-1 if k == axis else 1 for k in range(len(axes))]
        size = lambda a, axis=axis: np.arange(a[name].shape[axis], dtype=np.int32)  # noqa: E731
        yield column, lambda a, size=size, shape=shape: size(a).reshape(shape)
    for quantity in ARRAYS:
        if axes_of(quantity) == axes:
            for place, column in enumerate(columns_of(quantity)):
                yield column, lambda a, quantity=quantity, place=place: numbers(a, quantity, place)
    for constant, column in SCENE_COLUMNS.items():
        if (Scene.__annotations__[constant].dim_str,) == axes[1:]:
            yield column, itemgetter(SCENE + constant)
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
    parts, found = {name: (unit, size) for name, unit, size in memory}, []
    own = [v for v in vectors((name, *about) for name, about in parts.items()) if v.known in parts]
    of = {name: v for v in own for name in (v.name, v.known, v.hop)}
    for name, (unit, size) in parts.items():
        v = of.get(name)
        if v is None:
            columns = [Column(name if size == 1 else f"{name}_{k}", unit, "remembered") for k in range(size)]
        elif name == v.name:
            where, known = f"of the remembered {v.stem} vector, in the robot's own frame", itemgetter(v.known)
            sides = {"x": "ahead", "y": "left"}
            columns = [Column(f"{v.stem}_{k}", unit, f"{side}, {where}", known) for k, side in sides.items()]
        else:
            text = f"robots that the {v.stem} vector came through"
            columns = [Column(name, unit, text, itemgetter(v.known))] if name == v.hop else []
        for k, column in enumerate(columns):
            found.append((column, lambda a, name=name, k=k: a[name].reshape(*a[name].shape[:2], -1)[..., k]))
    return found


def _own_columns(table: str, arrays: Arrays, scene: Scene) -> Iterator[tuple[str, Column, Get]]:
    """Columns that the strategy and the task name, with the prefixes of those whose names are taken."""
    if table == "robots":
        for column, values in said(scene, arrays["message"]):
            is_flag = column.name == f"said_{PRIORITY}"
            own = column._replace(known=acted) if is_flag else column
            yield "said_", own, itemgetter("has_priority") if is_flag else lambda _, values=values: values
        if scene.kind.any():
            yield "robot_", Column("kind", "", "number of its kind, from 0"), lambda _: scene.kind
        if scene.team_names:
            yield "robot_", Column("team", "", "its team", words=scene.team_names), lambda _: scene.team
        yield from (("memory_", *each) for each in memory_columns(scene.memory))
    if table == "steps":
        metrics = zip(scene.metric_names, scene.metric_units, scene.metric_descriptions, strict=True)
        yield from (("metric_", Column(*about), itemgetter(METRIC + about[0])) for about in metrics)


def table_of(table: str, arrays: Arrays, scene: Scene) -> pa.Table:
    """Return a table of one world.

    Args:
        table: its name, one of `TABLES`.
        arrays: of the trajectory.
        scene: of the world.
    """
    found, taken = list(TABLES[table]), {WORLD.name, *(column.name for column, _ in TABLES[table])}
    for prefix, column, get in _own_columns(table, arrays, scene):
        while column.name in taken:
            column = column._replace(name=prefix + column.name)
        taken.add(column.name)
        found.append((column, get))
    name, along = _ROWS[table]
    select = arrays[name] if table == "links" else np.ones(arrays[name].shape[: 1 + len(along)], bool)
    columns, parts = [WORLD], [pa.array(np.full(np.count_nonzero(select), scene.world, np.int32))]
    for column, get in found:
        values, known = get(arrays), column.known(arrays) if column.known else True
        values = np.array(column.words)[values] if column.words else values
        unknown = np.ma.getmaskarray(values) | np.logical_not(known)
        each = np.broadcast_to(np.ma.getdata(values), select.shape)[select]
        parts.append(pa.array(each, mask=np.broadcast_to(unknown, select.shape)[select]))
        columns.append(column)
    about = [(column.name, {"unit": column.unit, "description": column.description}) for column in columns]
    fields = [pa.field(name, part.type, metadata=m) for (name, m), part in zip(about, parts, strict=True)]
    return pa.Table.from_arrays(parts, schema=pa.schema(fields))
