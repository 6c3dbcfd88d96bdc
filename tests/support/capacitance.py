"""Capacitance of a ball, in SI units, from the package's tables."""

import numpy as np

from iswarm_mj.gripper.laws import spline
from iswarm_mj.gripper.laws.probe_table import tables
from iswarm_mj.gripper.tips.table import read_table
from iswarm_mj.utils.scalar_backends import in_arrays


def capacitance(task, gap, radius, probe_radius, least=0.0, tip=None):
    """Return the capacitance to the probe ("pick") or to the plate ("release") [F].

    Args:
        task: "pick" or "release".
        gap: between the ball and the probe or the plate [m].
        radius: of the ball [m].
        probe_radius: of the probe [m].
        least: smallest gap that the field sees [m].
        tip: file of the table of a tip; None: a flat one.
    """
    table = ("pick", "release").index(task)
    sizes_in_um = (1e6 * np.asarray(size) for size in (radius, gap, least, probe_radius))
    splines_and_axes = tables() if tip is None else read_table(tip).tables
    _, femtofarads = in_arrays(spline, np).shape_of(table, *sizes_in_um, *splines_and_axes)
    return femtofarads * 1e-15
