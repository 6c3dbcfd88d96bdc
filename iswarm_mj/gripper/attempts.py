"""Attempts to lift and to release balls in the swarm, and the force balance that decides them."""

from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float

from iswarm_mj.config.static import StaticGripper
from iswarm_mj.gripper.laws.detachment import PROBE_RADIUS, is_grasped, is_released
from iswarm_mj.gripper.tips.table import TipTable, read_table
from iswarm_mj.utils.arrays import Array


class Attempts(NamedTuple):
    """Attempts of robots at K balls in one control step. SI units."""

    lifts: Bool[Array, "K"]
    """A tool tries to lift this ball."""
    releases: Bool[Array, "K"]
    """The robot that holds this ball tries to release it."""
    voltage: Float[Array, "K"]
    """Voltage of the tool [V]."""
    radius: Float[Array, "K"]
    """Radius of the ball [m]."""
    work_tool_object: Float[Array, "K"]
    """Work of adhesion between tool and ball, at the air's humidity [J/m^2]."""
    work_object_substrate: Float[Array, "K"]
    """Work of adhesion between ball and floor, at the air's humidity [J/m^2]."""
    misalignment: Float[Array, "K"]
    """Lateral offset of the tool's axis from the ball's [m]."""


class Outcomes(NamedTuple):
    """Outcomes of attempts at K balls."""

    lifted: Bool[Array, "K"]
    """The ball hangs at the tool."""
    released: Bool[Array, "K"]
    """The ball left the tool and stays on the floor."""
    postponed: Bool[Array, "K"]
    """The attempt was deferred, since all slots of the bench were busy."""
    duration: Float[Array, "K"]
    """Duration of the attempt on the bench [s]."""
    impact: Float[Array, "K"]
    """Speed of a released ball as it lands [m/s]; 0 where none lands."""


Decider = Callable[[StaticGripper, Attempts], Outcomes]
"""Decides the outcomes of attempts."""


def by_balance(gripper: StaticGripper, attempts: Attempts) -> Outcomes:
    """Return the outcomes by the force balance, the quasi-static surrogate of trials.

    A tool whose axis misses the ball by more than the tool's radius lifts nothing. See
    `laws.detachment.is_grasped` and `is_released`, and `TipTable` for tips of a table.
    """
    tip = tip_of(gripper)
    works = attempts.work_tool_object, attempts.work_object_substrate
    if tip is None:
        tool_radius = PROBE_RADIUS
        grasped = is_grasped(attempts.voltage, attempts.radius, *works)
        released = is_released(attempts.voltage, attempts.radius, works[0], gripper.release_gap)
    else:
        tool_radius = tip.profile.radius
        grasped = tip.is_grasped(attempts.voltage, attempts.radius, *works)
        released = tip.is_released(attempts.voltage, attempts.radius, works[0], gripper.release_gap)

    reaches = attempts.misalignment < tool_radius
    zeros = jnp.zeros_like(attempts.radius)
    return Outcomes(
        lifted=attempts.lifts & reaches & grasped,
        released=attempts.releases & released,
        postponed=jnp.zeros_like(attempts.lifts),
        duration=zeros,
        impact=zeros,
    )


def tip_of(gripper: StaticGripper) -> TipTable | None:
    """Return the table of the gripper's tip; None for the flat one.

    Raises:
        UserError: the file is no table of a tip.
    """
    return None if gripper.tip is None else read_table(gripper.tip)
