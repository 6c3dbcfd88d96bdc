"""Rays against rectangles and walls, by hand and against sampled points. Units: mm."""

import math

import numpy as np
import pytest

from iswarm_mj.engines.planar.ray_geometry import meets_line, meets_rectangle


def test_rays_by_hand():
    c = math.sqrt(0.5)
    assert meets_rectangle(-5, 0.5, 8, 0, 1, 0, 1, 1) == 0.5
    assert meets_rectangle(-5, 0, 5, 0, c, c, 1, 1) == pytest.approx(1 - math.sqrt(2) / 5)
    assert meets_rectangle(-5, 0.8, 1, 0, 1, 0, 2, 0.5) == math.inf  # beside it
    assert meets_rectangle(-5, 0, -1, 0, 1, 0, 1, 1) == math.inf  # behind
    assert meets_rectangle(-5, 0, 1, 0, 1, 0, 1, 1) == 4  # beyond the vector's end
    assert meets_rectangle(0.5, 0, 1, 0, 1, 0, 1, 1) == 0.5  # from inside, as MuJoCo has it


def test_rays_enter_where_sampled_points_do():
    rng = np.random.default_rng(4)
    hits = 0
    for _ in range(300):
        origin, vector, yaw = rng.uniform(-4, 4, 2), rng.uniform(-8, 8, 2), rng.uniform(-3, 3)
        c, s = np.cos(yaw), np.sin(yaw)
        points = origin + np.linspace(0, 1, 4001)[:, None] * vector
        local = np.stack([points @ [c, s], points @ [-s, c]], axis=-1)
        inside = np.flatnonzero((np.abs(local) <= [1.4, 0.6]).all(axis=1))
        share = meets_rectangle(*origin, *vector, c, s, 1.4, 0.6)
        if len(inside):
            hits += 1
            outside = np.flatnonzero((np.abs(local) > [1.4, 0.6]).any(axis=1))
            first = inside[0] if inside[0] else outside[0] if len(outside) else None
            assert share > 1 if first is None else share == pytest.approx(first / 4000, abs=3e-4)
        else:
            assert share > 1  # no ray of these cuts a corner between two samples
    assert hits > 50


def test_walls_by_hand():
    assert meets_line(0, 0, 5, 1, 1, 0, 10) == 2
    assert meets_line(2, -9, 0, -4, 0, -1, 10) == 0.25
    assert meets_line(8, 9, 4, 1, 1, 0, 10) == 0.5
    assert meets_line(2, 0, 8, 6, 0.6, 0.8, 6) == pytest.approx(0.5)  # askew
    assert meets_line(10.1, 0, -1, 0, 1, 0, 10) == 0  # from beyond it
    assert meets_line(0, 0, -1, 5, 1, 0, 10) == meets_line(0, 0, 0, 5, 1, 0, 10) == math.inf
