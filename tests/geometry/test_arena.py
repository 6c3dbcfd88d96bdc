"""Arenas: rectangles and polygons by hand; outlines, obstacles and boxes that cannot be."""

from pathlib import Path

import numpy as np
import pytest

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.registry import find_engine
from iswarm_mj.geometry.obstacles import distances, mean_distance, numbers, overlap
from iswarm_mj.geometry.walls import area_of, beyond, half_planes
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.tasks.layout import free_cells
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.units import RD

SMALL = {"dump_size": 2, "dust_area_size": 1, "dust_area_offset": 3}
TRIANGLE = ((-12.0, -6.0), (12.0, -6.0), (0.0, 12.0))


def test_the_square_by_hand():
    arena = ArenaConfig(size=10, **SMALL)
    assert arena.walls.tolist() == [[1, 0, 5], [0, 1, 5], [-1, 0, 5], [0, -1, 5]]
    assert (arena.inradius, area_of(arena.corners)) == (5, 100)


def test_a_rectangle_by_hand():
    arena = ArenaConfig(outline=((40, 80),))
    assert arena.corners == ((20, -40), (20, 40), (-20, 40), (-20, -40))
    assert (arena.size, arena.inradius, area_of(arena.corners)) == (80, 20, 3200)
    assert (
        len(free_cells(arena)) == 40 * 80 - 6 * 6
    )  # cells whose centres are on the dump of 5 x 5 rd


def test_a_triangle_by_hand():
    walls = ArenaConfig(outline=TRIANGLE, **SMALL).walls
    np.testing.assert_allclose(walls[0], [0, -1, 6], atol=1e-12)
    np.testing.assert_allclose(walls[1], np.array([18, 12, 144]) / np.hypot(18, 12))
    points = np.array([[0, 0], [0, -7], [0, 12], [12, -6]])
    np.testing.assert_allclose(beyond(points, walls), [-6, 1, 0, 0], atol=1e-12)


def test_corners_may_be_given_clockwise():
    np.testing.assert_allclose(
        np.sort(half_planes(ArenaConfig(outline=TRIANGLE[::-1], **SMALL).corners), axis=0),
        np.sort(half_planes(TRIANGLE), axis=0),
    )


def test_cells_keep_away_from_oblique_walls():
    """By half a cell, and from the dump; rows begin half a cell above the lowest wall."""
    arena = ArenaConfig(outline=TRIANGLE, **SMALL)
    x, y = np.meshgrid(np.arange(-11.5, 12), np.arange(-5.5, 12), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    free = (beyond(points, arena.walls) <= -0.5 + 1e-9) & (np.abs(points).max(axis=1) > 1)
    np.testing.assert_allclose(free_cells(arena) / RD, points[free], atol=1e-9)


@pytest.mark.parametrize(("a", "b"), [(1.0, 1.0), (1.2, 0.3), (0.3, 1.2)])
def test_the_mean_distance_from_the_middle_of_a_rectangle(a, b):
    x, y = np.meshgrid(*((np.arange(500) + 0.5) / 500 * half for half in (a, b)))
    assert mean_distance(a, b) == pytest.approx(np.hypot(x, y).mean(), rel=1e-5)


def test_boxes_overlap_where_points_of_one_lie_in_the_other():
    """Turned boxes, and a grid of points in each; few overlap by less than lies between two
    points."""
    rng, (u, v) = (
        np.random.default_rng(0),
        np.meshgrid(np.linspace(-1, 1, 31), np.linspace(-1, 1, 31)),
    )
    first, second = rng.uniform([-2, -2, 0.2, 0.2, -180], [2, 2, 2, 1, 180], (2, 500, 5))
    turns = [np.exp(1j * np.radians(boxes[:, 4:])) for boxes in (first, second)]
    points = first[:, :2] @ [[1], [1j]] + turns[0] * (
        first[:, 2:3] * u.ravel() + 1j * first[:, 3:4] * v.ravel()
    )
    seen = (points - second[:, :2] @ [[1], [1j]]) / turns[1]
    x, y = (
        np.maximum(np.abs(part) - second[:, k : k + 1], 0)
        for k, part in ((2, seen.real), (3, seen.imag))
    )
    away = distances(np.stack([points.real, points.imag], axis=-1), numbers(second)[:, None])
    np.testing.assert_allclose(away, np.hypot(x, y), atol=1e-9)
    found, has_points = overlap(numbers(first), numbers(second)), (away == 0).any(axis=1)
    assert (
        found[has_points].all()
        and 100 < has_points.sum() < 400
        and (found != has_points).sum() < 10
    )


WRONG = [
    *(
        ({"outline": outline}, says)
        for outline, says in [
            ((1, 2, 3), "pairs of numbers"),
            ("square", "pairs of numbers"),
            (((1, 2, 3),), "pairs of numbers"),
            (((float("nan"), 20),), "finite numbers"),
            (((20, 20), (30, 30)), "width and height, or 3 to 32 corners"),
            (((20, -3),), "a width and a height above 0"),
            (((-20, -20), (20, -20), (0, 0), (20, 20), (-20, 20)), "corners of a convex polygon"),
            (((-20, -20), (20, 20), (20, -20), (-20, 20)), "convex polygon|around the origin"),
            (((-20, -20), (20, -20), (20, -20), (0, 20)), "corners of a convex polygon"),
            (((20, 0), (-16, 12), (6, -19), (6, 19), (-16, -12)), "convex polygon, once around"),
            (((30, -20), (60, -20), (60, 20), (30, 20)), "walls around the origin"),
            (((4, 6),), "at least 10 rd"),
            (((2000, 40),), "at most 1000 rd"),
            (((40, 4),), "at most half of `arena.size`"),
            (((24, 40),), "at most 9 rd, for the dust to lie within the walls"),
        ]
    ),
    *(
        ({"obstacles": (box,)}, says)
        for box, says in [
            ((3, 0, 1, 1, 0), r"arena.obstacles\[0\] must be outside the dump \(got"),
            ((3.4, 3.4, 2, 0.5, 45), r"arena.obstacles\[0\] must be outside the dump \(got"),
            ((24, 0, 1, 1, 0), r"arena.obstacles\[0\] must be inside the walls \(got"),
            (
                (8, float("nan"), 1, 1, 0),
                r"arena.obstacles\[0\] must be finite numbers x, y, half_x",
            ),
            (
                (8, 8, -1, 1, 0),
                r"arena.obstacles\[0\] must be a box with half edges above 0 rd \(got",
            ),
            ((8, 8, 1, 1), "arena.obstacles must be boxes of 5 numbers each"),
        ]
    ),
    *(
        ({"obstacles": ((9, 9, 0.5, 0.5, 0),), "boxes": (box,)}, says)
        for box, says in [
            ((8, 8, 1, 1, 0, 1e-5), "arena.boxes must be boxes of 7 numbers each, .*friction"),
            (
                (8, 8, 1, 1, 0, -1e-5, 0.1),
                r"arena.boxes\[0\] must be a box with a mass from 1e-08 to 0.01 kg, or 0 ",
            ),
            (
                (8, 8, 1, 1, 0, 1e-5, -0.1),
                r"arena.boxes\[0\] must be a box with a coefficient of friction from 0",
            ),
            ((24, 0, 1, 1, 0, 1e-5, 0.1), r"arena.boxes\[0\] must be inside the walls"),
            (
                (8, 8, 1, 1, 45, 1e-5, 0.1),
                r"arena.boxes\[0\] must be outside obstacles and other boxes",
            ),
        ]
    ),
    (
        {"boxes": ((8, 8, 1, 1, 0, 1e-5, 0.1), (9.5, 8, 1, 1, 45, 1e-5, 0.1))},
        r"arena.boxes\[1\] must be outside obstacles and other boxes",
    ),
    ({"size": 30, "outline": ((40, 80),)}, r"arena\.size must be left out"),
    ({"outline": TRIANGLE, "obstacles": ((6, 6, 0.5, 0.5, 0),), **SMALL}, "inside the walls"),
]


@pytest.mark.parametrize(("settings", "says"), WRONG)
def test_what_cannot_be_is_refused(settings, says):
    with pytest.raises(ConfigError, match=says):
        ArenaConfig(**settings)


def test_what_just_can_be():
    box = (3.4, 3.4, 2.0, 0.5, 135.0)  # it just misses the dump
    assert ArenaConfig(obstacles=(box,)).obstacles == (box,)
    assert ArenaConfig(size=80, outline=((40, 80),)) == ArenaConfig(outline=((40.0, 80.0),))


def test_an_engine_without_boxes_refuses_them():
    engine = find_engine(f"{Path(__file__).parents[1]}/data/teleport.py:TeleportSettings")()
    config = SwarmConfig(ArenaConfig(boxes=((8, 8, 1, 1, 0, 1e-5, 0.1),)))
    with pytest.raises(
        UserError, match=r"arena.boxes must be left out with the engine teleport, which has none"
    ):
        Run(Scenario(config, robots=3, engine=engine, steps=5))


def test_no_room_is_left():
    around = (
        (0.0, 4.0, 7.4, 3.4, 0.0),
        (0.0, -4.0, 7.4, 3.4, 0.0),
        (4.0, 0.0, 3.4, 7.4, 0.0),
        (-4.0, 0.0, 3.4, 7.4, 0.0),
    )
    arena = ArenaConfig(
        size=15, dump_size=1, dust_area_size=2, dust_area_offset=5, obstacles=around
    )
    with pytest.raises(
        UserError,
        match=r"arena.obstacles must be such that a cell is left on which a robot can start",
    ):
        free_cells(arena)


def test_no_obstacle_where_balls_lie():
    config = SwarmConfig(ArenaConfig(obstacles=((16.0, 0.0, 3.0, 3.0, 0.0),)))
    with pytest.raises(
        UserError,
        match=r"arena.obstacles must be outside the dust areas, .* \(12, 0\) .*\(got '16 0 3 3 0'\)",
    ):
        Run(Scenario(config, robots=3, engine=PlanarSettings(), steps=5))
