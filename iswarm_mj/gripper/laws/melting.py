"""Melting of a ball by the energy that a discharge brings into its contact."""

import math
from typing import NamedTuple

from jaxtyping import Bool

from iswarm_mj.gripper.laws.detachment import BALL_DENSITY
from iswarm_mj.utils.arrays import Array, Quantity, array_module

HEAT_CAPACITY = 230.0
"""Of SnAg solder [J/(kg K)]."""
MELTING_RISE = 196.0
"""From 25 deg C to the eutectic at 221 deg C [K]."""
LATENT_HEAT = 59e3
"""Of melting [J/kg]."""


class Supply(NamedTuple):
    """What drives the current through a contact. SI units; the values are choices."""

    resistance: float = 1e4
    """In series, of a voltage amplifier that limits its current [Ohm]."""
    contact: float = 1e3
    """Of the contact after its oxide broke down [Ohm]."""
    conductance: float = 4e-6
    """Heat that flows off per kelvin: 2 k a through the spot on the steel plate, k = 16 W/(m K), a = 0.13 um [W/K]."""


def contact_power(voltage: Quantity, supply: Supply) -> Quantity:
    """Heat in a broken-down contact while the supply holds its voltage, V^2 R_c / (R_s + R_c)^2 [W]."""
    return voltage**2 * supply.contact / (supply.resistance + supply.contact) ** 2


def melts(
    voltage: Quantity, radius: Quantity, breaks_at: Quantity, supply: Supply, time: Quantity
) -> Bool[Array, "..."]:
    """Whether a ball that touches plate and tool melts: its oxide breaks down, and the current has the time to melt it.

    Of a ball that hangs or flies no current flows to the plate, and the field's energy, some pJ, does not melt it.

    Args:
        voltage: of the tool against the plate [V].
        radius: of the ball [m].
        breaks_at: voltage at which the tool's oxide breaks down [V].
        supply: resistances, loss.
        time: for which ball, plate and tool touch under the voltage [s].
    """
    xp = array_module(voltage, radius, breaks_at, time)
    return xp.logical_and(xp.abs(voltage) >= breaks_at, melting_time(voltage, radius, supply) <= time)


def melting_time(voltage: Quantity, radius: Quantity, supply: Supply) -> Quantity:
    """Time in which a discharge melts a ball of uniform temperature; infinite if it never does [s].

    The ball warms with C dT / dt = P - K dT to the melting point and melts with what is left, P - K dT_m.
    """
    xp = array_module(voltage, radius)
    mass = 4 / 3 * math.pi * radius**3 * BALL_DENSITY
    power, loss = contact_power(voltage, supply), supply.conductance * MELTING_RISE
    suffices = power > loss
    safe = xp.where(suffices, power, 2 * loss)
    warming = -mass * HEAT_CAPACITY / supply.conductance * xp.log1p(-loss / safe)
    return xp.where(suffices, warming + mass * LATENT_HEAT / (safe - loss), math.inf)
