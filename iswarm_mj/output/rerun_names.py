"""Names in a swarm's recording, for those who query it: entities, their components in time, units and meanings."""

from typing import NamedTuple

import numpy as np

from iswarm_mj.output.memory import UNKNOWN
from iswarm_mj.output.schema import ARRAYS, BALLS, LINKS, ROBOTS, Column, Frames, columns_of, numbers

FRONTS, BALL_MARKERS, TRAILS, COUNTS = "world/robots/front", "world/balls/marker", "world/trails", "series/states"
ARROWS, AREAS, MEMORY, SHARES, METRICS = "world/memory", "world/arena", "memory", "series/known", "series/task"
BOXES = "world/boxes"
UNITS = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3), "rad": ("deg", float(np.rad2deg(np.float32(1))))}
"""SI units, what they become in recordings, and the factor."""
VALUE = "Scalars:scalars"
"""Component of a time series."""


class Name(NamedTuple):
    """A component that changes in time, on the timelines `step` and `sim_time`."""

    entity: str
    """NAME stands for a vector that the strategy remembers, as dust and dump, or for a metric or an area of the task, N
    for a robot."""
    component: str
    unit: str
    """Empty for numbers without one, and for what is no number."""
    description: str


def _name(column: Column) -> Name:
    """Name of a column of tables that recordings show."""
    unit = UNITS.get(column.unit, (column.unit,))[0]
    component = column.name if unit == column.unit else f"{column.name}_{unit.replace('/', '_per_')}"
    text = column.description + (f", {UNKNOWN} if none does" if column.name == "holder" else "")
    return Name(column.shown, VALUE if column.shown.startswith("series/") else component, unit, text)


SHOWN = [
    (_name(column), quantity, place, column)
    for quantity in ARRAYS
    for place, column in enumerate(columns_of(quantity))
    if column.shown
]
"""Quantities that recordings show: name there, array, place along its last axis, and column of tables."""
SERIES = {name.entity: column for name, *_, column in SHOWN if name.component == VALUE}
"""Time series of quantities of a step."""


def shown_values(entity: str, frames: Frames) -> dict[str, np.ndarray]:
    """Return what an entity shows of each step, robot, ball or side of a robot: (T,), (T, N), (T, K) or (T, N, S)."""
    arrays, values = frames.arrays(), {}
    for name, quantity, place, column in SHOWN:
        if name.entity == entity:
            each = numbers(arrays, quantity, place)
            if column.unit in UNITS:
                each = each * np.float32(UNITS[column.unit][1])
            if column.known is not None and each.dtype.kind == "i":
                each = np.where(column.known(arrays), each, UNKNOWN).astype(each.dtype)
            values[name.component] = each
    return values


def _shown(entity: str) -> list[Name]:
    return [name for name, *_ in SHOWN if name.entity.startswith(entity)]


NAMES = (
    Name(ROBOTS, "Boxes3D:centers", "mm", "one a robot, by its number; the arena is centred on the origin"),
    Name(ROBOTS, "Boxes3D:quaternions", "", "x, y, z, w; the robot looks along its x axis"),
    Name(ROBOTS, "Boxes3D:class_ids", "", "0 empty, 2 scout, 4 loaded; plus 1 if it sends priority"),
    *_shown(ROBOTS),
    Name(ROBOTS, "said_NAME", "", "a field of the message that is no vector, units as declared, lengths in m"),
    Name(ROBOTS, "NAME_hop", "", f"hop count of the remembered vector, {UNKNOWN} without one"),
    Name(ROBOTS, "NAME_hop_colour", "", "its colour, 0xRRGGBBAA"),
    Name(FRONTS, "Points3D:positions", "mm", "of the dot at each robot's front"),
    Name(BALLS, "Points3D:positions", "mm", "one a ball, by its number"),
    Name(BALLS, "Points3D:class_ids", "", "10 on the floor, 11 held, 12 delivered"),
    *_shown(BALLS),
    Name(BALL_MARKERS, "Points3D:positions", "mm", "above the ball and the robots"),
    Name(BALL_MARKERS, "Points3D:class_ids", "", "as of the ball"),
    Name(BOXES, "Boxes3D:centers", "mm", "one a box that robots push, by its number"),
    Name(BOXES, "Boxes3D:half_sizes", "mm", "of the box"),
    Name(BOXES, "Boxes3D:quaternions", "", "x, y, z, w"),
    Name(LINKS, "LineStrips3D:strips", "mm", "from receiver to sender, one a link"),
    Name(LINKS, "LineStrips3D:class_ids", "", "21 heard, 20 damaged message"),
    Name(LINKS, "receiver", "", "number of the robot that receives"),
    Name(LINKS, "side", "", "that receives: 0 front, 1 left, 2 back, 3 right"),
    *_shown(LINKS),
    Name(TRAILS, "LineStrips3D:strips", "mm", "where loaded robots were in the last 20 steps"),
    Name(TRAILS, "robot", "", "number of the robot of each trail"),
    Name(f"{ARROWS}/NAME", "Arrows3D:origins", "mm", "above the robots that know the vector"),
    Name(f"{ARROWS}/NAME", "Arrows3D:vectors", "mm", "the vector, turned to the arena"),
    Name(f"{ARROWS}/NAME", "robot", "", "number of the robot of each arrow"),
    Name(f"{AREAS}/NAME", "Boxes3D:centers", "mm", "areas of the task; of discs Cylinders3D"),
    Name(f"{AREAS}/NAME", "Boxes3D:half_sizes", "mm", "areas of the task"),
    Name(f"{MEMORY}/NAME", VALUE, "", "what else of the memory is recorded, one series a robot"),
    Name("states/robot_N", "StateChange:state", "", "from this step on; only of the robots that have a lane"),
    Name(COUNTS, VALUE, "", "robots in each state, in the order of `SeriesLines:names`"),
    Name(f"{SHARES}/NAME", VALUE, "", "share of the robots that know the vector"),
    *_shown("series/"),
    Name(f"{METRICS}/NAME", VALUE, "", "a metric of the task, in its unit"),
)
"""All that change in time; what does not, as sizes and colours, are components of the same entities without time."""
