"""Restitution of a ball after an impact: plastic yield, and the work against adhesion.

Arguments in SI: contact `pressure` p_y that the softer body bears [Pa], reduced `modulus` E* [Pa],
`density` rho and `radius` R of the sphere, work of adhesion `work` W [J/m^2]; speeds [m/s].
"""

import math

from iswarm_mj.utils.arrays import Quantity

YIELD_PRESSURE = 64e6
"""Contact pressure at which SnAg solder yields [Pa]: 1.6 times its yield stress of 40 MPa."""
MODULUS_PLATE, MODULUS_PROBE = 45.5e9, 33.3e9
"""Reduced moduli E* of SnAg on steel and on aluminium [Pa]."""


def yield_speed(pressure: Quantity, modulus: Quantity, density: Quantity) -> Quantity:
    """Return the impact speed above which a sphere yields.

    v_y = (pi / (2 E*))^2 (2 / (5 rho))^(1/2) p_y^(5/2).

    Source: Thornton and Ning 1998. Valid for a Hertzian contact with a plane, without rate effects.
    """
    return (math.pi / 2) ** 2 * (pressure / modulus) ** 2 * (0.4 * pressure / density) ** 0.5


def sticking_speed(
    work: Quantity,
    radius: Quantity,
    modulus: Quantity,
    density: Quantity,
) -> Quantity:
    """Return the impact speed up to which an elastic sphere sticks.

    v_s = 1.84 ((W / R)^5 / (rho^3 E*^2))^(1/6).

    Source: Thornton and Ning 1998, from the energy 7.09 (W^5 R^4 / E*^2)^(1/3) that a JKR contact
    keeps.
    """
    return 1.84 * (work / radius) ** (5 / 6) / (density**0.5 * modulus ** (1 / 3))


def plastic_ratio(share: Quantity) -> Quantity:
    """Return the restitution of a sphere that yields, without adhesion.

    Source: Thornton and Ning 1998, Eq. 45: (6 sqrt(3) / 5)^(1/2) (1 - s^2 / 6)^(1/2)
    (s / (s + 2 (6 / 5 - s^2 / 5)^(1/2)))^(1/4); 1 at s = 1. Of plain operations, for compilers too.

    Args:
        share: s = v_y / v, above 0 and at most 1.
    """
    square = share * share
    ratio = share / (share + 2 * ((6 - square) / 5) ** 0.5)
    return (6 * 3**0.5 / 5) ** 0.5 * (1 - square / 6) ** 0.5 * ratio**0.25
