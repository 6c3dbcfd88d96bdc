"""How a world begins: what its task lays out, and which robots are dead."""

from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.strategy.user_code import user_code
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.protocol import Task
from iswarm_mj.tasks.signatures import check_start


class Start(NamedTuple):
    """How one world begins."""

    poses: np.ndarray
    """(N, 3) x, y [mm] and yaw [rad]."""
    balls: Balls
    is_alive: np.ndarray
    """(N,) bool."""
    own: Any = None
    """What else the task keeps, see `tasks.protocol.Things`."""


def draw_start(
    config: SwarmConfig,
    n_robots: int,
    seed: int,
    index: int,
    failed_fraction: float = 0.0,
    cell: float = 1.0,
    task: Task = CLEANING,
) -> Start:
    """Draw how world `index` of a seed begins; all worlds of a seed share what the task draws of the seed alone."""
    shared, own = np.random.default_rng([seed, 2**32 - 1]), np.random.default_rng([seed, index])
    return start_with(config, n_robots, own, shared, failed_fraction, cell, task)


def start_with(
    config: SwarmConfig,
    n_robots: int,
    rng: np.random.Generator,
    shared: np.random.Generator,
    failed_fraction: float = 0.0,
    cell: float = 1.0,
    task: Task = CLEANING,
) -> Start:
    """Draw how a world begins.

    Args:
        config: of the world.
        n_robots: N.
        rng: of the world.
        shared: draws what worlds of one seed have in common; may be `rng`.
        failed_fraction: share of the robots that are dead.
        cell: width of the cells on which robots start [rd].
        task: lays out robots and balls.
    """
    with user_code(f"{type(task).__name__}.lay_out"):
        poses, things = task.lay_out(config, n_robots, rng, shared, cell)
    check_start(task, poses, things, n_robots)
    is_alive = np.ones(n_robots, bool)
    is_alive[rng.permutation(n_robots)[: round(failed_fraction * n_robots)]] = False
    return Start(poses, things.balls, is_alive, things.own)
