"""Units of the bench, its plugins and its model in MJX: um, ug, ms, hence nN; and V.

The laws take SI.
"""

UM = 1e-6
"""Length unit [m]."""
MS = 1e-3
"""Time unit [s]."""
UG = 1e-9
"""Mass unit [kg]."""
NN = 1e-9
"""Force unit [N].

The work of adhesion is in nN/um = mJ/m^2, the Hamaker constant in nN um = 1e-15 J.
"""
PER_OHM = 1e-12
"""Resistances of the bench, in ms / fF, over those in SI [1/Ohm]."""
CLEARANCE = 0.02
"""Gap at which a ball that rebounds has left a surface [um].

There van der Waals attraction is a thousandth of the pull-off.
"""

VACUUM_PERMITTIVITY = 8.8541878188e-12
"""Electric constant eps0, CODATA 2022 [F/m]."""
UG_PER_UM3 = 1e9
"""Density unit [kg/m^3]."""
DENSITY = 1e-9
"""Density of the bench, in ug/um^3, over that in SI [m^3/kg]."""
PRESSURE = NN / UM**2
"""Unit of pressure of the bench [Pa]."""
