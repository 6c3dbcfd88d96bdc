"""Conversion between the units that people use and those of the models.

People (configuration, records, plots, command line) use SI, or rd and steps where the paper does.
The arena's MJCF uses mm, mg and s, so its forces are in nN and its work of adhesion in
nN/mm = uJ/m^2. SI itself does not work in MuJoCo at this scale: the inertia of a 20 um ball,
4e-20 kg m^2, lies under its smallest allowed value.
"""

import math
from typing import Any

ROBOT_DIAMETER = 2.0 * math.sqrt(2.0) * 1e-3
"""Unit rd, "the maximum diameter of one robot" (Valdastri et al. 2006, Table 1) [m].

It is the diagonal of 2 x 2 mm, and a unit of length, as the paper uses it: it stays the same when
`models/robot.xml` describes a robot of another size.
"""

MM = 1e-3
"""One arena length unit [m]."""

RD = ROBOT_DIAMETER / MM
"""One robot diameter [mm]."""


def mm_from_rd(length: Any) -> Any:
    """Return a length in mm, the unit of the arena, from one in robot diameters [rd]."""
    return length * RD


def mg_from_kg(mass: Any) -> Any:
    """Return a mass in mg, the unit of the arena, from one in kilograms."""
    return mass * 1e6


def mm_from_m(length: Any) -> Any:
    """Return a length in mm, the unit of the arena, from one in metres."""
    return length / MM
