"""The capacitance of a ball in SI."""

import numpy as np

from iswarm_mj.gripper.laws import spline
from iswarm_mj.gripper.laws.probe_table import tables
from iswarm_mj.utils.scalar_backends import in_arrays


def capacitance(task, gap, radius, probe_radius, least=0.0):
    """Capacitance [F] to the probe ("pick") or to the plate ("release") across a gap [m]."""
    place, um = ("pick", "release").index(task), 1e6
    sizes = (np.asarray(size) * um for size in (radius, gap, least, probe_radius))
    return in_arrays(spline, np).shape_of(place, *sizes, *tables())[1] * 1e-15
