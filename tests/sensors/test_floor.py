"""What a robot senses of the floor: hand-worked."""

import jax
import numpy as np
import pytest
from support.sensing import place, turned

from iswarm_mj.sensors.floor import probe_tips, sense
from iswarm_mj.utils.units import RD

DUMP, REACH = 5 * RD, 0.75 * RD
PROBE = np.array([0.9, 0.0])


@jax.jit
def sense_here(poses, probe, balls, lying):
    return sense(poses, probe_tips(poses, probe), balls, lying, DUMP, REACH)


def view(poses, balls, lying=None, probe=PROBE):
    balls = np.asarray(balls, float).reshape(-1, 2)
    lying = np.ones(len(balls), bool) if lying is None else np.asarray(lying)
    return sense_here(poses, probe, balls, lying)


@pytest.mark.parametrize(
    ("heading", "tip"), [(0, (20.9, 30.2)), (90, (19.8, 30.9)), (180, (19.1, 29.8)), (270, (20.2, 29.1))]
)
def test_tip_of_the_probe(heading, tip):
    tips = probe_tips(place((20, 30, heading)), np.array([0.9, 0.2]))
    np.testing.assert_allclose(tips, [tip], atol=1e-5)


@pytest.mark.parametrize(
    ("heading", "ball", "vector"),
    [
        (0, (1.5, 0.5), (1.5, 0.5)),
        (90, (1.5, 0.5), (0.5, -1.5)),
        (180, (1.5, 0.5), (-1.5, -0.5)),
        (270, (1.5, 0.5), (-0.5, 1.5)),
        (45, (1.0, 1.0), (2**0.5, 0.0)),
    ],
)
def test_ball_in_the_robots_frame(heading, ball, vector):
    got = view(place((20, -30, heading)), np.add((20, -30), ball))
    assert got.at_dust[0]
    np.testing.assert_allclose(got.ball_vector[0], vector, atol=1e-5)


@pytest.mark.parametrize("degrees", [0, 37, 90, 200])
def test_dust_is_sensed_within_three_quarters_of_a_robot(degrees):
    pose = place((20, 30, 77))
    for distance, sensed in ((REACH - 1e-3, True), (REACH + 1e-3, False)):
        got = view(pose, pose[0, :2] + turned(np.array([distance, 0.0]), np.radians(degrees)))
        assert bool(got.at_dust[0]) is sensed
        assert bool(got.ball_vector.any()) is sensed


def test_the_nearest_ball_that_lies_is_sensed():
    poses = place((20, 30, 0), (40, 30, 90), (60, 30, 0))
    balls = [(21, 30), (20.5, 30), (20, 30.2), (40, 31)]
    got = view(poses, balls)
    np.testing.assert_array_equal(got.at_dust, [True, True, False])
    np.testing.assert_array_equal(got.ball[:2], [2, 3])
    got = view(poses, balls, lying=[True, True, False, False])
    np.testing.assert_array_equal(got.at_dust, [True, False, False])
    assert got.ball[0] == 1
    np.testing.assert_allclose(got.ball_vector, [[0.5, 0], [0, 0], [0, 0]], atol=1e-5)


def test_no_dust_where_no_ball_lies():
    got = view(place((0, 0, 0)), [(0.1, 0.1)], lying=[False])
    assert not got.at_dust[0] and not got.ball_vector.any()


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("axis", [0, 1])
def test_the_dump_is_a_square_under_the_robots_centre(axis, sign):
    for distance, inside in ((DUMP / 2 - 1e-3, True), (DUMP / 2 + 1e-3, False)):
        pose = np.zeros((1, 3))
        pose[0, axis] = sign * distance
        assert bool(view(pose, [(50, 50)]).on_dump[0]) is inside
    corner = np.array([[DUMP / 2 - 0.01, sign * (DUMP / 2 - 0.01), 0.0]])
    assert view(corner, [(50, 50)]).on_dump[0]


def test_the_tip_may_be_over_the_dump_while_the_centre_is_not():
    edge = DUMP / 2
    got = view(place((edge + 0.5, 0, 180), (0, edge - 0.5, 90), (0, -edge - 0.5, 270), (0, 0, 0)), [(50, 50)])
    np.testing.assert_array_equal(got.on_dump, [False, True, False, True])
    np.testing.assert_array_equal(got.tip_on_dump, [True, False, False, True])
