"""The paper's measures of a run and its fitness (section 4.6)."""

from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.handling import Balls


class Measures(NamedTuple):
    """Counts of one world so far."""

    delivered: int
    """Balls at the dump."""
    picked: int
    """Different balls that were picked up at least once."""
    collisions: int
    """Pairs of robots in contact that were not at the control step before, summed over the steps.

    Contacts are read after the turn and after the walk, twice in ten physics steps; a touch that comes and goes in
    between is not counted.
    """
    mean_carriage_steps: float | None
    """Mean number of control steps for which a delivered ball was carried; None before the first."""
    finished_at: int | None
    """Control step after which the wanted number of balls was delivered; None if it was not."""
    attempts: int = 0
    """To lift a ball."""
    failed_grasps: int = 0
    """Attempts to lift a ball in vain."""
    failed_releases: int = 0
    """Attempts to release a ball in vain."""
    releases: int = 0
    """Attempts to release a ball."""
    broken_off: int = 0
    """Of the attempts in vain, those without a trial, since neighbours pushed the robot out of reach."""
    postponed: int = 0
    """Attempts for which there was no room among the trials of a control step, and which were made in a later one."""
    work_time: float = 0.0
    """Time that attempts took on the bench, summed [s]; 0 where the balance of the forces decides."""
    lost_time: float = 0.0
    """Time that robots lost, summed: at attempts in vain, those on the bench included, and waiting for room [s]."""
    impact: float | None = None
    """Mean speed of the balls' last landings [m/s]; None where none was computed."""
    starved: int = 0
    """Control steps in which robots waited for energy, summed over robots."""


def measure(balls: Balls | None, world: int, collisions: int, finished_at: int | None, starved: int = 0) -> Measures:
    """Measures of one world of a batch.

    Args:
        balls: of B worlds, (B, K) arrays; None in tasks without.
        world: which of them.
        collisions: counted so far.
        finished_at: step at which the world finished.
        starved: control steps in which robots waited for energy.
    """
    if balls is None:
        return Measures(0, 0, collisions, None, finished_at, starved=starved)
    delivered = np.asarray(balls.is_delivered[world])
    statistics = balls.statistics
    impact = np.asarray(statistics.impact[world])
    carried = np.asarray(balls.carried_steps[world])[delivered]
    return Measures(
        delivered=int(delivered.sum()),
        picked=int(np.asarray(balls.was_picked[world]).sum()),
        collisions=collisions,
        mean_carriage_steps=float(carried.mean()) if len(carried) else None,
        finished_at=finished_at,
        **{name: int(np.asarray(getattr(statistics, name)[world]).sum()) for name in COUNTED},
        work_time=float(np.asarray(statistics.work_time[world]).sum()),
        lost_time=float(np.asarray(statistics.lost_time[world]).sum()),
        impact=float(impact[impact > 0].mean()) if (impact > 0).any() else None,
        starved=starved,
    )


PICKED, BROUGHT_HOME, EARLY, COLLISION = 20.0, 20.0, 10.0, 0.05
"""Points of the fitness: for a ball picked up, as many again when it is delivered, for each step left when all balls
are, and the cost of a collision of a single robot."""
COUNTED = ("attempts", "failed_grasps", "failed_releases", "releases", "broken_off", "postponed")
"""Counts of each ball."""


def fitness(measures: Measures, n_robots: int, n_dust: int, max_steps: int) -> float:
    """The paper's fitness of one world.

    40 points per ball delivered, 20 per ball picked up but not delivered, minus 0.05 / n_robots per collision; if
    all balls were delivered, 10 points per step left of `max_steps`. Source: Valdastri et al. (2006), section 4.6.
    A swarm that does not deliver all of 72 balls gets at most 2860. One that delivers them in 250 of 800 steps gets
    8380 without collisions; the paper prints 8360.
    """
    points = PICKED * measures.picked + BROUGHT_HOME * measures.delivered
    points -= COLLISION / n_robots * measures.collisions
    if measures.delivered == n_dust and measures.finished_at is not None:
        points += EARLY * (max_steps - measures.finished_at)
    return points
