"""What lies under and beside a robot: dust and the dump (section 4.2 of the paper, constraints 1 and 2)."""

from typing import NamedTuple

import jax.numpy as jnp

from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.geometry import rotate


class FloorView(NamedTuple):
    """What N robots sense of the floor."""

    on_dump: Array
    """(N,) bool, the robot's centre lies on the dump."""
    tip_on_dump: Array
    """(N,) bool, the probe's tip lies over the dump."""
    at_dust: Array
    """(N,) bool, a ball lies within the sensing range, outside the dump."""
    ball: Array
    """(N,) int32, the nearest such ball; meaningless where not `at_dust`."""
    ball_vector: Array
    """(N, 2) where it lies, in the robot's frame, zero where there is none [mm]."""


def probe_tips(poses: Array, probe: Array) -> Array:
    """World positions (N, 2) of the probes' tips, `probe` (2,) ahead of and beside the robots' centres [mm]."""
    return poses[:, :2] + rotate(jnp.broadcast_to(probe, poses[:, :2].shape), poses[:, 2])


def sense(poses: Array, tips: Array, balls: Array, is_lying: Array, dump_size: float, reach: float) -> FloorView:
    """View of the floor of N robots among K balls.

    Args:
        poses: (N, 3) x, y [mm] and yaw [rad].
        tips: (N, 2) of the probes [mm].
        balls: (K, 2) positions [mm].
        is_lying: (K,) bool, the ball lies on the floor outside the dump.
        dump_size: edge of the square dump around the origin [mm].
        reach: sensing range for dust [mm].
    """
    offset = balls[:, None] - poses[None, :, :2]
    squared = jnp.where(is_lying[:, None], (offset**2).sum(axis=-1), jnp.inf)
    nearest = squared.min(axis=0)
    # As argmin, which XLA does not vectorise on CPUs.
    ball = jnp.where(squared == nearest, jnp.arange(len(balls), dtype=jnp.int32)[:, None], 0).max(axis=0)
    at_dust = nearest < reach**2
    vector = rotate(balls[ball] - poses[:, :2], -poses[:, 2])
    return FloorView(
        on_dump=jnp.abs(poses[:, :2]).max(axis=1) <= dump_size / 2,
        tip_on_dump=jnp.abs(tips).max(axis=1) <= dump_size / 2,
        at_dust=at_dust,
        ball=ball,
        ball_vector=jnp.where(at_dust[:, None], vector, 0.0),
    )
