"""Directions in the plane, against hand-worked vectors."""

import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.geometry.directions import into_frame, rotate, wrapped


@pytest.mark.parametrize("xp", [np, jnp])
def test_a_quarter_turn_takes_ahead_to_the_left(xp):
    """A robot that looks north (yaw 90 degrees): ahead is north, left is west."""
    rotated = rotate(xp.array([[3.0, 0.0], [0.0, 2.0], [3.0, 2.0]]), xp.full(3, xp.pi / 2))
    assert isinstance(rotated, type(xp.zeros(1)))
    np.testing.assert_allclose(rotated, [[0, 3], [-2, 0], [-2, 3]], atol=1e-6)


def test_vectors_and_angles_broadcast():
    vectors = np.array([[1.0, 0.0], [0.0, 1.0]])
    angles = np.array([[0.0], [np.pi]])
    np.testing.assert_allclose(rotate(vectors, angles), [vectors, -vectors], atol=1e-12)


@pytest.mark.parametrize("xp", [np, jnp])
def test_a_robot_that_looks_north_has_the_west_to_its_left(xp):
    ahead, left = into_frame(
        xp.array([0.0, -2.0]), xp.array([3.0, 0.0]), heading=(xp.zeros(2), xp.ones(2))
    )
    assert isinstance(ahead, type(xp.zeros(1)))
    np.testing.assert_array_equal(ahead, [3.0, 0.0])
    np.testing.assert_array_equal(left, [0.0, 2.0])


@pytest.mark.parametrize("xp", [np, jnp])
def test_a_direction_has_one_angle_within_half_a_turn(xp):
    angles = wrapped(xp.array([3.5, -3.5, 1.0, 1.0 + 20 * xp.pi]))
    assert isinstance(angles, type(xp.zeros(1)))
    np.testing.assert_allclose(angles, [3.5 - 2 * np.pi, 2 * np.pi - 3.5, 1.0, 1.0], atol=1e-5)
