"""The four measures of the paper's Figs. 15 and 17, from rows of an experiment's table."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from iswarm_mj.experiments.analysis.findings import Row, Rows, number
from iswarm_mj.utils.arrays import Array


class Measure(NamedTuple):
    """A measure of a run."""

    name: str
    label: str
    """Including the unit, for axes."""
    unit: str
    value: Callable[[Row], float | None]
    is_better_larger: bool
    """Otherwise a smaller value is better."""


def time_of(row: Row) -> float:
    """Control step at which the goal was reached; the time limit if it was not."""
    return float(row["max_steps"] if row["finished_at"] is None else row["finished_at"])


TIME = Measure("time", "time to reach the goal [steps]", "steps", time_of, False)
DUST = Measure("dust", "dust removed [balls]", "balls", lambda row: float(row["delivered"]), True)
COLLISIONS = Measure(
    "collisions", "collisions per robot", "per robot", lambda row: float(row["collisions_per_robot"]), False
)
CARRIAGE = Measure("carriage", "mean carriage [steps]", "steps", lambda row: row["mean_carriage_steps"], False)
MEASURES = (TIME, DUST, COLLISIONS, CARRIAGE)


def values(rows: Rows, measure: Measure) -> Float[Array, "R"]:
    """Values of a measure, in the rows that have one."""
    found = (measure.value(row) for row in rows)
    return np.array([value for value in found if value is not None], float)


def select(rows: Rows, **labels: object) -> list[Row]:
    """Rows that have these values in their columns."""
    return [row for row in rows if all(row[name] == value for name, value in labels.items())]


def quartiles(found: Float[Array, "R"], unit: str = "") -> str:
    """Median and third quartile, the paper's form, in words."""
    if not len(found):
        return "no value"
    middle, third = np.quantile(found, [0.5, 0.75])
    return f"{number(middle)} (third quartile {number(third)})" + (f" {unit}" if unit else "")


def finished(rows: Rows) -> int:
    """Number of runs that reached their goal."""
    return sum(row["finished_at"] is not None for row in rows)
