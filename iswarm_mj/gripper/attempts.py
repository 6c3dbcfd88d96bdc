"""Attempts to lift and to release balls in the swarm, their outcomes, and the force balance that decides them."""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float

from iswarm_mj.config.static import StaticGripper
from iswarm_mj.gripper.laws.detachment import PROBE_RADIUS, is_grasped, is_released
from iswarm_mj.utils.arrays import Array


class Attempts(NamedTuple):
    """What robots try at K balls in one control step. SI units."""

    lifts: Bool[Array, "K"]
    """A tool tries to lift this ball."""
    releases: Bool[Array, "K"]
    """The robot that holds this ball tries to release it."""
    voltage: Float[Array, "K"]
    """Of the tool in this attempt [V]."""
    radius: Float[Array, "K"]
    """[m]"""
    work_tool_object: Float[Array, "K"]
    """Of this attempt, at the air's humidity [J/m^2]."""
    work_object_substrate: Float[Array, "K"]
    """[J/m^2]"""
    misalignment: Float[Array, "K"]
    """Lateral offset of the tool's axis from the ball's [m]."""


class Outcomes(NamedTuple):
    """Outcomes of attempts at K balls."""

    lifted: Bool[Array, "K"]
    released: Bool[Array, "K"]
    """The ball left the tool and stays on the floor."""
    postponed: Bool[Array, "K"]
    """The attempt was deferred, since all slots of the bench were busy."""
    duration: Float[Array, "K"]
    """Of the attempt on the bench [s]."""
    impact: Float[Array, "K"]
    """Speed of a released ball as it lands [m/s]; 0 where none lands."""


Decider = Callable[[StaticGripper, Attempts], Outcomes]
"""Decides the outcomes of attempts."""


def by_balance(gripper: StaticGripper, attempts: Attempts) -> Outcomes:
    """Outcomes by the balance of the forces, without dynamics: the quasi-static surrogate.

    Where the tool's axis misses the ball by more than the tool's radius, nothing is lifted.
    """
    radius, tool, floor = attempts.radius, attempts.work_tool_object, attempts.work_object_substrate
    reaches = attempts.misalignment < PROBE_RADIUS
    nothing = jnp.zeros_like(radius)
    return Outcomes(
        attempts.lifts & reaches & is_grasped(attempts.voltage, radius, tool, floor),
        attempts.releases & is_released(attempts.voltage, radius, tool, gripper.release_gap),
        jnp.zeros_like(attempts.lifts),
        nothing,
        nothing,
    )
