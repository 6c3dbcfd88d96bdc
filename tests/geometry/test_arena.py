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
"""Dump and dust areas that fit into small arenas [rd]."""
TRIANGLE = ((-12.0, -6.0), (12.0, -6.0), (0.0, 12.0))


def test_the_square_by_hand():
    arena = ArenaConfig(size=10, **SMALL)
    assert arena.walls.tolist() == [[1, 0, 5], [0, 1, 5], [-1, 0, 5], [0, -1, 5]]
    assert (arena.inradius, area_of(arena.corners)) == (5, 100)


def test_a_rectangle_by_hand():
    arena = ArenaConfig(outline=((40, 80),))
    assert arena.corners == ((20, -40), (20, 40), (-20, 40), (-20, -40))
    assert (arena.size, arena.inradius, area_of(arena.corners)) == (80, 20, 3200)
    cells_with_centres_on_dump = 6 * 6
    assert len(free_cells(arena)) == 40 * 80 - cells_with_centres_on_dump


def test_a_triangle_by_hand():
    walls = ArenaConfig(outline=TRIANGLE, **SMALL).walls
    np.testing.assert_allclose(walls[0], [0, -1, 6], atol=1e-12)
    np.testing.assert_allclose(walls[1], np.array([18, 12, 144]) / np.hypot(18, 12))
    points = np.array([[0, 0], [0, -7], [0, 12], [12, -6]])
    np.testing.assert_allclose(beyond(points, walls), [-6, 1, 0, 0], atol=1e-12)


def test_corners_may_be_given_clockwise():
    clockwise = ArenaConfig(outline=TRIANGLE[::-1], **SMALL)
    walls = np.sort(half_planes(clockwise.corners), axis=0)
    np.testing.assert_allclose(walls, np.sort(half_planes(TRIANGLE), axis=0))


def test_cells_keep_away_from_oblique_walls_and_from_the_dump():
    """They keep half a cell away; rows begin half a cell above the lowest wall."""
    arena = ArenaConfig(outline=TRIANGLE, **SMALL)
    x, y = np.meshgrid(np.arange(-11.5, 12), np.arange(-5.5, 12), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel()])
    free = (beyond(points, arena.walls) <= -0.5 + 1e-9) & (np.abs(points).max(axis=1) > 1)
    np.testing.assert_allclose(free_cells(arena) / RD, points[free], atol=1e-9)


@pytest.mark.parametrize(("half_x", "half_y"), [(1.0, 1.0), (1.2, 0.3), (0.3, 1.2)])
def test_the_mean_distance_from_the_middle_of_a_rectangle(half_x, half_y):
    shares = (np.arange(500) + 0.5) / 500
    x, y = np.meshgrid(shares * half_x, shares * half_y)
    assert mean_distance(half_x, half_y) == pytest.approx(np.hypot(x, y).mean(), rel=1e-5)


def random_boxes(rng, count):
    """Return boxes of random places, sizes and angles (count, 5)."""
    return rng.uniform([-2, -2, 0.2, 0.2, -180], [2, 2, 2, 1, 180], (count, 5))


def points_in(boxes):
    """Return a grid of points within each box (B, P), as complex numbers."""
    u, v = np.meshgrid(np.linspace(-1, 1, 31), np.linspace(-1, 1, 31))
    centre = boxes[:, :2] @ [[1], [1j]]
    turn = np.exp(1j * np.radians(boxes[:, 4:]))
    return centre + turn * (boxes[:, 2:3] * u.ravel() + 1j * boxes[:, 3:4] * v.ravel())


def test_boxes_overlap_where_points_of_one_lie_in_the_other():
    """Boxes are turned; few overlap by less than the distance of two points of a grid."""
    rng = np.random.default_rng(0)
    first = random_boxes(rng, 500)
    second = random_boxes(rng, 500)
    points = points_in(first)

    # Distances of the points of first boxes from second ones, in the frames of these.
    centre = second[:, :2] @ [[1], [1j]]
    seen = (points - centre) / np.exp(1j * np.radians(second[:, 4:]))
    beyond_x = np.maximum(np.abs(seen.real) - second[:, 2:3], 0)
    beyond_y = np.maximum(np.abs(seen.imag) - second[:, 3:4], 0)
    distance = distances(np.stack([points.real, points.imag], axis=-1), numbers(second)[:, None])
    np.testing.assert_allclose(distance, np.hypot(beyond_x, beyond_y), atol=1e-9)

    has_points = (distance == 0).any(axis=1)
    overlaps = overlap(numbers(first), numbers(second))
    assert overlaps[has_points].all()
    assert 100 < has_points.sum() < 400
    assert (overlaps != has_points).sum() < 10


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
def test_impossible_arenas_are_refused(settings, says):
    with pytest.raises(ConfigError, match=says):
        ArenaConfig(**settings)


def test_a_box_may_just_miss_the_dump():
    box = (3.4, 3.4, 2.0, 0.5, 135.0)
    assert ArenaConfig(obstacles=(box,)).obstacles == (box,)


def test_a_size_that_agrees_with_the_outline_is_allowed():
    assert ArenaConfig(size=80, outline=((40, 80),)) == ArenaConfig(outline=((40.0, 80.0),))


def test_an_engine_without_boxes_refuses_them():
    engine = find_engine(f"{Path(__file__).parents[1]}/data/teleport.py:TeleportSettings")()
    config = SwarmConfig(ArenaConfig(boxes=((8, 8, 1, 1, 0, 1e-5, 0.1),)))
    says = r"arena.boxes must be left out with the engine teleport, which has none"
    with pytest.raises(UserError, match=says):
        Run(Scenario(config, robots=3, engine=engine, steps=5))


def test_obstacles_that_leave_no_cell_are_refused():
    around_dump = (
        (0.0, 4.0, 7.4, 3.4, 0.0),
        (0.0, -4.0, 7.4, 3.4, 0.0),
        (4.0, 0.0, 3.4, 7.4, 0.0),
        (-4.0, 0.0, 3.4, 7.4, 0.0),
    )
    sizes = {"size": 15, "dump_size": 1, "dust_area_size": 2, "dust_area_offset": 5}
    arena = ArenaConfig(**sizes, obstacles=around_dump)
    says = r"arena.obstacles must be such that a cell is left on which a robot can start"
    with pytest.raises(UserError, match=says):
        free_cells(arena)


def test_obstacles_where_balls_lie_are_refused():
    config = SwarmConfig(ArenaConfig(obstacles=((16.0, 0.0, 3.0, 3.0, 0.0),)))
    says = (
        r"arena.obstacles must be outside the dust areas, .* \(12, 0\) .*"
        r"\(got '16 0 3 3 0'\)"
    )
    with pytest.raises(UserError, match=says):
        Run(Scenario(config, robots=3, engine=PlanarSettings(), steps=5))
