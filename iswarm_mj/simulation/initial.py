"""How a run begins: where the robots and the balls are, and how strongly each ball sticks."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from iswarm_mj.config import ArenaConfig, GripperConfig, SwarmConfig
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.gripper.laws.detachment import scattered_work
from iswarm_mj.gripper.laws.humidity import humidity_factor
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.robot import Robot
from iswarm_mj.utils.units import RD


class Start(NamedTuple):
    """How one world begins."""

    poses: np.ndarray
    """(N, 3) x, y [mm] and yaw [rad]."""
    balls: Balls
    is_alive: np.ndarray
    """(N,) bool."""


@lru_cache(maxsize=16)
def free_cells(arena: ArenaConfig, cell: float = 1.0) -> np.ndarray:
    """Centres (C, 2) of the cells of this width [rd] outside the dump [mm], read-only; 2376 in the paper's arena."""
    n = int(arena.size / cell)
    centre = (np.arange(n) - (n - 1) / 2) * (cell * RD)
    x, y = (a.ravel() for a in np.meshgrid(centre, centre, indexing="ij"))
    outside = np.maximum(abs(x), abs(y)) > arena.dump_size / 2 * RD
    cells = np.column_stack([x, y])[outside]
    cells.flags.writeable = False  # all callers share it
    return cells


def cell_of(robot: Robot) -> float:
    """Width of the cells on which robots start, so that none touches another [rd]: 1, or more for large robots."""
    diameter = 2 * robot.circumradius / RD
    return diameter if diameter > 1 + 1e-9 else 1.0


def robots_for(arena: ArenaConfig, density: float, name: str = "density") -> int:
    """Number of robots that covers a share `density` of the free cells; 0.118 gives 280, 0.132 gives 314.

    Args:
        arena: sizes of the arena and of the dump.
        density: share of the cells, above 0 and at most 1.
        name: what an error message calls the density.
    """
    if not 0.0 < density <= 1.0:
        raise ConfigError(name, density, "above 0 and at most 1")
    return max(1, round(density * len(free_cells(arena))))


def check_robots(arena: ArenaConfig, n_robots: int, cell: float = 1.0) -> None:
    """Raise a ConfigError unless the arena has room for `n_robots` on cells of this width [rd]."""
    room = len(free_cells(arena, cell))
    if not 1 <= n_robots <= room:
        constraint = f"between 1 and {room} in an arena of {arena.size:g} x {arena.size:g} rd"
        remedy = "use fewer robots or a larger `arena.size`" if n_robots > room else None
        raise ConfigError("n_robots", n_robots, constraint, remedy)


def place_robots(arena: ArenaConfig, n_robots: int, rng: np.random.Generator, cell: float = 1.0) -> np.ndarray:
    """Start poses (N, 3) x, y [mm], yaw [rad]: on distinct free cells of this width [rd], at random headings."""
    check_robots(arena, n_robots, cell)
    cells = free_cells(arena, cell)
    xy = cells[rng.choice(len(cells), n_robots, replace=False)]
    return np.column_stack([xy, rng.uniform(-np.pi, np.pi, n_robots)])


def place_balls(arena: ArenaConfig, rng: np.random.Generator) -> np.ndarray:
    """Positions (K, 2) [mm], spread evenly at random over the two dust areas, half in each."""
    k = arena.n_dust
    offset = rng.uniform(-0.5, 0.5, (k, 2)) * arena.dust_area_size
    offset[:, 0] += np.where(np.arange(k) < k // 2, -1, 1) * arena.dust_area_offset
    return offset * RD


def draw_radii(arena: ArenaConfig, rng: np.random.Generator) -> np.ndarray:
    """Radii (K,) of the balls, uniform between the limits [m]."""
    return rng.uniform(arena.ball_radius_min, arena.ball_radius_max, arena.n_dust)


def draw_works(gripper: GripperConfig, n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Works of adhesion of n balls to tool and floor (n,), (n,), log-normal, at the air's humidity [J/m^2]."""
    factor = float(humidity_factor(gripper.relative_humidity))
    tool = scattered_work(gripper.work_tool_object, gripper.spread_tool_object, rng.standard_normal(n))
    floor = scattered_work(gripper.work_object_substrate, gripper.spread_object_substrate, rng.standard_normal(n))
    return factor * np.asarray(tool), factor * np.asarray(floor)


def draw_start(
    config: SwarmConfig, n_robots: int, seed: int, index: int, failed_fraction: float = 0.0, cell: float = 1.0
) -> Start:
    """Draw how world `index` of a seed begins; all worlds of a seed have balls of the same radii."""
    radii = draw_radii(config.arena, np.random.default_rng([seed, 2**32 - 1]))
    return start_with(config, n_robots, radii, np.random.default_rng([seed, index]), failed_fraction, cell)


def start_with(
    config: SwarmConfig,
    n_robots: int,
    radii: np.ndarray,
    rng: np.random.Generator,
    failed_fraction: float = 0.0,
    cell: float = 1.0,
) -> Start:
    """Draw how a world with balls of these radii (K,) [m] begins, its robots on cells of this width [rd]."""
    poses = place_robots(config.arena, n_robots, rng, cell)
    position = place_balls(config.arena, rng)
    works = draw_works(config.gripper, len(radii), rng)
    floats = (a.astype(np.float32) for a in (position, radii, *works))
    no, zero = np.zeros(len(radii), bool), np.zeros(len(radii), np.int32)
    balls = Balls(*floats, is_held=no, is_delivered=no, holder=zero, was_picked=no, carried_steps=zero)
    is_alive = np.ones(n_robots, bool)
    is_alive[rng.permutation(n_robots)[: round(failed_fraction * n_robots)]] = False
    return Start(poses, balls, is_alive)
