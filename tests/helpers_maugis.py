"""Pull-off force between the limits of soft and stiff contacts."""

import math

from iswarm_mj.utils.arrays import Quantity, array_module

GOLDEN = (math.sqrt(5) - 1) / 2


def tabor_parameter(
    radius: Quantity, work: Quantity, reduced_modulus: Quantity, equilibrium_separation: Quantity
) -> Quantity:
    """Tabor parameter mu = (R W^2 / (E*^2 z0^3))^(1/3), elastic stretch over the range of adhesion.

    Source: Tabor 1977. Small: DMT; large: JKR. The Maugis parameter is lambda = 1.157 mu.

    Args:
        radius: radius of the sphere [m].
        work: work of adhesion [J/m^2].
        reduced_modulus: E*, with 1/E* = (1 - nu1^2)/E1 + (1 - nu2^2)/E2 [Pa].
        equilibrium_separation: z0, distance of the surfaces in equilibrium, 0.16-0.4 nm [m].

    Returns:
        mu, a pure number.
    """
    xp = array_module(radius, work, reduced_modulus, equilibrium_separation)
    # Grouped so that no factor leaves the range of float32.
    stretch = work / (reduced_modulus * equilibrium_separation)
    return xp.cbrt(radius / equilibrium_separation * stretch**2)


def maugis_pull_off(radius: Quantity, work: Quantity, maugis_parameter: Quantity) -> Quantity:
    """Pull-off force of a Dugdale contact, F = -pi W R min P(lambda), from 2 pi R W down to 3/2 pi R W.

    Source: Maugis 1992 (load control). With the contact radius a = c cos(t), his two equations become one
    quadratic in the edge c of the adhesive ring for each angle t in (0, pi/2]; the pull-off is the smallest
    load over t. Valid for all lambda, clamped to 1e-9 to 1e3, where the limits are reached. Differentiable:
    at the minimum the load does not depend on t; in float32 the slope against lambda is good to 3e-3.

    Args:
        radius: radius of the sphere [m].
        work: work of adhesion [J/m^2].
        maugis_parameter: lambda = 1.157 times `tabor_parameter`.

    Returns:
        Force to separate them, positive [N].
    """
    xp = array_module(radius, work, maugis_parameter)
    lam = xp.clip(xp.asarray(maugis_parameter, dtype=float), 1e-9, 1e3)
    low, high = xp.full_like(lam, math.log(1e-4)), xp.full_like(lam, math.log(math.pi / 2))
    for _ in range(35):
        step = GOLDEN * (high - low)
        falls = _load(lam, xp.exp(low + step)) < _load(lam, xp.exp(high - step))
        low, high = xp.where(falls, high - step, low), xp.where(falls, high, low + step)
    return -math.pi * radius * work * _load(lam, xp.exp(high))


def _load(lam: Quantity, angle: Quantity) -> Quantity:
    """Load P / (pi W R) of the contact whose radius is a = c cos(angle)."""
    xp = array_module(lam, angle)
    twice = 2 * angle
    # sin(x) - x cos(x) loses its digits below x = 0.5.
    x = xp.minimum(twice, 0.5)
    series = x**3 / 3 * (1 - x**2 / 10 * (1 - x**2 / 28 * (1 - x**2 / 54)))
    bend = xp.where(twice < 0.5, series, xp.sin(twice) - twice * xp.cos(twice)) / 2
    square = lam / 2 * bend
    linear = 4 * lam**2 / 3 * (angle * xp.sin(angle) - 2 * xp.sin(angle / 2) ** 2)
    edge = 2 / (linear + xp.sqrt(linear**2 + 4 * square))
    return (edge * xp.cos(angle)) ** 3 - lam * edge**2 * (xp.sin(twice) / 2 + angle)
