"""Capacitance of a ball, in SI units, from the package's tables."""

import numpy as np

from iswarm_mj.gripper.laws import spline
from iswarm_mj.gripper.laws.probe_table import tables
from iswarm_mj.utils.scalar_backends import in_arrays


def capacitance(task, gap, radius, probe_radius, least=0.0):
    """Return the capacitance to the probe ("pick") or to the plate ("release") [F].

    Args:
        task: "pick" or "release".
        gap: between the ball and the probe or the plate [m].
        radius: of the ball [m].
        probe_radius: of the probe [m].
        least: smallest gap that the field sees [m].
    """
    table = ("pick", "release").index(task)
    sizes_in_um = (1e6 * np.asarray(size) for size in (radius, gap, least, probe_radius))
    _, femtofarads = in_arrays(spline, np).shape_of(table, *sizes_in_um, *tables())
    return femtofarads * 1e-15
