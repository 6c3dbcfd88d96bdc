"""Sensing of dust and dump, worked by hand."""

import jax
import numpy as np
import pytest
from support.sensing import place, turned

from iswarm_mj.sensors.floor import probe_tips, sense
from iswarm_mj.utils.units import RD

DUMP_SIZE = 5 * RD
REACH = 0.75 * RD
PROBE = np.array([0.9, 0.0])
"""Tip of the probe, ahead and to the left of the centre [mm]."""

JUST = 1e-3
"""Distance by which something is inside or outside [mm]."""
FAR_AWAY = [(50, 50)]
"""A ball that no robot senses."""


@jax.jit
def sense_here(poses, probe, balls, is_lying):
    return sense(poses, probe_tips(poses, probe), balls, is_lying, DUMP_SIZE, REACH)


def view(poses, balls, is_lying=None):
    """Return the floor as robots at these poses sense it."""
    balls = np.asarray(balls, float).reshape(-1, 2)
    is_lying = np.ones(len(balls), bool) if is_lying is None else np.asarray(is_lying)
    return sense_here(poses, PROBE, balls, is_lying)


@pytest.mark.parametrize(
    ("heading", "tip"),
    [(0, (20.9, 30.2)), (90, (19.8, 30.9)), (180, (19.1, 29.8)), (270, (20.2, 29.1))],
)
def test_tip_of_the_probe(heading, tip):
    tips = probe_tips(place((20, 30, heading)), np.array([0.9, 0.2]))
    np.testing.assert_allclose(tips, [tip], atol=1e-5)


@pytest.mark.parametrize(
    ("heading", "offset", "vector"),
    [
        (0, (1.5, 0.5), (1.5, 0.5)),
        (90, (1.5, 0.5), (0.5, -1.5)),
        (180, (1.5, 0.5), (-1.5, -0.5)),
        (270, (1.5, 0.5), (-0.5, 1.5)),
        (45, (1.0, 1.0), (2**0.5, 0.0)),
    ],
)
def test_ball_in_the_robots_frame(heading, offset, vector):
    floor = view(place((20, -30, heading)), np.add((20, -30), offset))
    assert floor.at_dust[0]
    np.testing.assert_allclose(floor.ball_vector[0], vector, atol=1e-5)


@pytest.mark.parametrize("bearing", [0, 37, 90, 200])
def test_dust_is_sensed_within_three_quarters_of_a_robot(bearing):
    pose = place((20, 30, 77))
    for distance, is_sensed in ((REACH - JUST, True), (REACH + JUST, False)):
        ball = pose[0, :2] + turned(np.array([distance, 0.0]), np.radians(bearing))
        floor = view(pose, ball)
        assert bool(floor.at_dust[0]) is is_sensed
        assert bool(floor.ball_vector.any()) is is_sensed


def test_the_nearest_ball_that_lies_is_sensed():
    poses = place((20, 30, 0), (40, 30, 90), (60, 30, 0))
    balls = [(21, 30), (20.5, 30), (20, 30.2), (40, 31)]
    floor = view(poses, balls)
    np.testing.assert_array_equal(floor.at_dust, [True, True, False])
    np.testing.assert_array_equal(floor.ball[:2], [2, 3])

    floor = view(poses, balls, is_lying=[True, True, False, False])
    np.testing.assert_array_equal(floor.at_dust, [True, False, False])
    assert floor.ball[0] == 1
    np.testing.assert_allclose(floor.ball_vector, [[0.5, 0], [0, 0], [0, 0]], atol=1e-5)


def test_no_dust_where_no_ball_lies():
    floor = view(place((0, 0, 0)), [(0.1, 0.1)], is_lying=[False])
    assert not floor.at_dust[0]
    assert not floor.ball_vector.any()


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_dump_is_a_square_under_the_robots_centre(axis, sign):
    half_edge = DUMP_SIZE / 2
    for distance, is_inside in ((half_edge - JUST, True), (half_edge + JUST, False)):
        pose = np.zeros((1, 3))
        pose[0, axis] = sign * distance
        assert bool(view(pose, FAR_AWAY).on_dump[0]) is is_inside

    near_corner = np.array([[half_edge - 0.01, sign * (half_edge - 0.01), 0.0]])
    assert view(near_corner, FAR_AWAY).on_dump[0]


def test_the_tip_may_be_over_the_dump_while_the_centre_is_not():
    edge = DUMP_SIZE / 2
    poses = place((edge + 0.5, 0, 180), (0, edge - 0.5, 90), (0, -edge - 0.5, 270), (0, 0, 0))
    floor = view(poses, FAR_AWAY)
    np.testing.assert_array_equal(floor.on_dump, [False, True, False, True])
    np.testing.assert_array_equal(floor.tip_on_dump, [True, False, False, True])
