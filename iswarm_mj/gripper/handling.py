"""The balls and the robots' tools: who lifts, carries and releases what."""

from typing import NamedTuple

import jax.numpy as jnp

from iswarm_mj.config import Conditions, GripperConfig
from iswarm_mj.gripper.laws.detachment import is_grasped, is_released
from iswarm_mj.sensors.floor import FloorView
from iswarm_mj.utils.arrays import Array


class Balls(NamedTuple):
    """K solder balls. Each is lying, held or delivered, and is always exactly one of these."""

    position: Array
    """(K, 2) float32, where it lies or hangs [mm]."""
    radius: Array
    """(K,) float32 [m]."""
    work_tool_object: Array
    """(K,) float32, work of adhesion between tool and this ball [J/m^2]."""
    work_object_substrate: Array
    """(K,) float32, work of adhesion between this ball and the floor [J/m^2]."""
    is_held: Array
    """(K,) bool."""
    is_delivered: Array
    """(K,) bool, it was released over the dump, or fell there."""
    holder: Array
    """(K,) int32, the robot that holds it, or did last."""
    was_picked: Array
    """(K,) bool, it was picked up at least once."""
    carried_steps: Array
    """(K,) int32, control steps for which it has been held."""

    @property
    def is_lying(self) -> Array:
        """(K,) bool: on the floor, not on the dump by a robot's doing."""
        return ~self.is_held & ~self.is_delivered


def loaded(balls: Balls, n_robots: int) -> Array:
    """Whether each robot holds a ball (N,)."""
    return jnp.zeros(n_robots, bool).at[balls.holder].max(balls.is_held)


def carry(balls: Balls, tips: Array) -> Balls:
    """Balls after those that are held moved with the tips (N, 2) of their holders [mm]."""
    return balls._replace(position=jnp.where(balls.is_held[:, None], tips[balls.holder], balls.position))


def handle(
    gripper: GripperConfig, voltages: Conditions, balls: Balls, tips: Array, view: FloorView, picks: Array,
    falls: Array,
) -> tuple[Balls, Array]:  # fmt: skip
    """Release, lift and drop balls, as the force balance decides.

    Robots try to lift the ball that they sense if the tool reaches it; of several at one ball the nearest has it.
    A loaded robot on the dump tries to release.

    Args:
        gripper: reach and gap.
        voltages: of grasp and release.
        balls: K balls; those held are at their holders' tips.
        tips: (N, 2) of the probes [mm].
        view: the floor as N robots sense it.
        picks: (N,) bool, the robot is one that picks up dust.
        falls: (K,) bool, the ball falls if it is held.

    Returns:
        The balls, and whether each robot tried to lift one in vain (N,) bool.
    """
    n_robots = len(tips)
    was_loaded = loaded(balls, n_robots)
    gap = jnp.linalg.norm(balls.position[view.ball] - tips, axis=-1)
    tries = view.at_dust & picks & ~was_loaded & (gap <= gripper.tool_reach * 1e3)
    n_balls = len(balls.radius)
    nearest = jnp.full(n_balls, jnp.inf).at[view.ball].min(jnp.where(tries, gap, jnp.inf))
    first = tries & (gap == nearest[view.ball])
    winner = jnp.full(n_balls, n_robots).at[view.ball].min(jnp.where(first, jnp.arange(n_robots), n_robots))
    lifts = (winner < n_robots) & is_grasped(
        voltages.grasp_voltage, balls.radius, balls.work_tool_object, balls.work_object_substrate
    )
    over_dump = view.tip_on_dump[balls.holder]
    released = (
        balls.is_held
        & (view.on_dump & view.tip_on_dump)[balls.holder]
        & is_released(voltages.release_voltage, balls.radius, balls.work_tool_object, gripper.release_gap)
    )
    dropped = balls.is_held & falls & ~released
    is_held = (balls.is_held & ~released & ~dropped) | lifts
    balls = balls._replace(
        is_held=is_held,
        is_delivered=balls.is_delivered | released | (dropped & over_dump),
        holder=jnp.where(lifts, winner, balls.holder).astype(jnp.int32),
        was_picked=balls.was_picked | lifts,
        carried_steps=balls.carried_steps + is_held,
    )
    return balls, tries & ~loaded(balls, n_robots)
