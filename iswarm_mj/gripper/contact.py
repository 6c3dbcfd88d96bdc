"""Laws of a ball's contacts in a physics step: adhesion, impacts, charge, breakdown, potential.

The docstring of `plugin` describes these laws. They are functions of numbers, which numba
compiles and JAX traces, see `utils.scalar_backends`. Unless stated otherwise units are those of the
bench: um, ug, ms, nN, V, fC, fF, TOhm.
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
"""Electrode whose potential the ball has: at first the probe, and on contact the plate."""


def adhesion_force(work: Quantity, hamaker: Quantity, radius: Quantity, gap: Quantity) -> Quantity:
    """Return the attraction of a ball by a surface, in and out of contact [N].

    In contact it is the DMT pull-off force 2 pi R W. Out of contact it is the van der Waals
    attraction across the gap plus z0 = sqrt(A / (12 pi W)), at which A R / (6 z^2) is the pull-off
    force.

    Args:
        work: work of adhesion W [J/m^2].
        hamaker: Hamaker constant A [J]; 0: no attraction out of contact.
        radius: of the ball R [m].
        gap: of the surfaces, 0 or negative in contact [m].
    """
    attracts = (gap > 0) & (hamaker > 0) & (work > 0)
    positive_work = where(attracts, work, 1.0)
    offset = sqrt(where(attracts, hamaker / (12 * math.pi * positive_work), 1.0))
    attraction = van_der_waals_force(hamaker, radius, where(attracts, gap + offset, 1.0))
    return where(gap <= 0, dmt_pull_off(radius, work), where(attracts, attraction, 0.0))


def rebound_ratio(
    speed: Quantity,
    density: Quantity,
    radius: Quantity,
    work: Quantity,
    restitution: Quantity,
    pressure: Quantity,
    modulus: Quantity,
) -> Quantity:
    """Return the speed after an impact over that before, 0 if the ball stays.

    It is e with e^2 = e_p^2 - (v_s / v)^2.

    The loss by adhesion, with v_s of `laws.restitution`, comes off the energy of the rebound. A
    flattened contact adheres on a larger area, which is left out, so that balls stick too seldom.

    Source: Thornton and Ning 1998, and Brach and Dunn 1992.

    Args:
        speed: of the impact v, above 0 [m/s].
        density: of the ball [kg/m^3].
        radius: of the ball [m].
        work: work of adhesion [J/m^2].
        restitution: e_p without adhesion, where nothing yields.
        pressure: contact pressure at which the ball yields [Pa]; 0: never.
        modulus: reduced modulus [Pa]; 0: adhesion keeps nothing.
    """
    has_modulus = modulus > 0
    stiffness = where(has_modulus, modulus, 1.0)

    # Loss by plastic yield, at speeds above that of yield.
    yields = (pressure > 0) & has_modulus
    yield_share = yield_speed(pressure, stiffness, density) / speed
    plastic = plastic_ratio(where(yields & (yield_share < 1), yield_share, 1.0))
    ratio = where(yields, plastic, restitution)

    # Loss by adhesion.
    sticking_share = sticking_speed(work, radius, stiffness, density) / speed
    kept = where(has_modulus, sticking_share, 0.0)
    square = ratio * ratio - kept * kept
    leaves = (ratio > 0) & (square > 0)
    return where(leaves, sqrt(where(leaves, square, 1.0)), 0.0)


def speed_at_contact(
    previous_gap: Quantity,
    gap: Quantity,
    previous_speed: Quantity,
    speed: Quantity,
) -> Quantity:
    """Return the speed at which a gap closes in this step; 0 if it does not, or was closed before.

    Interpolated linearly between two steps.

    Args:
        previous_gap: one step earlier.
        gap: at this step.
        previous_speed: closing speed one step earlier.
        speed: closing speed at this step.
    """
    closes = (previous_gap > 0) & (gap <= 0)
    share = previous_gap / where(closes, previous_gap - gap, 1.0)
    return where(closes, previous_speed + share * (speed - previous_speed), 0.0)


def rebounds_on(
    begins: Condition,
    rebound: Quantity,
    gap: Quantity,
    previous_gap: Quantity,
) -> Quantity:
    """Return 1 while a ball is thrown back, else 0.

    It is from the step in which a rebound begins until it is clear of the surface or falls back.
    """
    is_over = (gap > CLEARANCE) | (gap <= previous_gap)
    return where(begins, 1.0, where(is_over, 0.0, rebound))


def ball_voltage(
    has_circuit: Condition,
    charge: Quantity,
    potential: Quantity,
    voltage: Quantity,
    capacitances: tuple[Quantity, Quantity],
    plate_gap: Quantity,
) -> Quantity:
    """Return the voltage of the ball against the plate.

    In a circuit it is u = (Q + C_t V) / (C_t + C_p), otherwise that of an electrode.

    Args:
        has_circuit: the ball is in a circuit.
        charge: of the ball Q.
        potential: `ON_PLATE` or `ON_PROBE`, without a circuit.
        voltage: of the probe V.
        capacitances: of the ball to probe and plate, C_t and C_p.
        plate_gap: of ball and plate.
    """
    to_probe, to_plate = capacitances
    of_electrode = where((potential > 0.5) & (plate_gap > 0), voltage, 0.0)
    in_circuit = (charge + to_probe * voltage) / (to_probe + to_plate)
    return where(has_circuit, in_circuit, of_electrode)


def is_broken(
    across: Quantity,
    probe_gap: Quantity,
    broken: Quantity,
    least_gap: Quantity,
    strength: Quantity,
) -> Quantity:
    """Return 1 from the breakdown of the oxide in the tool's contact until the tool leaves, else 0.

    Args:
        across: voltage across the contact.
        probe_gap: of ball and probe.
        broken: before this step.
        least_gap: effective electrical gap of a contact, beyond which the tool has left.
        strength: voltage that breaks the oxide.
    """
    breaks = (probe_gap <= 0) & (abs(across) >= strength)
    return where(breaks, 1.0, where(probe_gap > least_gap, 0.0, broken))


def relaxed_charge(
    charge: Quantity,
    ball_voltage: Quantity,
    voltage: Quantity,
    capacitances: tuple[Quantity, Quantity],
    probe_conductance: Quantity,
    plate_conductance: Quantity,
    time: Quantity,
) -> Quantity:
    """Return the charge after a time in which the ball conducts to probe and plate.

    The ball's voltage relaxes to that of the divider, u_e = V G_t / (G_t + G_p), as
    exp(-(G_t + G_p) t / (C_t + C_p)), which is exact for constant capacitances.

    Args:
        charge: of the ball.
        ball_voltage: of the ball against the plate.
        voltage: of the probe V.
        capacitances: to probe and plate, C_t and C_p.
        probe_conductance: of the probe's contact G_t, 0 out of contact.
        plate_conductance: of the plate's contact G_p, 0 out of contact.
        time: that passes t.
    """
    to_probe, to_plate = capacitances
    conductance = probe_conductance + plate_conductance
    conducts = conductance > 0
    end = voltage * probe_conductance / where(conducts, conductance, 1.0)
    decay = exp(-conductance * time / (to_probe + to_plate))
    relaxed = end + (ball_voltage - end) * decay
    return where(conducts, to_plate * relaxed - to_probe * (voltage - relaxed), charge)


def next_potential(
    has_circuit: Condition,
    potential: Quantity,
    ball_voltage: Quantity,
    voltage: Quantity,
    gaps: tuple[Quantity, Quantity],
    least_gap: Quantity,
    off_voltage: Quantity,
) -> Quantity:
    """Return the electrode whose potential the ball has after a step; in a circuit the nearer one.

    Args:
        has_circuit: the ball is in a circuit.
        potential: `ON_PLATE` or `ON_PROBE` before the step.
        ball_voltage: of the ball against the plate.
        voltage: of the probe.
        gaps: of the ball to probe and plate.
        least_gap: gap to the probe up to which the ball takes its potential.
        off_voltage: largest voltage of the probe at which it does so.
    """
    probe_gap, plate_gap = gaps
    takes_probes = (probe_gap <= least_gap) & (abs(voltage) <= off_voltage)
    switched = where(takes_probes, ON_PROBE, potential)
    switched = where(plate_gap <= 0, ON_PLATE, switched)
    is_nearer_probe = abs(ball_voltage) > abs(voltage - ball_voltage)
    in_circuit = where(is_nearer_probe, ON_PROBE, ON_PLATE)
    return where(has_circuit, in_circuit, switched)
