"""Balls and the robots' grippers in the swarm: lifting, carrying and releasing."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.config import GripperConfig
from iswarm_mj.gripper.laws.detachment import is_grasped, is_released
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.sensors.floor import FloorView
from iswarm_mj.utils.arrays import Array


class Balls(NamedTuple):
    """K solder balls. Each is either lying, held or delivered."""

    position: Float[Array, "K 2"]
    """Where it lies or hangs [mm]."""
    radius: Float[Array, "K"]
    """[m]"""
    work_tool_object: Float[Array, "K"]
    """Work of adhesion between tool and ball [J/m^2]."""
    work_object_substrate: Float[Array, "K"]
    """Work of adhesion between ball and floor [J/m^2]."""
    is_held: Bool[Array, "K"]
    is_delivered: Bool[Array, "K"]
    """Whether it was released or dropped over the dump."""
    holder: Int[Array, "K"]
    """The robot that holds it, or the last one that did."""
    was_picked: Bool[Array, "K"]
    """Whether it was picked up at least once."""
    carried_steps: Int[Array, "K"]
    """Control steps for which it has been held."""

    @property
    def is_lying(self) -> Bool[Array, "*B K"]:
        """Whether it lies on the floor, and was not delivered."""
        return ~self.is_held & ~self.is_delivered


def loaded(balls: Balls, n_robots: int) -> Bool[Array, "N"]:
    """Whether each robot holds a ball."""
    return jnp.zeros(n_robots, bool).at[balls.holder].max(balls.is_held)


def carry(balls: Balls, tips: Float[Array, "N 2"]) -> Balls:
    """Balls after those that are held have moved with the tips of their holders [mm]."""
    return balls._replace(position=jnp.where(balls.is_held[:, None], tips[balls.holder], balls.position))


def handle(
    gripper: GripperConfig,
    conditions: Conditions,
    balls: Balls,
    tips: Float[Array, "N 2"],
    view: FloorView,
    picks: Bool[Array, "N"],
    falls: Bool[Array, "K"],
) -> tuple[Balls, Bool[Array, "N"]]:
    """Release, lift and drop balls, as the balance of the forces decides.

    A robot tries to lift the ball that it senses if its tool reaches the ball; of several robots at one ball the
    nearest succeeds. A loaded robot on the dump tries to release its ball.

    Args:
        gripper: reach, and gap of the release.
        conditions: voltages of grasp and release.
        balls: K balls; those held are at their holders' tips.
        tips: of the probes [mm].
        view: the floor as the N robots sense it.
        picks: robots that pick up dust.
        falls: balls that fall if they are held.

    Returns:
        The balls, and whether each robot tried to lift one in vain.
    """
    n_robots = len(tips)
    tries, winner = _tries(gripper, balls, tips, view, picks)
    lifts = (winner < n_robots) & is_grasped(
        conditions.grasp_voltage, balls.radius, balls.work_tool_object, balls.work_object_substrate
    )
    over_dump = view.tip_on_dump[balls.holder]
    released = (
        balls.is_held
        & (view.on_dump & view.tip_on_dump)[balls.holder]
        & is_released(conditions.release_voltage, balls.radius, balls.work_tool_object, gripper.release_gap)
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


def _tries(
    gripper: GripperConfig, balls: Balls, tips: Float[Array, "N 2"], view: FloorView, picks: Bool[Array, "N"]
) -> tuple[Bool[Array, "N"], Int[Array, "K"]]:
    """Which robots try to lift a ball, and for each ball the nearest of them, the one of lowest index; N if none."""
    n_robots, n_balls = len(tips), len(balls.radius)
    gap = jnp.linalg.norm(balls.position[view.ball] - tips, axis=-1)
    tries = view.at_dust & picks & ~loaded(balls, n_robots) & (gap <= gripper.tool_reach * 1e3)
    nearest = jnp.full(n_balls, jnp.inf).at[view.ball].min(jnp.where(tries, gap, jnp.inf))
    first = tries & (gap == nearest[view.ball])
    robots = jnp.where(first, jnp.arange(n_robots), n_robots)
    return tries, jnp.full(n_balls, n_robots).at[view.ball].min(robots)
