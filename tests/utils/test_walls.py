"""Outlines of arenas: rectangles and polygons by hand, and what is none."""

import numpy as np
import pytest

from iswarm_mj.config import ArenaConfig
from iswarm_mj.tasks.layout import free_cells
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.walls import area_of, beyond, half_planes

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
    assert len(free_cells(arena)) == 40 * 80 - 6 * 6  # cells whose centres are on the dump of 5 x 5 rd


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
    arena = ArenaConfig(outline=TRIANGLE, **SMALL)
    cells, (x, y) = free_cells(arena), np.meshgrid(np.linspace(-12, 12, 400), np.linspace(-6, 12, 400))
    inside = beyond(np.stack([x, y], axis=-1), arena.walls) < 0
    assert len(cells) == pytest.approx(inside.mean() * 24 * 18, rel=0.3)


@pytest.mark.parametrize(
    ("given", "says"),
    [
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
    ],
)
def test_what_is_no_outline_is_refused(given, says):
    with pytest.raises(ConfigError, match=says):
        ArenaConfig(outline=given)


def test_a_size_beside_an_outline_is_refused():
    with pytest.raises(ConfigError, match=r"arena\.size must be left out"):
        ArenaConfig(size=30, outline=((40, 80),))
    again = ArenaConfig(size=80, outline=((40, 80),))
    assert again == ArenaConfig(outline=((40.0, 80.0),))


def test_obstacles_beyond_an_oblique_wall_are_refused():
    with pytest.raises(ConfigError, match="inside the walls"):
        ArenaConfig(outline=TRIANGLE, obstacles=((6.0, 6.0, 0.5, 0.5, 0.0),), **SMALL)
