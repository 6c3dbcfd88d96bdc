"""Rays against rectangles and walls, by hand and against sampled points. Units: mm."""

import math

import numpy as np
import pytest

from iswarm_mj.engines.contact_geometry import Rectangle
from iswarm_mj.engines.planar.kinds import Wall
from iswarm_mj.engines.planar.ray_geometry import Ray, meets_rectangle, meets_wall_at

SQUARE = Rectangle(x=0, y=0, cos=1, sin=0, half_x=1, half_y=1)
EAST = Wall(normal_x=1, normal_y=0, distance=10)
SOUTH = Wall(normal_x=0, normal_y=-1, distance=10)
OBLIQUE = Wall(normal_x=0.6, normal_y=0.8, distance=6)

HALF_EDGES = 1.4, 0.6
"""Half edges of the rectangle that is sampled."""
N_SAMPLES = 4001
"""Points of a ray that are sampled."""


class TestRectangles:
    def test_a_ray_meets_the_side_that_it_reaches_first(self):
        assert meets_rectangle(Ray(-5, 0.5, 8, 0), SQUARE) == 0.5

    def test_a_ray_meets_a_corner(self):
        c = math.sqrt(0.5)
        turned = SQUARE._replace(cos=c, sin=c)
        assert meets_rectangle(Ray(-5, 0, 5, 0), turned) == pytest.approx(1 - math.sqrt(2) / 5)

    def test_a_ray_beside_or_behind_meets_nothing(self):
        flat = SQUARE._replace(half_x=2, half_y=0.5)
        assert meets_rectangle(Ray(-5, 0.8, 1, 0), flat) == math.inf
        assert meets_rectangle(Ray(-5, 0, -1, 0), SQUARE) == math.inf

    def test_a_share_may_lie_beyond_the_vectors_end(self):
        assert meets_rectangle(Ray(-5, 0, 1, 0), SQUARE) == 4

    def test_a_ray_from_inside_meets_the_side_where_it_leaves(self):
        """MuJoCo's rays do so, too."""
        assert meets_rectangle(Ray(0.5, 0, 1, 0), SQUARE) == 0.5

    def test_rays_enter_where_sampled_points_do(self):
        rng = np.random.default_rng(4)
        n_hits = 0
        for _ in range(300):
            origin = rng.uniform(-4, 4, 2)
            vector = rng.uniform(-8, 8, 2)
            yaw = rng.uniform(-3, 3)
            cos = np.cos(yaw)
            sin = np.sin(yaw)
            rectangle = Rectangle(0.0, 0.0, cos, sin, *HALF_EDGES)
            share = meets_rectangle(Ray(*origin, *vector), rectangle)

            points = origin + np.linspace(0, 1, N_SAMPLES)[:, None] * vector
            local = np.stack([points @ [cos, sin], points @ [-sin, cos]], axis=-1)
            is_inside = (np.abs(local) <= HALF_EDGES).all(axis=1)
            n_hits += is_inside.any()
            is_beyond = is_inside if not is_inside[0] else ~is_inside
            if is_inside.any() and is_beyond.any():
                expected = is_beyond.argmax() / (N_SAMPLES - 1)
                assert share == pytest.approx(expected, abs=3e-4)
            else:
                assert share > 1  # no ray of these cuts a corner between two samples
        assert n_hits > 50


class TestWalls:
    def test_a_ray_meets_the_wall_in_front(self):
        assert meets_wall_at(Ray(0, 0, 5, 1), EAST) == 2
        assert meets_wall_at(Ray(2, -9, 0, -4), SOUTH) == 0.25
        assert meets_wall_at(Ray(8, 9, 4, 1), EAST) == 0.5
        assert meets_wall_at(Ray(2, 0, 8, 6), OBLIQUE) == pytest.approx(0.5)

    def test_a_ray_from_beyond_a_wall_meets_it_at_once(self):
        assert meets_wall_at(Ray(10.1, 0, -1, 0), EAST) == 0

    def test_a_ray_that_leads_away_or_along_meets_no_wall(self):
        assert meets_wall_at(Ray(0, 0, -1, 5), EAST) == math.inf
        assert meets_wall_at(Ray(0, 0, 0, 5), EAST) == math.inf
