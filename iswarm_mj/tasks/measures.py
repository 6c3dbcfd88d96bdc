"""The paper's measures of a run and its fitness (section 4.6)."""

from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.handling import Balls


class Measures(NamedTuple):
    """Measures of one world so far."""

    delivered: int
    """Balls at the dump."""
    picked: int
    """Different balls that were picked up at least once."""
    collisions: int
    """Pairs of robots in contact that were not in contact a control step before, summed over steps.

    Contacts are read after the turn and after the walk, twice in ten physics steps. A touch that
    comes and goes in between is not counted.
    """
    mean_carriage_steps: float | None
    """Mean number of control steps that delivered balls were carried; None before the first."""
    finished_at: int | None
    """Control step after which the world was finished; None if it was not."""
    attempts: int = 0
    """Attempts to lift a ball."""
    failed_grasps: int = 0
    """Attempts to lift a ball that failed."""
    failed_releases: int = 0
    """Attempts to release a ball that failed."""
    releases: int = 0
    """Attempts to release a ball."""
    broken_off: int = 0
    """Failed attempts that were aborted because neighbours pushed the robot away."""
    postponed: int = 0
    """Attempts that waited for a later control step because all trials of one were taken."""
    work_time: float = 0.0
    """Sum of the times of attempts on the bench; 0 where the balance of forces decides [s]."""
    lost_time: float = 0.0
    """Sum of the times that robots lost in failed attempts and in waiting for a trial [s]."""
    impact: float | None = None
    """Mean speed of the balls' last landings; None where none was computed [m/s]."""
    starved: int = 0
    """Control steps in which robots waited for energy, summed over robots."""


def measure(
    balls: Balls | None,
    world: int,
    collisions: int,
    finished_at: int | None,
    starved: int = 0,
) -> Measures:
    """Return the measures of one world of a batch.

    Args:
        balls: balls of B worlds, arrays (B, K); None in tasks without balls.
        world: index of the world.
        collisions: number of collisions so far.
        finished_at: step at which the world finished.
        starved: control steps in which robots waited for energy, summed over robots.
    """
    if balls is None:
        return Measures(0, 0, collisions, None, finished_at, starved=starved)

    # The balls of the world, and the statistics of attempts to grip them.
    is_delivered = np.asarray(balls.is_delivered[world])
    carried_steps = np.asarray(balls.carried_steps[world])[is_delivered]
    was_picked = np.asarray(balls.was_picked[world])
    attempts = {}
    for name, values in balls.statistics._asdict().items():
        attempts[name] = np.asarray(values[world])
    impact = attempts["impact"]
    impact = impact[impact > 0]  # balls that never landed have 0

    return Measures(
        delivered=int(is_delivered.sum()),
        picked=int(was_picked.sum()),
        collisions=collisions,
        mean_carriage_steps=float(carried_steps.mean()) if len(carried_steps) else None,
        finished_at=finished_at,
        **{name: int(attempts[name].sum()) for name in COUNTED},
        work_time=float(attempts["work_time"].sum()),
        lost_time=float(attempts["lost_time"].sum()),
        impact=float(impact.mean()) if len(impact) else None,
        starved=starved,
    )


COUNTED = ("attempts", "failed_grasps", "failed_releases", "releases", "broken_off", "postponed")
"""Measures that are sums over the balls of the statistic of the same name."""

PICKED = 20.0
"""Points for a ball that is picked up."""
DELIVERED = 20.0
"""Further points when the ball is delivered."""
EARLY = 10.0
"""Points for each control step that is left when all balls are delivered."""
COLLISION = 0.05
"""Points that a collision costs in a swarm of one robot; in one of N robots it costs 1/N."""


def fitness(measures: Measures, n_robots: int, n_dust: int, max_steps: int) -> float:
    """Return the paper's fitness of one world.

    A swarm gets 40 points per ball delivered and 20 per ball picked up but not delivered, minus
    0.05 / n_robots per collision. If all balls were delivered it gets 10 points per step left of
    `max_steps`.

    A swarm that does not deliver all of 72 balls gets at most 2860. One that delivers them in 250
    of 800 steps gets 8380 without collisions; the paper prints 8360.

    Source: Valdastri et al. (2006), section 4.6.

    Args:
        measures: measures of the world.
        n_robots: N.
        n_dust: number of balls.
        max_steps: largest number of control steps of the run.
    """
    points = PICKED * measures.picked + DELIVERED * measures.delivered
    points -= COLLISION / n_robots * measures.collisions
    if measures.delivered == n_dust and measures.finished_at is not None:
        points += EARLY * (max_steps - measures.finished_at)
    return points
