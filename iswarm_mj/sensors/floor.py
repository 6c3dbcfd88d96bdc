"""Sensing of dust and dump under and beside robots (section 4.2 of the paper, constraints 1, 2)."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.geometry.directions import rotate
from iswarm_mj.utils.arrays import Array


class FloorView(NamedTuple):
    """Floor as N robots sense it."""

    on_dump: Bool[Array, "N"]
    """The robot's centre is over the dump."""
    tip_on_dump: Bool[Array, "N"]
    """The probe's tip is over the dump."""
    at_dust: Bool[Array, "N"]
    """A ball lies within the sensing range and outside the dump."""
    ball: Int[Array, "N"]
    """Index of the nearest such ball, int32; undefined where not `at_dust`."""
    ball_vector: Float[Array, "N 2"]
    """Vector from the robot to that ball, in the robot's frame [mm]; zero where not `at_dust`."""


def probe_tips(poses: Float[Array, "N 3"], probe: Float[Array, "*#N 2"]) -> Float[Array, "N 2"]:
    """Return the world positions of the probes' tips [mm].

    Args:
        poses: x, y [mm] and yaw [rad].
        probe: each tip's position ahead of and to the left of its robot's centre [mm].
    """
    centre = poses[:, :2]
    yaw = poses[:, 2]
    return centre + rotate(jnp.broadcast_to(probe, centre.shape), yaw)


def sense(
    poses: Float[Array, "N 3"],
    tips: Float[Array, "N 2"],
    balls: Float[Array, "K 2"],
    is_lying: Bool[Array, "K"],
    dump_size: Array | float,
    reach: Array | float,
) -> FloorView:
    """Return what N robots sense of the floor among K balls.

    Args:
        poses: x, y [mm] and yaw [rad].
        tips: world positions of the probes' tips [mm].
        balls: world positions [mm].
        is_lying: the ball lies on the floor outside the dump.
        dump_size: edge of the square dump around the origin [mm].
        reach: sensing range for dust, from the robot's centre [mm].
    """
    # The nearest ball, as by argmin, which XLA does not vectorise on CPUs.
    offset = balls[:, None] - poses[None, :, :2]
    squared_distance = jnp.where(is_lying[:, None], (offset**2).sum(axis=-1), jnp.inf)
    nearest = squared_distance.min(axis=0)
    ball_index = jnp.arange(len(balls), dtype=jnp.int32)[:, None]
    ball = jnp.where(squared_distance == nearest, ball_index, 0).max(axis=0)

    at_dust = nearest < reach**2
    centre = poses[:, :2]
    vector = rotate(balls[ball] - centre, -poses[:, 2])
    return FloorView(
        on_dump=jnp.abs(centre).max(axis=1) <= dump_size / 2,
        tip_on_dump=jnp.abs(tips).max(axis=1) <= dump_size / 2,
        at_dust=at_dust,
        ball=ball,
        ball_vector=jnp.where(at_dust[:, None], vector, 0.0),
    )
