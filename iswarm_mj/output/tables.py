"""Tidy tables of a recorded world: one row a robot, ball, link or control step, units in the metadata of columns."""

from collections.abc import Callable, Mapping
from functools import cache
from typing import NamedTuple

import numpy as np
import pyarrow as pa

from iswarm_mj.config import N_LEDS
from iswarm_mj.output.said import names_of, payload_of, said
from iswarm_mj.output.trajectory import METRIC
from iswarm_mj.sensors.messages import PRIORITY

Arrays = Mapping[str, np.ndarray]
"""Of a trajectory, see `trajectory.Frames` and `Scene`; those of earlier versions lack some."""


class Column(NamedTuple):
    """A column of a table."""

    name: str
    unit: str
    """Empty for numbers without one, and for what is no number."""
    description: str
    values: Callable[[Arrays], np.ndarray]
    """From the arrays to values of any shape, the same for all columns; masked where there is no value."""


STATES = np.array(["lying", "held", "delivered"])
"""Names of the states of a ball."""


def _by_robot(name: str) -> Callable[[Arrays], np.ndarray]:
    """Values (N,) of a scene, for every step."""
    return lambda a: np.broadcast_to(a[name], a["pose"].shape[:2])


def _remembered(name: str, axis: int | None = None) -> Callable[[Arrays], np.ndarray]:
    """Vectors or hop counts where the robot knows a vector."""
    part = f"{name}_hop" if axis is None else f"{name}_vector"
    return lambda a: np.ma.masked_where(~a[f"{name}_known"], a[part] if axis is None else a[part][..., axis])


def _in_step(a: Arrays, values: np.ndarray) -> np.ndarray:
    """Values (T, N), but none at the start and where the world did not take the step."""
    took = (a["step"] > 0) & a.get("is_running", np.True_)
    return np.ma.masked_where(np.broadcast_to(~took[:, None], values.shape), values)


def _sent(a: Arrays, values: np.ndarray) -> np.ndarray:
    """Values (T, N) of a step, but none where dead robots keep silent."""
    return np.ma.masked_where(np.broadcast_to(~a["scene_is_alive"], values.shape), _in_step(a, values))


def said_columns(arrays: Arrays) -> list[Column]:
    """Columns of what the robots' messages carried, by the payload that their strategy declared."""
    payload = payload_of(arrays)
    values = cache(lambda: said(payload, int(arrays.get("scene_n_leds", N_LEDS)), arrays["message"]))

    def of(name: str) -> Callable[[Arrays], np.ndarray]:
        if name == PRIORITY:
            return lambda a: _in_step(a, a["has_priority"])
        return lambda a: _sent(a, values()[name].values)

    return [Column(f"said_{name}", *about, of(name)) for name, about in names_of(payload).items()]


def _memory(name: str) -> list[Column]:
    where = f"of the remembered vector to the {name}, in the robot's own frame"
    return [
        Column(f"{name}_x", "m", f"ahead, {where}", _remembered(name, 0)),
        Column(f"{name}_y", "m", f"left, {where}", _remembered(name, 1)),
        Column(f"{name}_hop", "", f"robots that the vector to the {name} came through", _remembered(name)),
    ]


def _index(axis: int, kind: str) -> Callable[[Arrays], np.ndarray]:
    """Numbers along the first or second axis of (T, N) or (T, K) arrays."""
    name = {"robot": "pose", "ball": "ball_position"}[kind]

    def of(a: Arrays) -> np.ndarray:
        numbers = np.asarray(a["step"])[:, None] if axis == 0 else np.arange(a[name].shape[1], dtype=np.int32)
        return np.broadcast_to(numbers, a[name].shape[:2])

    return of


def _of_links(values: Callable[[Arrays, np.ndarray, np.ndarray, np.ndarray], np.ndarray]):
    """From frame, receiver and side (M,) of the links that exist to their values (M,)."""
    return lambda a: values(a, *np.nonzero(a["link_valid"]))


def _true_distance(a: Arrays, frame: np.ndarray, receiver: np.ndarray, side: np.ndarray) -> np.ndarray:
    """Between the centres as the step began, where the frame before left them."""
    sender, xy = a["link_sender"][frame, receiver, side], a["pose"][..., :2]
    apart = xy[frame - 1, sender] - xy[frame - 1, receiver]
    return np.hypot(apart[:, 0], apart[:, 1])


STEP = "control step, 0 for the start"
TABLES: dict[str, tuple[Column, ...]] = {
    "robots": (
        Column("step", "", STEP, _index(0, "robot")),
        Column("robot", "", "its number", _index(1, "robot")),
        Column(
            "x", "m", "of the centre after the step; the arena is centred on the origin", lambda a: a["pose"][..., 0]
        ),
        Column("y", "m", "likewise", lambda a: a["pose"][..., 1]),
        Column("yaw", "rad", "after the step, anticlockwise from the x axis, not wrapped", lambda a: a["pose"][..., 2]),
        Column("is_loaded", "", "it holds a ball", lambda a: a["is_loaded"]),
        Column("is_scout", "", "it scouts", _by_robot("scene_is_scout")),
        Column("is_alive", "", "it moves; a dead robot only stands in the way", _by_robot("scene_is_alive")),
        *_memory("dust"),
        *_memory("dump"),
        Column("message", "", "the 32 bits that its first LED sent", lambda a: _sent(a, a["message"])),
        Column("turn", "rad", "carried out in the step, anticlockwise", lambda a: _in_step(a, a["command"][..., 0])),
        Column(
            "forward", "m", "walked in the step if nothing is in the way", lambda a: _in_step(a, a["command"][..., 1])
        ),
    ),
    "balls": (
        Column("step", "", STEP, _index(0, "ball")),
        Column("ball", "", "its number", _index(1, "ball")),
        Column("x", "m", "of the centre after the step", lambda a: a["ball_position"][..., 0]),
        Column("y", "m", "likewise", lambda a: a["ball_position"][..., 1]),
        Column("z", "m", "likewise, above the floor", lambda a: a["ball_position"][..., 2]),
        Column("radius", "m", "", lambda a: np.broadcast_to(a["scene_ball_radius"], a["ball_state"].shape)),
        Column("state", "", "lying, held or delivered", lambda a: STATES[a["ball_state"]]),
        Column(
            "holder",
            "",
            "the robot that holds it",
            lambda a: np.ma.masked_where(a["ball_state"] != 1, a["ball_holder"]),
        ),
    ),
    "links": (
        Column("step", "", STEP, _of_links(lambda a, t, n, s: a["step"][t])),
        Column("receiver", "", "number of the robot that receives", _of_links(lambda a, t, n, s: n.astype(np.int32))),
        Column(
            "side",
            "",
            "that receives: 0 front, 1 left, 2 back, 3 right",
            _of_links(lambda a, t, n, s: s.astype(np.int8)),
        ),
        Column("sender", "", "number of the robot that sends", _of_links(lambda a, t, n, s: a["link_sender"][t, n, s])),
        Column("led", "", "LED that sends, counted as the sides", _of_links(lambda a, t, n, s: a["link_led"][t, n, s])),
        Column(
            "bearing",
            "rad",
            "direction of the sender in the receiver's frame, as measured",
            _of_links(lambda a, t, n, s: a["link_bearing"][t, n, s]),
        ),
        Column("distance", "m", "between the centres as the step began", _of_links(_true_distance)),
        Column(
            "measured_distance",
            "m",
            "as the receiver measured it",
            _of_links(lambda a, t, n, s: a["link_distance"][t, n, s]),
        ),
        Column("is_heard", "", "its message arrived undamaged", _of_links(lambda a, t, n, s: a["link_heard"][t, n, s])),
    ),
    "steps": (
        Column("step", "", STEP, lambda a: a["step"]),
        Column("time", "s", "", lambda a: a["step"] * float(a["scene_control_period"])),
        Column("is_running", "", "the world took this step", lambda a: a["is_running"]),
        Column("picked", "", "balls picked up so far", lambda a: a["picked"]),
        Column("delivered", "", "balls delivered so far", lambda a: a["delivered"]),
        Column("collisions", "", "so far", lambda a: a["collisions"]),
        Column("mean_speed", "m/s", "of the robots in the step", lambda a: a["mean_speed"]),
    ),
}
"""Columns of each table, after the number of the world; before `message` come those of `said_columns`."""
WORLD = pa.field("world", pa.int32(), metadata={"unit": "", "description": "number of the world"})


def missing(name: str, arrays: Arrays) -> list[str]:
    """Columns of a table that lack an array, since an earlier version wrote the trajectory."""
    own = _remembers_otherwise(arrays)
    return [c.name for c in _columns(name, arrays) if c.name not in own and _values(c, arrays) is None]


def _columns(name: str, arrays: Arrays) -> list[Column]:
    """Columns of a table, but for `memory_columns`."""
    columns = list(TABLES[name])
    place = next((i for i, column in enumerate(columns) if column.name == "message"), 0)
    return columns[:place] + (said_columns(arrays) if place else []) + columns[place:]


def memory_columns(name: str, arrays: Arrays) -> list[Column]:
    """Columns of what other strategies than the paper's have recorded of the robots' memory, if the table is `robots`.

    What a robot has several numbers of makes as many columns, as `home_0` and `home_1`.
    """
    if name != "robots" or not _remembers_otherwise(arrays):
        return []
    each = zip(*(arrays[f"scene_memory_{part}"].tolist() for part in ("names", "units", "sizes")), strict=True)
    return [
        Column(part if size == 1 else f"{part}_{place}", unit, "remembered", _place(part, place))
        for part, unit, size in each
        for place in range(size)
    ]


def metric_columns(name: str, arrays: Arrays) -> list[Column]:
    """Columns of the metrics of other tasks than cleaning, if the table is `steps`."""
    if name != "steps" or "scene_metric_names" not in arrays:
        return []
    each = zip(*(arrays[f"scene_metric_{part}"].tolist() for part in ("names", "units", "descriptions")), strict=True)
    return [Column(metric, unit, text, lambda a, key=METRIC + metric: a[key]) for metric, unit, text in each]


def _place(name: str, place: int) -> Callable[[Arrays], np.ndarray]:
    return lambda a: a[name].reshape(*a["pose"].shape[:2], -1)[..., place]


def _remembers_otherwise(arrays: Arrays) -> set[str]:
    """Columns of the memory of the paper's strategy, if the trajectory is of another one."""
    if "scene_memory_names" not in arrays or "dust_vector" in arrays["scene_memory_names"]:
        return set()
    return {column.name for place in ("dust", "dump") for column in _memory(place)}


def table_of(name: str, arrays: Arrays, world: int) -> pa.Table:
    """Return a table of one world, without the columns that are `missing`.

    Args:
        name: of the table, one of `TABLES`.
        arrays: of the trajectory.
        world: number of the world.
    """
    found = _present(_columns(name, arrays), arrays)
    for prefix, own in (("memory_", memory_columns(name, arrays)), ("metric_", metric_columns(name, arrays))):
        found += _present(_distinct(prefix, own, {WORLD.name, *(column.name for column, _ in found)}), arrays)
    n_rows = found[0][1].size if found else 0
    parts = [pa.array(np.full(n_rows, world, np.int32))]
    schema = [WORLD]
    for column, values in found:
        mask = np.ma.getmaskarray(values).ravel() if np.ma.isMaskedArray(values) else None
        part = pa.array(np.ascontiguousarray(np.ma.getdata(values)).ravel(), mask=mask)
        about = {"unit": column.unit, "description": column.description}
        parts.append(part)
        schema.append(pa.field(column.name, part.type, metadata=about))
    return pa.Table.from_arrays(parts, schema=pa.schema(schema))


def _distinct(prefix: str, own: list[Column], taken: set[str]) -> list[Column]:
    """Columns that a strategy or a task named, with a prefix where another column has that name."""
    found, taken = [], set(taken)
    for column in own:
        while column.name in taken:
            column = column._replace(name=prefix + column.name)
        taken.add(column.name)
        found.append(column)
    return found


def _present(columns: list[Column], arrays: Arrays) -> list[tuple[Column, np.ndarray]]:
    """Columns of which the trajectory has the arrays, with their values."""
    return [(column, values) for column in columns if (values := _values(column, arrays)) is not None]


def _values(column: Column, arrays: Arrays) -> np.ndarray | None:
    try:
        return column.values(arrays)
    except KeyError:
        return None
