"""Where robots and balls are when a world begins: cells of the arena, dust areas, balls."""

from functools import lru_cache

import numpy as np
from jaxtyping import Float

from iswarm_mj.config.swarm import ArenaConfig, GripperConfig
from iswarm_mj.geometry.obstacles import distances, numbers
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.geometry.walls import beyond, in_mm
from iswarm_mj.gripper.handling import AttemptStatistics, Balls
from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.strategy.contract import zeros_of
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import RD


@lru_cache(maxsize=16)
def free_cells(arena: ArenaConfig, cell: float = 1.0) -> np.ndarray:
    """Return the centres (C, 2) of the cells of this width [rd] outside the dump [mm], read-only.

    The paper's arena has 2376. A robot in a cell touches neither a wall nor an obstacle or a box at any heading.

    Raises:
        ConfigError: obstacles and boxes leave no cell.
    """
    low, high = np.min(arena.corners, axis=0), np.max(arena.corners, axis=0)
    counts, middle = ((high - low) / cell).astype(int), (low + high) / 2 * RD
    centres = ((np.arange(n) - (n - 1) / 2) * (cell * RD) + at for n, at in zip(counts, middle, strict=True))
    x, y = (a.ravel() for a in np.meshgrid(*centres, indexing="ij"))
    cells = np.column_stack([x, y])[np.maximum(abs(x), abs(y)) > arena.dump_size / 2 * RD]
    if arena.outline:
        cells = cells[beyond(cells, in_mm(arena.walls)) <= -cell * RD / 2 + 1e-9]
    if arena.standing:
        cells = cells[distances(cells, numbers(arena.standing, RD)) >= cell * RD / 2]
        if not len(cells):
            raise ConfigError(
                "arena.boxes" if arena.boxes else "arena.obstacles",
                arena.standing,
                "such that a cell is left on which a robot can start",
            )
    cells.flags.writeable = False  # all callers share it
    return cells


def cell_of(robot: Robots) -> float:
    """Width of the cells on which robots start, so that none touches another [rd]: 1, or more for large robots."""
    diameter = 2 * robot.circumradius / RD
    return diameter if diameter > 1 + 1e-9 else 1.0


def robots_for(arena: ArenaConfig, density: float, name: str = "density") -> int:
    """Return the number of robots that covers a share `density` of the free cells: 280 for 0.118, 314 for 0.132.

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
        width, height = np.ptp(arena.corners, axis=0)
        constraint = f"between 1 and {room} in an arena of {width:g} x {height:g} rd"
        remedy = "use fewer robots or a larger `arena.size`" if n_robots > room else None
        raise ConfigError("n_robots", n_robots, constraint, remedy)


def place_robots(arena: ArenaConfig, n_robots: int, rng: np.random.Generator, cell: float = 1.0) -> np.ndarray:
    """Return poses (N, 3) at which robots start, each on a free cell of its own and at a random heading.

    Args:
        arena: walls, dump, obstacles and boxes, which the robots do not touch.
        n_robots: N.
        rng: draws cells and headings.
        cell: width of a cell, the argument `cell` of `Task.lay_out` [rd].

    Returns:
        x, y [mm] and yaw [rad].

    Raises:
        ConfigError: the arena has no room for so many.
    """
    check_robots(arena, n_robots, cell)
    cells = free_cells(arena, cell)
    xy = cells[rng.choice(len(cells), n_robots, replace=False)]
    return np.column_stack([xy, rng.uniform(-np.pi, np.pi, n_robots)])


def place_balls(arena: ArenaConfig, rng: np.random.Generator) -> np.ndarray:
    """Positions (K, 2) [mm], spread evenly at random over the two dust areas, half in each."""
    k = arena.n_dust
    offset = rng.uniform(-0.5, 0.5, (k, 2)) * arena.dust_area_size
    offset[:, 0] += np.where(np.arange(k) < k // 2, -1, 1) * arena.dust_area_offset
    if hit := [box for box in arena.standing if (distances(offset, numbers([box])) == 0).any()]:
        size, far = arena.dust_area_size, arena.dust_area_offset
        where = f"squares of {size:g} rd about ({far:g}, 0) and ({-far:g}, 0) rd, where balls lie"
        given = " ".join(f"{value:g}" for value in hit[0])
        raise ConfigError(
            "arena.obstacles" if hit[0] in arena.obstacles else "arena.boxes", given, f"outside the dust areas, {where}"
        )
    return offset * RD


def draw_radii(arena: ArenaConfig, rng: np.random.Generator) -> np.ndarray:
    """Return radii (K,) of the balls, drawn uniformly between the limits of the arena's settings [m]."""
    return rng.uniform(arena.ball_radius_min, arena.ball_radius_max, arena.n_dust)


def balls_on_floor(gripper: GripperConfig, position: Float[np.ndarray, "K 2"], radius: Float[np.ndarray, "K"]) -> Balls:
    """Return balls that lie on the floor and all stick alike; each attempt draws how strongly.

    Args:
        gripper: median works of adhesion at 10 % RH, and the humidity.
        position: where the balls lie [mm].
        radius: radii of the balls [m].
    """
    factor = float(humidity_factor(gripper.relative_humidity))
    statistics = AttemptStatistics(**zeros_of(AttemptStatistics, K=len(radius)))
    balls = Balls(**zeros_of(Balls, K=len(radius)), statistics=statistics)
    return balls._replace(
        position=np.asarray(position, np.float32),
        radius=np.asarray(radius, np.float32),
        work_tool_object=np.full(len(radius), factor * gripper.work_tool_object, np.float32),
        work_object_substrate=np.full(len(radius), factor * gripper.work_object_substrate, np.float32),
    )


def no_balls() -> Balls:
    """No balls at all, for tasks without."""
    return balls_on_floor(GripperConfig(), np.zeros((0, 2)), np.zeros(0))
