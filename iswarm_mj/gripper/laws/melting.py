"""Melting of a ball by the energy that a discharge brings into its contact."""

import math
from typing import NamedTuple

from jaxtyping import Bool

from iswarm_mj.gripper.laws.detachment import BALL_DENSITY
from iswarm_mj.utils.arrays import Array, Quantity, array_module

HEAT_CAPACITY = 230.0
"""Heat capacity of SnAg solder [J/(kg K)]."""
MELTING_RISE = 196.0
"""Rise of temperature from 25 deg C to the eutectic at 221 deg C [K]."""
LATENT_HEAT = 59e3
"""Latent heat of melting [J/kg]."""


class Supply(NamedTuple):
    """Circuit that drives the current through a contact. SI units; the values are choices."""

    resistance: float = 1e4
    """Resistance in series, of a voltage amplifier that limits its current [Ohm]."""
    contact: float = 1e3
    """Resistance of the contact after its oxide broke down [Ohm]."""
    conductance: float = 4e-6
    """Heat that flows off per kelvin [W/K].

    It is 2 k a through the spot on the steel plate, with k = 16 W/(m K) and a = 0.13 um.
    """


def contact_power(voltage: Quantity, supply: Supply) -> Quantity:
    """Return the heat in a broken-down contact, V^2 R_c / (R_s + R_c)^2 [W].

    Valid while the supply holds its voltage.
    """
    return voltage**2 * supply.contact / (supply.resistance + supply.contact) ** 2


def melts(
    voltage: Quantity,
    radius: Quantity,
    breaks_at: Quantity,
    supply: Supply,
    time: Quantity,
    density: Quantity = BALL_DENSITY,
) -> Bool[Array, "..."]:
    """Return whether a ball that touches plate and tool melts.

    It does if the oxide breaks down and the current flows long enough. No current flows to the
    plate from a ball that hangs or flies, and the field's energy, some pJ, does not melt it.

    Args:
        voltage: of the tool against the plate [V].
        radius: of the ball [m].
        breaks_at: voltage at which the tool's oxide breaks down [V].
        supply: resistances, loss.
        time: for which ball, plate and tool touch under the voltage [s].
        density: of the ball [kg/m^3].
    """
    xp = array_module(voltage, radius, breaks_at, time)
    return xp.logical_and(
        xp.abs(voltage) >= breaks_at,
        melting_time(voltage, radius, supply, density) <= time,
    )


def melting_time(
    voltage: Quantity, radius: Quantity, supply: Supply, density: Quantity = BALL_DENSITY
) -> Quantity:
    """Return the time in which a discharge melts a ball; infinity if it never does [s].

    A ball of uniform temperature warms with C dT/dt = P - K dT, which takes
    -C / K ln(1 - K dT_m / P) up to the melting point, and then melts with the heat that is left,
    P - K dT_m.

    Args:
        voltage: of the tool against the plate [V].
        radius: of the ball [m].
        supply: resistances, loss.
        density: of the ball [kg/m^3].
    """
    xp = array_module(voltage, radius)
    mass = 4 / 3 * math.pi * radius**3 * density
    power = contact_power(voltage, supply)
    loss = supply.conductance * MELTING_RISE
    suffices = power > loss
    safe_power = xp.where(suffices, power, 2 * loss)
    warming = -mass * HEAT_CAPACITY / supply.conductance * xp.log1p(-loss / safe_power)
    melting = mass * LATENT_HEAT / (safe_power - loss)
    return xp.where(suffices, warming + melting, math.inf)
