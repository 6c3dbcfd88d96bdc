"""Names in a swarm's recording: entities, and components that show quantities; docs/files.md has all."""

import numpy as np

from iswarm_mj.output.memory import UNKNOWN
from iswarm_mj.output.schema import ARRAYS, Column, Frames, columns_of, numbers

FRONTS, BALL_MARKERS, TRAILS, COUNTS = "world/robots/front", "world/balls/marker", "world/trails", "series/states"
ARROWS, AREAS, MEMORY, SHARES, METRICS = "world/memory", "world/arena", "memory", "series/known", "series/task"
BOXES = "world/boxes"
UNITS = {"m": ("mm", 1e3), "m/s": ("mm/s", 1e3), "rad": ("deg", float(np.rad2deg(np.float32(1))))}
"""SI units, what they become in recordings, and the factor."""
VALUE = "Scalars:scalars"
"""Component of a time series."""


def _component(column: Column) -> str:
    """Component that shows a column of tables, with its unit there if that is another one."""
    unit = UNITS.get(column.unit, (column.unit,))[0]
    own = column.name if unit == column.unit else f"{column.name}_{unit.replace('/', '_per_')}"
    return VALUE if column.shown.startswith("series/") else own


SHOWN = [
    (_component(column), quantity, place, column)
    for quantity in ARRAYS
    for place, column in enumerate(columns_of(quantity))
    if column.shown
]
"""Quantities that recordings show: component there, array, place along its last axis, and column of tables."""
SERIES = {column.shown: column for component, *_, column in SHOWN if component == VALUE}
"""Time series of quantities of a step."""


def shown_values(entity: str, frames: Frames) -> dict[str, np.ndarray]:
    """Return what an entity shows of each step, robot, ball or side of a robot: (T,), (T, N), (T, K) or (T, N, S)."""
    arrays, values = frames.arrays(), {}
    for component, quantity, place, column in SHOWN:
        if column.shown == entity:
            each = numbers(arrays, quantity, place)
            if column.unit in UNITS:
                each = each * np.float32(UNITS[column.unit][1])
            if column.known is not None and each.dtype.kind == "i":
                each = np.where(column.known(arrays), each, UNKNOWN).astype(each.dtype)
            values[component] = each
    return values
