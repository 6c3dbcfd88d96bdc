"""Voltages that lift or release a ball, and the outcome of a grasp or a release at a voltage.

The default constants are a calibration, not measurements. Fitted to the paper's experiments at 10 %
RH: W_TO to the release voltages, W_OS to the grasp voltages given D_eff, D_eff to "no lift without
contact below 50 V", and the two spreads to the widths of the voltage bands. Neither voltage depends
on the ball's radius, since pull-off and electrical force are proportional to it. The ratio of the
two works, 10.4, is fitted; `roughness` gives the roughnesses that would make it. The weakest
assumption is that the ball stays at the substrate's potential while the tool touches it, see
`bench.trial`.

Arguments in SI: `voltage` of the tool against the substrate [V], `radius` of the ball [m], works of
adhesion `work_tool_object` W_TO and `work_object_substrate` W_OS [J/m^2], `probe_radius` of the
tool [m], `density` of the ball [kg/m^3]; `gap` is that between tool and ball in a grasp, the
effective electrical one, and between ball and substrate in a release [m].

Grasps follow Eq. 5 with the weight, releases section 3.2.1, Fig. 2(b), with the weight; both with
DMT pull-offs, and valid within the range of `probe_table`.
"""

import math

from jaxtyping import Bool

from iswarm_mj.gripper.laws.adhesion import dmt_pull_off
from iswarm_mj.gripper.laws.electrostatics import pick_force, release_force
from iswarm_mj.gripper.units import VACUUM_PERMITTIVITY
from iswarm_mj.utils.arrays import Array, Quantity, array_module

WORK_TOOL_OBJECT = 1.41e-3
"""Median work of adhesion between tool and ball at 10 % RH, calibrated [J/m^2]."""
WORK_OBJECT_SUBSTRATE = 14.7e-3
"""Median work of adhesion between ball and plate at 10 % RH, calibrated [J/m^2]."""
VARIATION_TOOL_OBJECT = 0.12
"""Coefficient of variation of W_TO from trial to trial, log-normal; calibrated."""
VARIATION_OBJECT_SUBSTRATE = 0.16
"""Coefficient of variation of W_OS from trial to trial, log-normal; calibrated."""
CONTACT_GAP = 0.20e-6
"""D_eff, effective electrical gap of a tool that touches the ball [m]; calibrated."""
PROBE_RADIUS = 13e-6
"""Radius of the tool, a wire of 26 um in diameter [m]."""
RELEASE_GAP = 5e-6
"""Gap between ball and substrate at which the ball is released [m]."""
MELTING_VOLTAGE = 70.0
"""Voltage at which a ball in contact was seen to melt [V]."""
BALL_DENSITY = 7400.0
"""Density of Sn 96.5 Ag 3.5 solder [kg/m^3]."""
GRAVITY = 9.81
"""Acceleration of gravity [m/s^2]."""

EQ3_CONSTANT = math.sqrt(2 / VACUUM_PERMITTIVITY)
"""Constant of Eq. 3 by Eqs. 1 (DMT) and 2, sqrt(2 / eps0) = 4.7527e5 [V/sqrt(J/m)]."""
PRINTED_EQ3_CONSTANT = 5.49e5
"""Constant of Eq. 3 as printed, sqrt(8 / (3 eps0)), which does not follow from Eqs. 1 and 2."""


def detachment_voltage(work: Quantity, gap: Quantity, constant: float = EQ3_CONSTANT) -> Quantity:
    """Return the voltage that overcomes adhesion across a gap, V = sqrt(2 W D / eps0) [V].

    Source: Eq. 3, without weight. Valid for D << R and a stiff (DMT) contact.

    Args:
        work: work of adhesion [J/m^2].
        gap: D, across which the voltage acts [m].
        constant: `EQ3_CONSTANT`, or `PRINTED_EQ3_CONSTANT` for the paper's numbers [V/sqrt(J/m)].
    """
    xp = array_module(work, gap)
    return constant * xp.sqrt(work) * xp.sqrt(gap)


def ball_weight(
    radius: Quantity,
    density: Quantity = BALL_DENSITY,
    gravity: float = GRAVITY,
) -> Quantity:
    """Return the weight of a ball, 4/3 pi R^3 rho g [N]."""
    return 4 / 3 * math.pi * radius**3 * density * gravity


def scattered_work(work: Quantity, variation: Quantity, standard_normal: Quantity) -> Quantity:
    """Return the work of adhesion of one trial, W exp(z sqrt(ln(1 + cv^2))) [J/m^2].

    It is log-normal about its median.

    Args:
        work: median [J/m^2].
        variation: coefficient of variation cv.
        standard_normal: the trial's draw z.
    """
    xp = array_module(work, variation, standard_normal)
    return work * xp.exp(xp.sqrt(xp.log1p(xp.asarray(variation) ** 2)) * standard_normal)


def grasp_deficit(
    radius: Quantity,
    work_tool_object: Quantity = WORK_TOOL_OBJECT,
    work_object_substrate: Quantity = WORK_OBJECT_SUBSTRATE,
    density: Quantity = BALL_DENSITY,
) -> Quantity:
    """Return the force that the voltage must add to lift a touched ball, F_OS + weight - F_TO [N].

    It is below 0 where adhesion suffices.
    """
    adhesion = dmt_pull_off(radius, work_object_substrate - work_tool_object)
    return adhesion + ball_weight(radius, density)


def release_deficit(
    radius: Quantity,
    work_tool_object: Quantity = WORK_TOOL_OBJECT,
    density: Quantity = BALL_DENSITY,
) -> Quantity:
    """Return the force that the voltage must add to drop a held ball, F_TO - weight [N].

    It is below 0 where the weight suffices.
    """
    return dmt_pull_off(radius, work_tool_object) - ball_weight(radius, density)


def is_grasped(
    voltage: Quantity,
    radius: Quantity,
    work_tool_object: Quantity = WORK_TOOL_OBJECT,
    work_object_substrate: Quantity = WORK_OBJECT_SUBSTRATE,
    gap: Quantity = CONTACT_GAP,
    probe_radius: Quantity = PROBE_RADIUS,
) -> bool | Bool[Array, "..."]:
    """Return whether a touching tool lifts the ball, F_C(pick) + F_TO > F_OS + weight (Eq. 5)."""
    force = pick_force(voltage, gap, radius, probe_radius)
    return force > grasp_deficit(radius, work_tool_object, work_object_substrate)


def is_released(
    voltage: Quantity,
    radius: Quantity,
    work_tool_object: Quantity = WORK_TOOL_OBJECT,
    gap: Quantity = RELEASE_GAP,
    probe_radius: Quantity = PROBE_RADIUS,
) -> bool | Bool[Array, "..."]:
    """Return whether a held ball leaves the tool, F_C(release) + weight > F_TO (Fig. 2b)."""
    force = release_force(voltage, gap, radius, probe_radius)
    return force > release_deficit(radius, work_tool_object)


def grasp_voltage(
    radius: Quantity,
    work_tool_object: Quantity = WORK_TOOL_OBJECT,
    work_object_substrate: Quantity = WORK_OBJECT_SUBSTRATE,
    gap: Quantity = CONTACT_GAP,
    probe_radius: Quantity = PROBE_RADIUS,
    density: Quantity = BALL_DENSITY,
) -> Quantity:
    """Return the least voltage at which a touching tool lifts the ball [V].

    It is 0 where adhesion suffices.

    Args:
        radius: of the ball [m].
        work_tool_object: work of adhesion between tool and ball [J/m^2].
        work_object_substrate: work of adhesion between ball and plate [J/m^2].
        gap: effective electrical gap between tool and ball [m].
        probe_radius: radius of the tool [m].
        density: of the ball [kg/m^3].
    """
    deficit = grasp_deficit(radius, work_tool_object, work_object_substrate, density)
    return least_voltage(deficit, pick_force(1.0, gap, radius, probe_radius))


def release_voltage(
    radius: Quantity,
    work_tool_object: Quantity = WORK_TOOL_OBJECT,
    gap: Quantity = RELEASE_GAP,
    probe_radius: Quantity = PROBE_RADIUS,
    density: Quantity = BALL_DENSITY,
) -> Quantity:
    """Return the least voltage at which a held ball leaves the tool [V].

    It is 0 where its weight suffices.

    Args:
        radius: of the ball [m].
        work_tool_object: work of adhesion between tool and ball [J/m^2].
        gap: between ball and plate [m].
        probe_radius: radius of the tool [m].
        density: of the ball [kg/m^3].
    """
    deficit = release_deficit(radius, work_tool_object, density)
    return least_voltage(deficit, release_force(1.0, gap, radius, probe_radius))


def least_voltage(deficit: Quantity, force_per_volt2: Quantity) -> Quantity:
    """Return the voltage whose force is the deficit, 0 where there is none [V]."""
    xp = array_module(deficit, force_per_volt2)
    needed = deficit > 0
    return xp.where(needed, xp.sqrt(xp.where(needed, deficit / force_per_volt2, 1.0)), 0.0)
