"""How fast a ball leaves a surface after an impact: plastic yield, and the work against adhesion."""

import math

from iswarm_mj.utils.arrays import Quantity, array_module

YIELD_PRESSURE = 64e6
"""Contact pressure at which SnAg solder yields, 1.6 times its yield stress of 40 MPa; a choice [Pa]."""
MODULUS_PLATE, MODULUS_PROBE = 45.5e9, 33.3e9
"""Reduced moduli E* of SnAg on steel and on aluminium [Pa]."""


def yield_speed(pressure: Quantity, modulus: Quantity, density: Quantity) -> Quantity:
    """Impact speed above which a sphere yields, v_y = (pi / (2 E*))^2 (2 / (5 rho))^(1/2) p_y^(5/2).

    Source: Thornton and Ning 1998. Valid for a Hertzian contact with a plane, without rate effects.

    Args:
        pressure: p_y, contact pressure that the softer body bears [Pa].
        modulus: reduced modulus E* [Pa].
        density: of the sphere [kg/m^3].

    Returns:
        Speed [m/s].
    """
    return (math.pi / 2) ** 2 * (pressure / modulus) ** 2 * (0.4 * pressure / density) ** 0.5


def sticking_speed(work: Quantity, radius: Quantity, modulus: Quantity, density: Quantity) -> Quantity:
    """Impact speed up to which an elastic sphere sticks, v_s = 1.84 ((W / R)^5 / (rho^3 E*^2))^(1/6).

    Source: Thornton and Ning 1998, from the energy 7.09 (W^5 R^4 / E*^2)^(1/3) that a JKR contact keeps.

    Args:
        work: work of adhesion W [J/m^2].
        radius: of the sphere [m].
        modulus: reduced modulus E* [Pa].
        density: of the sphere [kg/m^3].

    Returns:
        Speed [m/s].
    """
    return 1.84 * (work / radius) ** (5 / 6) / (density**0.5 * modulus ** (1 / 3))


def plastic_ratio(share: Quantity) -> Quantity:
    """Restitution of a sphere that yields, without adhesion, from v_y / v.

    Source: Thornton and Ning 1998, Eq. 45: (6 sqrt(3) / 5)^(1/2) (1 - s^2 / 6)^(1/2)
    (s / (s + 2 (6 / 5 - s^2 / 5)^(1/2)))^(1/4); 1 at s = 1. Of plain operations, for compilers too.

    Args:
        share: s = v_y / v, above 0 and at most 1.
    """
    square = share * share
    ratio = share / (share + 2 * ((6 - square) / 5) ** 0.5)
    return (6 * 3**0.5 / 5) ** 0.5 * (1 - square / 6) ** 0.5 * ratio**0.25


def plastic_restitution(speed: Quantity, yields_at: Quantity) -> Quantity:
    """Restitution without adhesion at an impact speed; 1 up to `yields_at`, the `yield_speed` [m/s]."""
    xp = array_module(speed, yields_at)
    return plastic_ratio(xp.minimum(yields_at / xp.maximum(speed, yields_at), 1.0))


def with_adhesion(restitution: Quantity, speed: Quantity, sticks_at: Quantity) -> Quantity:
    """Restitution with adhesion, e^2 = e_p^2 - (v_s / v)^2; 0 where the ball stays.

    Source: Thornton and Ning 1998 and Brach and Dunn 1992 alike: what adhesion keeps comes off the energy of the
    rebound. That a flattened contact adheres on a larger area is left out, so that balls stick too seldom.

    Args:
        restitution: e_p without adhesion.
        speed: of the impact, v [m/s].
        sticks_at: v_s, the speed whose energy adhesion keeps [m/s].
    """
    xp = array_module(restitution, speed, sticks_at)
    return xp.sqrt(xp.maximum(0.0, restitution**2 - (sticks_at / speed) ** 2))


def capture_restitution(speed: Quantity, sticks_at: Quantity) -> Quantity:
    """Greatest restitution e_p with which a ball stays at its first impact, v_s / v: what a field that pulls it away
    from the surface leaves (`with_adhesion`)."""
    return sticks_at / speed
