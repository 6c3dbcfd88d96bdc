"""Electrostatic force on a conducting sphere: alone above a plane, and between a plane and a probe.

Forces are positive [N]. Arguments in SI: `voltage` V between sphere, or probe, and plane [V],
closest distance `gap` D [m], `radius` R of the sphere and `probe_radius` R_m of the cylindrical
probe [m].
"""

import math

from iswarm_mj.gripper.laws.probe_table import probe_factor
from iswarm_mj.gripper.units import VACUUM_PERMITTIVITY
from iswarm_mj.utils.arrays import Quantity


def asymptotic_force(voltage: Quantity, gap: Quantity, radius: Quantity) -> Quantity:
    """Return the force between a sphere and a plane nearly touching, F = pi eps0 V^2 R / D.

    Source: Eq. 2. Valid for D << R; at D/R = 0.25 it is 31 % too high for a bare sphere.
    """
    return math.pi * VACUUM_PERMITTIVITY * voltage**2 * (radius / gap)


def release_force(
    voltage: Quantity,
    gap: Quantity,
    radius: Quantity,
    probe_radius: Quantity,
) -> Quantity:
    """Return the force towards the plane on a sphere that touches a probe.

    F = f(D/R, R_m/R) pi eps0 V^2 R / D, D from the plane.

    Source: f from boundary elements (sphere and probe at V, plane at 0, probe 20 R long), through
    `probe_table`, whose range is the validity; f -> 1, Eq. 2, for small gaps.
    """
    shape = probe_factor("release", gap / radius, probe_radius / radius)
    return shape * asymptotic_force(voltage, gap, radius)


def pick_force(
    voltage: Quantity,
    gap: Quantity,
    radius: Quantity,
    probe_radius: Quantity,
) -> Quantity:
    """Return the force with which a probe above attracts a sphere that lies on the plane.

    F = f(D/R, R_m/R) pi eps0 V^2 R / D, with the gap D between probe and sphere, the sphere's
    radius R and the probe's radius R_m. For small gaps f tends to 1, which is Eq. 2.

    Source: f is interpolated in a table of boundary elements (probe at V, sphere and plane at 0,
    probe 20 R long); `probe_table` says in which range, and what it does beyond.
    """
    shape = probe_factor("pick", gap / radius, probe_radius / radius)
    return shape * asymptotic_force(voltage, gap, radius)
