"""Restitution of an impact, as a function that Numba compiles."""

import math

from iswarm_mj.gripper.laws import restitution
from iswarm_mj.gripper.native.fields import compiled
from iswarm_mj.gripper.units import MS, PRESSURE, UM

_ratio = compiled(restitution.plastic_ratio)
_yield_speed = compiled(restitution.yield_speed)
_sticking_speed = compiled(restitution.sticking_speed)


@compiled
def rebound_ratio(speed, mass, radius, work, fixed, pressure, modulus):
    """Speed after an impact over that before, 0 if the ball stays; see `laws.restitution`.

    Speed in um/ms, mass in ug, radius in m, work in J/m^2; yield pressure (0: the fixed restitution) and modulus
    (0: adhesion keeps nothing) in nN/um^2.
    """
    speed = speed * (UM / MS)
    density = mass * 1e-9 / (4 / 3 * math.pi * radius**3)
    if pressure > 0 and modulus > 0:
        yields_at = _yield_speed(pressure * PRESSURE, modulus * PRESSURE, density)
        fixed = _ratio(min(1.0, yields_at / speed))
    if fixed <= 0:
        return 0.0
    kept = _sticking_speed(work, radius, modulus * PRESSURE, density) / speed if modulus > 0 else 0.0
    return math.sqrt(max(0.0, fixed * fixed - kept * kept))
