"""Names in a swarm's recording, for those who query it: entities, their components in time, units and meanings."""

from typing import NamedTuple

import numpy as np

from iswarm_mj.output.schema import ARRAYS, Column, Frames, axes_of, columns_of

ROBOTS, BALLS, LINKS = "world/robots/body", "world/balls/true_size", "world/links"
SHOWN = {ROBOTS: ("T", "N"), BALLS: ("T", "K"), LINKS: ("T", "N", "S")}
"""Entities that show quantities of these axes where one of their instances is selected."""
SERIES = {
    {"picked": "series/balls/picked", "delivered": "series/balls/delivered"}.get(name, f"series/{name}"): column
    for name in ARRAYS
    for column in columns_of(name)
    if axes_of(name) == ("T",) and column.shown
}
"""Time series of quantities of a step."""
UNITS = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3), "rad": ("deg", float(np.rad2deg(np.float32(1))))}
"""SI units, what they become in recordings, and the factor."""
UNKNOWN = -1
"""Number where there is none."""


class Name(NamedTuple):
    """A component that changes in time, on the timelines `step` and `sim_time`."""

    entity: str
    """NAME stands for a vector that the strategy remembers, as dust and dump, or for a metric or an area of the task, N
    for a robot."""
    component: str
    unit: str
    """Empty for numbers without one, and for what is no number."""
    description: str


def _shown(entity: str) -> list[tuple[str, int, Column, Name]]:
    """Quantities that an entity shows: array, place along its last axis, column of tables, and name here."""
    found = []
    for quantity in ARRAYS:
        for place, column in enumerate(columns_of(quantity) if axes_of(quantity) == SHOWN[entity] else ()):
            unit = UNITS.get(column.unit, (column.unit,))[0]
            component = f"{column.name}_{unit.replace('/', '_per_')}" if unit != column.unit else column.name
            text = column.description + (f", {UNKNOWN} if none does" if column.name == "holder" else "")
            if column.shown:
                found.append((quantity, place, column, Name(entity, component, unit, text)))
    return found


def series_values(frames: Frames) -> dict[str, np.ndarray]:
    """Return the time series (T,) of quantities of a step, by their entities."""
    return {
        entity: getattr(frames, column.name) * UNITS.get(column.unit, ("", 1))[1] for entity, column in SERIES.items()
    }


def shown_values(entity: str, frames: Frames) -> dict[str, np.ndarray]:
    """Return what an entity shows of each robot, ball or side of a robot, arrays (T, N), (T, K) or (T, N, S)."""
    arrays, values = frames.arrays(), {}
    for quantity, place, column, name in _shown(entity):
        each = arrays[quantity] if arrays[quantity].ndim == len(SHOWN[entity]) else arrays[quantity][..., place]
        if column.unit in UNITS:
            each = each * np.float32(UNITS[column.unit][1])
        if column.known is not None and each.dtype.kind == "i":
            each = np.where(column.known(arrays), each, UNKNOWN).astype(each.dtype)
        values[name.component] = each
    return values


NAMES = (
    Name(ROBOTS, "Boxes3D:centers", "mm", "one a robot, by its number; the arena is centred on the origin"),
    Name(ROBOTS, "Boxes3D:quaternions", "", "x, y, z, w; the robot looks along its x axis"),
    Name(ROBOTS, "Boxes3D:class_ids", "", "0 empty, 2 scout, 4 loaded; plus 1 if it sends priority"),
    *(name for *_, name in _shown(ROBOTS)),
    Name(ROBOTS, "said_NAME", "", "a field of the message that is no vector, units as declared, lengths in m"),
    Name(ROBOTS, "NAME_hop", "", f"hop count of the remembered vector, {UNKNOWN} without one"),
    Name(ROBOTS, "NAME_hop_colour", "", "its colour, 0xRRGGBBAA"),
    Name("world/robots/front", "Points3D:positions", "mm", "of the dot at each robot's front"),
    Name(BALLS, "Points3D:positions", "mm", "one a ball, by its number"),
    Name(BALLS, "Points3D:class_ids", "", "10 on the floor, 11 held, 12 delivered"),
    *(name for *_, name in _shown(BALLS)),
    Name("world/balls/marker", "Points3D:positions", "mm", "above the ball and the robots"),
    Name("world/balls/marker", "Points3D:class_ids", "", "as of the ball"),
    Name(LINKS, "LineStrips3D:strips", "mm", "from receiver to sender, one a link"),
    Name(LINKS, "LineStrips3D:class_ids", "", "21 heard, 20 damaged message"),
    Name(LINKS, "receiver", "", "number of the robot that receives"),
    Name(LINKS, "side", "", "that receives: 0 front, 1 left, 2 back, 3 right"),
    *(name for *_, name in _shown(LINKS)),
    Name("world/trails", "LineStrips3D:strips", "mm", "where loaded robots were in the last 20 steps"),
    Name("world/trails", "robot", "", "number of the robot of each trail"),
    Name("world/memory/NAME", "Arrows3D:origins", "mm", "above the robots that know the vector"),
    Name("world/memory/NAME", "Arrows3D:vectors", "mm", "the vector, turned to the arena"),
    Name("world/memory/NAME", "robot", "", "number of the robot of each arrow"),
    Name("world/arena/NAME", "Boxes3D:centers", "mm", "areas of the task; of discs Cylinders3D"),
    Name("world/arena/NAME", "Boxes3D:half_sizes", "mm", "areas of the task"),
    Name("memory/NAME", "Scalars:scalars", "", "what else of the memory is recorded, one series a robot"),
    Name("states/robot_N", "StateChange:state", "", "from this step on; only of the robots that have a lane"),
    Name("series/states", "Scalars:scalars", "", "robots in each state, in the order of `SeriesLines:names`"),
    Name("series/known/NAME", "Scalars:scalars", "", "share of the robots that know the vector"),
    *(
        Name(entity, "Scalars:scalars", UNITS.get(column.unit, (column.unit,))[0], column.description)
        for entity, column in SERIES.items()
    ),
    Name("series/task/NAME", "Scalars:scalars", "", "a metric of the task, in its unit"),
)
"""All that change in time; what does not, as sizes and colours, are components of the same entities without time."""
