"""Measures of runs, from rows of an experiment's table, and the paper's numbers that they are
compared with."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from iswarm_mj.search.rows import Row, Rows
from iswarm_mj.utils.arrays import Array

STEPS = 800
"""Control steps of a run of the evolution."""
SHORTEST = 250
"""Control steps that section 4.6 takes, about, for the theoretical shortest finishing time."""
PAPER_FITNESS = {"type1": 7771, "type2": 7766}
"""Of the fittest swarm of each type in Table 2, which is the best of the runs of the evolution."""
BEST, CLEAN, SPARSEST = (0.1, 0.15), (0.1, 0.2), 0.05
"""Densities between which the paper found the best swarms, those that cleaned the arena, and the
smallest it tried."""
DENSE = float(np.nextafter(CLEAN[1], 1)), math.inf
"""Those above that cleaned it."""


def latest_finish(fitness: float, n_dust: int = 72) -> int:
    """Control step at which a swarm with so many points had delivered all balls at the latest.

    By section 4.6 a ball delivered gives 40 points and each of 800 steps left 10, and collisions
    take some away: 7771 = 2880 + 10 (800 - t) - c leaves t = 310 with c = 9, which is 180
    collisions a robot, or an earlier step with 10 points more lost by collisions; 7766 leaves t =
    311 with c = 4, 80 collisions a robot. From 250 steps the formula makes 2880 + 5500 = 8380
    points; the paper's 8360 are 548 steps left instead of 550.
    """
    return math.floor(STEPS - (fitness - 40 * n_dust) / 10)


PAPER_TIME = {name: latest_finish(points) for name, points in PAPER_FITNESS.items()}
"""Finishing times of the paper's types [steps]."""
PENALTIES = {
    name: 40 * 72 + 10 * (STEPS - PAPER_TIME[name]) - points
    for name, points in PAPER_FITNESS.items()
}
"""Points that the paper's types lose by collisions, see `latest_finish`: 9 and 4."""


class Measure(NamedTuple):
    """A measure of a run."""

    label: str
    """Including the unit, for axes."""
    unit: str
    value: Callable[[Row], float | None]
    is_better_larger: bool = False
    """Otherwise a smaller value is better."""


TIME = Measure(
    "time to reach the goal [steps]",
    "steps",
    lambda row: float(row["max_steps"] if row["finished_at"] is None else row["finished_at"]),
)
"""The time limit, if the goal was not reached."""
DUST = Measure("dust removed [balls]", "balls", lambda row: float(row["delivered"]), True)
COLLISIONS = Measure(
    "collisions per robot", "per robot", lambda row: float(row["collisions_per_robot"])
)
CARRIAGE = Measure("mean carriage [steps]", "steps", lambda row: row["mean_carriage_steps"])
MEASURES = (TIME, DUST, COLLISIONS, CARRIAGE)
"""Of the paper's Figs. 15 and 17."""
FITNESS = Measure("fitness [points]", "points", lambda row: row["fitness"], True)
AGGREGATION = Measure("empty workers at dust areas [share]", "", lambda row: row["aggregation"])
ATTEMPTS = Measure(
    "attempts per ball", "per ball", lambda row: row["attempts"] / max(row["picked"], 1)
)
FAILED = Measure("failed grasps", "a run", lambda row: float(row["failed_grasps"]))
STUCK = Measure("failed releases", "a run", lambda row: float(row["failed_releases"]))
BROKEN = Measure("attempts broken off", "a run", lambda row: float(row["broken_off"]))
"""Among the failed ones."""
LOST = Measure("time lost by attempts in vain [robot s]", "robot s", lambda row: row["lost_time"])
"""Of all robots, at attempts to lift and to release: what they waited, and what the trials took."""
OVERLAP = Measure("deepest overlap [mm]", "mm", lambda row: row["overlap"])
STEP_TIME = Measure("time of a control step [ms]", "ms", lambda row: row["ms_per_step"])
"""Of the runs that the study of time steps observes."""
VOLTAGE = Measure("voltage [V]", "V", lambda row: row["voltage"])
"""Of a trial on the gripper's bench, if it reached one."""


def values(rows: Rows, measure: Measure) -> Float[Array, "R"]:
    """Values of a measure, in the rows that have one."""
    found = (measure.value(row) for row in rows)
    return np.array([value for value in found if value is not None], float)


def finished(rows: Rows) -> int:
    """Number of runs that reached their goal."""
    return sum(row["finished_at"] is not None for row in rows)
