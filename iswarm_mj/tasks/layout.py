"""Initial places of robots and balls: free cells of the arena, dust areas, balls."""

from collections.abc import Sequence
from functools import lru_cache
from typing import NoReturn

import numpy as np
from jaxtyping import Float

from iswarm_mj.config.swarm import ArenaConfig, GripperConfig
from iswarm_mj.geometry.obstacles import distances, numbers
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.geometry.walls import beyond, in_mm
from iswarm_mj.gripper.attempts import tip_of
from iswarm_mj.gripper.handling import AttemptStatistics, Balls
from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.utils.declared_shapes import zeros_of
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import RD


@lru_cache(maxsize=16)
def free_cells(arena: ArenaConfig, cell: float = 1.0, *, with_dump: bool = False) -> np.ndarray:
    """Return the centres (C, 2) of the cells on which robots can start [mm], read-only.

    A robot in such a cell is not on the dump, and touches neither a wall nor an obstacle or a box
    at any heading. The paper's arena has 2376 of them, and 2401 with those on the dump.

    Args:
        arena: walls, dump, obstacles and boxes.
        cell: width of a cell [rd].
        with_dump: return the cells on the dump, too.

    Raises:
        ConfigError: obstacles and boxes leave no cell.
    """
    width = cell * RD
    cells = _grid(arena, cell)

    if not with_dump:
        distance_to_centre = np.maximum(abs(cells[:, 0]), abs(cells[:, 1]))
        cells = cells[distance_to_centre > arena.dump_size / 2 * RD]
    if arena.outline:
        cells = cells[beyond(cells, in_mm(arena.walls)) <= -width / 2 + 1e-9]
    if arena.standing:
        cells = cells[distances(cells, numbers(arena.standing, RD)) >= width / 2]
        if not len(cells):
            name = "arena.boxes" if arena.boxes else "arena.obstacles"
            constraint = "such that a cell is left on which a robot can start"
            raise ConfigError(name, arena.standing, constraint)

    cells.flags.writeable = False  # all callers share the cached array
    return cells


def _grid(arena: ArenaConfig, cell: float) -> np.ndarray:
    """Return the centres (C, 2) of all cells in the bounding box of the arena [mm].

    Args:
        arena: arena whose corners count.
        cell: width of a cell [rd].
    """
    corner_x, corner_y = np.transpose(arena.corners)
    x, y = np.meshgrid(
        _centres_of_row(corner_x.min(), corner_x.max(), cell),
        _centres_of_row(corner_y.min(), corner_y.max(), cell),
        indexing="ij",
    )
    return np.column_stack([x.ravel(), y.ravel()])


def _centres_of_row(low: float, high: float, cell: float) -> Float[np.ndarray, "C"]:
    """Return the centres of as many cells side by side as fit between two ends [mm].

    Args:
        low: one end [rd].
        high: the other end [rd].
        cell: width of a cell [rd].
    """
    n_cells = int((high - low) / cell)
    middle = (low + high) / 2 * RD
    from_middle = np.arange(n_cells) - (n_cells - 1) / 2
    return from_middle * (cell * RD) + middle


def cell_of(robot: Robots) -> float:
    """Return the width of the cells on which robots start without touching each other [rd].

    It is 1, or more for large robots.
    """
    diameter = 2 * robot.circumradius / RD
    return diameter if diameter > 1 + 1e-9 else 1.0


def robots_for(
    arena: ArenaConfig,
    density: float,
    name: str = "density",
    *,
    with_dump: bool = False,
) -> int:
    """Return the number of robots that covers a share of the free cells.

    In the paper's arena that is 280 for a density of 0.118, and 314 for 0.132.

    Args:
        arena: sizes of the arena and of the dump.
        density: share of the cells, above 0 and at most 1.
        name: name of the density in error messages.
        with_dump: cells of the dump count, too.

    Raises:
        ConfigError: the density is out of range.
    """
    if not 0.0 < density <= 1.0:
        raise ConfigError(name, density, "above 0 and at most 1")
    return max(1, round(density * len(free_cells(arena, with_dump=with_dump))))


def check_robots(arena: ArenaConfig, n_robots: int, cell: float = 1.0) -> None:
    """Raise a ConfigError unless the arena has room for N robots on cells of this width [rd]."""
    room = len(free_cells(arena, cell))
    if not 1 <= n_robots <= room:
        width, height = np.ptp(arena.corners, axis=0)
        constraint = f"between 1 and {room} in an arena of {width:g} x {height:g} rd"
        remedy = "use fewer robots or a larger `arena.size`" if n_robots > room else None
        raise ConfigError("n_robots", n_robots, constraint, remedy)


def place_robots(
    arena: ArenaConfig,
    n_robots: int,
    rng: np.random.Generator,
    cell: float = 1.0,
) -> np.ndarray:
    """Return random poses (N, 3) of robots, each on a free cell of its own.

    Args:
        arena: walls, dump, obstacles and boxes, which the robots do not touch.
        n_robots: N.
        rng: generator that draws cells and headings.
        cell: width of a cell, the argument `cell` of `Task.lay_out` [rd].

    Returns:
        x, y [mm] and yaw [rad].

    Raises:
        ConfigError: the arena has no room for so many.
    """
    check_robots(arena, n_robots, cell)
    cells = free_cells(arena, cell)
    xy = cells[rng.choice(len(cells), n_robots, replace=False)]
    yaw = rng.uniform(-np.pi, np.pi, n_robots)
    return np.column_stack([xy, yaw])


def place_balls(arena: ArenaConfig, rng: np.random.Generator) -> np.ndarray:
    """Return random positions (K, 2) of balls [mm], half of them in each dust area.

    Raises:
        ConfigError: a ball would lie in an obstacle or a box.
    """
    n_balls = arena.n_dust
    position = rng.uniform(-0.5, 0.5, (n_balls, 2)) * arena.dust_area_size
    side = np.where(np.arange(n_balls) < n_balls // 2, -1, 1)
    position[:, 0] += side * arena.dust_area_offset

    for box in arena.standing:
        if (distances(position, numbers([box])) == 0).any():
            _refuse_box(arena, box)
    return position * RD


def _refuse_box(arena: ArenaConfig, box: Sequence[float]) -> NoReturn:
    """Raise a ConfigError about an obstacle or a box in a dust area."""
    name = "arena.obstacles" if box in arena.obstacles else "arena.boxes"
    values = " ".join(f"{value:g}" for value in box)
    size = arena.dust_area_size
    offset = arena.dust_area_offset
    where = f"squares of {size:g} rd about ({offset:g}, 0) and ({-offset:g}, 0) rd"
    raise ConfigError(name, values, f"outside the dust areas, {where}, where balls lie")


def draw_radii(arena: ArenaConfig, rng: np.random.Generator) -> np.ndarray:
    """Return random radii (K,) of balls, uniform between the limits of the arena's settings [m]."""
    return rng.uniform(arena.ball_radius_min, arena.ball_radius_max, arena.n_dust)


def balls_on_floor(
    gripper: GripperConfig,
    position: Float[np.ndarray, "K 2"],
    radius: Float[np.ndarray, "K"],
) -> Balls:
    """Return balls that lie on the floor and all stick alike.

    Args:
        gripper: median works of adhesion at 10 % relative humidity, the humidity, and the tip, whose
            shape changes how strongly balls stick to it. How strongly a ball sticks in an attempt
            is drawn around them.
        position: positions of the balls [mm].
        radius: radii of the balls [m].
    """
    n_balls = len(radius)
    factor = float(
        humidity_factor(gripper.relative_humidity, gripper.humidity_doubling, gripper.humidity_fall)
    )
    tip = tip_of(gripper)
    share_of_tip = np.ones(n_balls) if tip is None else tip.adhesion_shares(np.asarray(radius))
    work_tool_object = factor * gripper.work_tool_object * share_of_tip
    work_object_substrate = factor * gripper.work_object_substrate

    statistics = AttemptStatistics(**zeros_of(AttemptStatistics, K=n_balls))
    balls = Balls(**zeros_of(Balls, K=n_balls), statistics=statistics)
    return balls._replace(
        position=np.asarray(position, np.float32),
        radius=np.asarray(radius, np.float32),
        work_tool_object=work_tool_object.astype(np.float32),
        work_object_substrate=np.full(n_balls, work_object_substrate, np.float32),
    )


def no_balls() -> Balls:
    """Return zero balls, for tasks without any."""
    return balls_on_floor(GripperConfig(), np.zeros((0, 2)), np.zeros(0))
