"""What a ball's contacts do from one physics step to the next: adhesion, impacts, charge, breakdown, potential.

The docstring of `plugin` describes these laws. Functions of numbers, which numba compiles and JAX traces, see
`utils.numbers`. Unless stated otherwise units are those of the bench: um, ug, ms, nN, V, fC, fF, TOhm.
"""

import math
from math import exp, sqrt
from typing import TypeAlias

from jaxtyping import Bool

from iswarm_mj.gripper.laws.adhesion import dmt_pull_off, van_der_waals_force
from iswarm_mj.gripper.laws.restitution import plastic_ratio, sticking_speed, yield_speed
from iswarm_mj.gripper.units import CLEARANCE
from iswarm_mj.utils.arrays import Array, Quantity
from iswarm_mj.utils.scalar_backends import where

Condition: TypeAlias = bool | Bool[Array, "..."]

ON_PLATE, ON_PROBE = 0.0, 1.0
"""The electrode whose potential the ball has; it starts with the probe's, and takes the plate's on contact."""


def adhesion_force(work: Quantity, hamaker: Quantity, radius: Quantity, gap: Quantity) -> Quantity:
    """Attraction of a ball by a surface [N]: pull-off force in contact, van der Waals attraction out of it; in SI.

    Out of contact the distance z of the surfaces is the gap plus z0 = sqrt(A / (12 pi W)), at which A R / (6 z^2) is
    the pull-off force.
    """
    apart = (gap > 0) & (hamaker > 0) & (work > 0)
    offset = sqrt(where(apart, hamaker / (12 * math.pi * where(apart, work, 1.0)), 1.0))
    attraction = van_der_waals_force(hamaker, radius, where(apart, gap + offset, 1.0))
    return where(gap <= 0, dmt_pull_off(radius, work), where(apart, attraction, 0.0))


def rebound_ratio(
    speed: Quantity,
    density: Quantity,
    radius: Quantity,
    work: Quantity,
    restitution: Quantity,
    pressure: Quantity,
    modulus: Quantity,
) -> Quantity:
    """Speed after an impact over that before, e^2 = e_p^2 - (v_s / v)^2, 0 if the ball stays; in SI.

    Source: Thornton and Ning 1998, and Brach and Dunn 1992: what adhesion keeps, v_s of `laws.restitution`, comes off
    the energy of the rebound. That a flattened contact adheres on a larger area is left out, so that balls stick too
    seldom.

    Args:
        speed: of the impact, above 0.
        density: of the ball.
        radius: of the ball.
        work: of adhesion.
        restitution: without adhesion, where nothing yields.
        pressure: at which the ball yields, 0: never.
        modulus: reduced modulus, 0: adhesion keeps nothing.
    """
    has_modulus = modulus > 0
    yields, stiffness = (pressure > 0) & has_modulus, where(has_modulus, modulus, 1.0)
    share = yield_speed(pressure, stiffness, density) / speed
    plastic = plastic_ratio(where(yields & (share < 1), share, 1.0))
    ratio = where(yields, plastic, restitution)
    kept = where(has_modulus, sticking_speed(work, radius, stiffness, density) / speed, 0.0)
    left = ratio * ratio - kept * kept
    leaves = (ratio > 0) & (left > 0)
    return where(leaves, sqrt(where(leaves, left, 1.0)), 0.0)


def speed_at_contact(before: Quantity, gap: Quantity, earlier: Quantity, now: Quantity) -> Quantity:
    """Speed at the moment when a gap closes, by linear interpolation between two steps; 0 if it was closed before.

    Args:
        before: gap one step earlier.
        gap: now.
        earlier: closing speed one step earlier.
        now: closing speed.
    """
    closes = (before > 0) & (gap <= 0)
    share = before / where(closes, before - gap, 1.0)
    return where(closes, earlier + share * (now - earlier), 0.0)


def rebounds_on(begins: Condition, rebound: Quantity, gap: Quantity, before: Quantity) -> Quantity:
    """1 while a ball is thrown back: from the step in which that begins until it is clear or falls back, else 0."""
    return where(begins, 1.0, where((gap > CLEARANCE) | (gap <= before), 0.0, rebound))


def ball_voltage(
    has_circuit: Condition,
    charge: Quantity,
    potential: Quantity,
    voltage: Quantity,
    capacitances: tuple[Quantity, Quantity],
    plate_gap: Quantity,
) -> Quantity:
    """Voltage of the ball against the plate, by its charge or by the electrode whose potential it has."""
    above, below = capacitances
    switched = where((potential > 0.5) & (plate_gap > 0), voltage, 0.0)
    return where(has_circuit, (charge + above * voltage) / (above + below), switched)


def is_broken(across: Quantity, probe_gap: Quantity, broken: Quantity, least: Quantity, strength: Quantity) -> Quantity:
    """1 once the oxide of the tool's contact broke down, at the voltage `strength`, until the tool leaves it."""
    return where((probe_gap <= 0) & (abs(across) >= strength), 1.0, where(probe_gap > least, 0.0, broken))


def relaxed_charge(
    charge: Quantity,
    mine: Quantity,
    voltage: Quantity,
    capacitances: tuple[Quantity, Quantity],
    to_probe: Quantity,
    to_plate: Quantity,
    time: Quantity,
) -> Quantity:
    """Charge after a time in which the ball conducts to probe and plate; exact for constant capacitances.

    Args:
        charge: of the ball.
        mine: its voltage.
        voltage: of the probe.
        capacitances: to probe and plate.
        to_probe: conductance of the probe's contact, 0 out of contact.
        to_plate: conductance of the plate's contact.
        time: that passes.
    """
    above, below = capacitances
    total = to_probe + to_plate
    end = voltage * to_probe / where(total > 0, total, 1.0)
    now = end + (mine - end) * exp(-total * time / (above + below))
    return where(total > 0, below * now - above * (voltage - now), charge)


def next_potential(
    has_circuit: Condition,
    potential: Quantity,
    mine: Quantity,
    voltage: Quantity,
    gaps: tuple[Quantity, Quantity],
    least: Quantity,
    off_voltage: Quantity,
) -> Quantity:
    """Electrode whose potential the ball has after a step; in a circuit the nearer of the two."""
    probe_gap, plate_gap = gaps
    equalises = (probe_gap <= least) & (abs(voltage) <= off_voltage)
    switched = where(plate_gap <= 0, ON_PLATE, where(equalises, ON_PROBE, potential))
    return where(has_circuit, where(abs(mine) > abs(voltage - mine), ON_PROBE, ON_PLATE), switched)
