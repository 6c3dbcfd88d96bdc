"""Measures of runs, read from the rows of an experiment's table, and the paper's numbers."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from iswarm_mj.search.rows import Row, Rows

EVOLUTION_STEPS = 800
"""Control steps of a run of the paper's evolution."""
SHORTEST_TIME = 250
"""Theoretical shortest finishing time of section 4.6, approximately [control steps]."""
PAPER_FITNESS = {"type1": 7771, "type2": 7766}
"""Fitness of the fittest swarm of each type in Table 2, the best of all runs of the evolution."""
BEST_DENSITIES = (0.1, 0.15)
"""Range of densities in which the paper found the best swarms."""
CLEANING_DENSITIES = (0.1, 0.2)
"""Range of densities at which the paper's swarms cleaned the arena."""
SPARSEST_DENSITY = 0.05
"""Smallest density that the paper tried."""
HIGH_DENSITIES = (float(np.nextafter(CLEANING_DENSITIES[1], 1)), math.inf)
"""Range of densities above those at which the paper's swarms cleaned the arena."""
POINTS_PER_BALL = 40
"""Points that a swarm gains by each ball that it delivers (section 4.6)."""
POINTS_PER_STEP = 10
"""Points that a swarm gains by each control step that is left at the end (section 4.6)."""


def latest_finish(fitness: float, n_dust: int = 72) -> int:
    """Return the latest control step at which a swarm of this fitness delivered its last ball.

    By section 4.6 a delivered ball gives 40 points and each of 800 steps left 10, and collisions
    take some away: 7771 = 2880 + 10 (800 - t) - c leaves t = 310 with c = 9, which is 180
    collisions a robot, or an earlier step with 10 points more lost by collisions; 7766 leaves t =
    311 with c = 4, 80 collisions a robot. From 250 steps the formula makes 2880 + 5500 = 8380
    points; the paper's 8360 are 548 steps left instead of 550.
    """
    return math.floor(EVOLUTION_STEPS - (fitness - POINTS_PER_BALL * n_dust) / POINTS_PER_STEP)


PAPER_TIME = {name: latest_finish(points) for name, points in PAPER_FITNESS.items()}
"""Finishing times of the paper's types [control steps]."""
PENALTIES = {
    name: POINTS_PER_BALL * 72 + POINTS_PER_STEP * (EVOLUTION_STEPS - PAPER_TIME[name]) - points
    for name, points in PAPER_FITNESS.items()
}
"""Points that the paper's types lose by collisions, see `latest_finish`: 9 and 4."""


class Measure(NamedTuple):
    """A measure of a run."""

    label: str
    """Label of an axis, with the unit."""
    unit: str
    """Unit of the values; empty for a share."""
    value: Callable[[Row], float | None]
    """Returns the value of a row; None if the row has none."""
    is_better_larger: bool = False
    """Larger values are better; otherwise smaller ones are."""


TIME = Measure(
    "time to reach the goal [steps]",
    "steps",
    lambda row: float(row["max_steps"] if row["finished_at"] is None else row["finished_at"]),
)
"""Time to reach the goal; the time limit for a run that did not reach it."""
DUST = Measure("dust removed [balls]", "balls", lambda row: float(row["delivered"]), True)
COLLISIONS = Measure(
    "collisions per robot", "per robot", lambda row: float(row["collisions_per_robot"])
)
CARRIAGE = Measure("mean carriage [steps]", "steps", lambda row: row["mean_carriage_steps"])
FIGURE_MEASURES = {"time": TIME, "dust": DUST, "collisions": COLLISIONS, "carriage": CARRIAGE}
"""Measures of the paper's Figs. 15 and 17, by short names."""
MEASURES = tuple(FIGURE_MEASURES.values())
"""Measures of the paper's Figs. 15 and 17."""
FITNESS = Measure("fitness [points]", "points", lambda row: row["fitness"], True)
AGGREGATION = Measure("empty workers at dust areas [share]", "", lambda row: row["aggregation"])
ATTEMPTS = Measure(
    "attempts per ball", "per ball", lambda row: row["attempts"] / max(row["picked"], 1)
)
FAILED = Measure("failed grasps", "a run", lambda row: float(row["failed_grasps"]))
STUCK = Measure("failed releases", "a run", lambda row: float(row["failed_releases"]))
BROKEN = Measure("attempts broken off", "a run", lambda row: float(row["broken_off"]))
"""Attempts that were broken off; they count among the failed ones too."""
LOST = Measure("time lost by attempts in vain [robot s]", "robot s", lambda row: row["lost_time"])
"""Time that robots lost by attempts to lift and to release: waits, and the trials themselves."""
OVERLAP = Measure("deepest overlap [mm]", "mm", lambda row: row["overlap"])
"""Deepest overlap of bodies; only of the runs that the study of time steps observes."""
STEP_TIME = Measure("time of a control step [ms]", "ms", lambda row: row["ms_per_step"])
"""Computing time of a control step; only of the runs that the study of time steps observes."""
VOLTAGE = Measure("voltage [V]", "V", lambda row: row["voltage"])
"""Voltage that a trial on the gripper's bench reached, if it reached one."""


def values(rows: Rows, measure: Measure) -> Float[np.ndarray, "R"]:
    """Return the values of a measure in the rows that have one."""
    all_values = (measure.value(row) for row in rows)
    return np.array([value for value in all_values if value is not None], float)


def count_finished(rows: Rows) -> int:
    """Return the number of runs that reached their goal."""
    return sum(row["finished_at"] is not None for row in rows)
