"""Boundary elements of axisymmetric conductors above a grounded plane.

The unknown is the surface charge density, constant on each ring-shaped element. The potential of a
ring is a complete elliptic integral; the grounded plane z = 0 is an image of opposite sign; the
force on a sphere is the integral of the Maxwell stress sigma^2 / (2 eps0). Potentials are in units
of the applied one, and eps0 = 1.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

RESOLUTION = 0.25
"""Length of an element of the coarsest mesh over the distance to the nearest other surface or
corner."""

_NEAR = 2.5
"""Distance below which a point is near to an element, in widths of the element."""
_N_NODES = 4
"""Number of nodes on an element for points that are far from it."""
_N_NODES_NEAR = 16
"""Number of nodes on either side of the nearest point, for points that are near."""

Curve = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Elements:
    """Rings cut from one generating curve.

    Attributes:
        curve: arc length (...) -> (r, z), each (...).
        start: (n,) arc length at which an element begins.
        end: (n,) arc length at which it ends.
    """

    curve: Curve
    start: np.ndarray
    end: np.ndarray

    @property
    def width(self) -> Float[np.ndarray, "n"]:
        """Lengths of the elements along the curve."""
        return self.end - self.start

    @property
    def middles(self) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """Middles (r, z) of the elements."""
        return self.curve((self.start + self.end) / 2)


def cut(
    curve: Curve,
    length: tuple[float, float],
    size: Callable[[np.ndarray], np.ndarray],
    halvings: int,
) -> Elements:
    """Return elements of `RESOLUTION` times a size in length, between two arc lengths.

    Args:
        curve: that is cut.
        length: arc lengths at which the first element begins and the last one ends.
        size: function of the arc length.
        halvings: number of times that each element is halved.
    """
    share = (1 - np.cos(np.linspace(0, np.pi, 4001))) / 2
    arc_length = length[0] + (length[1] - length[0]) * share

    # Elements before each arc length, as a number that need not be whole.
    density = 1 / size(arc_length)
    steps = np.diff(arc_length) * (density[1:] + density[:-1]) / 2
    count = np.concatenate([[0.0], np.cumsum(steps)])

    n_coarse = max(2, int(np.ceil(count[-1] / RESOLUTION)))
    n_elements = n_coarse * 2**halvings
    edges = np.interp(np.linspace(0, count[-1], n_elements + 1), count, arc_length)
    return Elements(curve, edges[:-1], edges[1:])


def ring_potential(r, z, ring_r, ring_z):
    """Return the potential of a ring per unit of charge density times width, r' K(m) / (pi d).

    d is the distance of the far side of the ring.
    """
    from scipy.special import ellipkm1  # takes long, and flags need this module

    far = (r + ring_r) ** 2 + (z - ring_z) ** 2
    near = (r - ring_r) ** 2 + (z - ring_z) ** 2
    return ring_r * ellipkm1(near / far) / (np.pi * np.sqrt(far))


def _potentials(
    r: Float[np.ndarray, "m"], z: Float[np.ndarray, "m"], part: Elements, side: float
) -> Float[np.ndarray, "m n"]:
    """Return the potentials at points of the elements of a part.

    Args:
        r: distance of the points from the axis.
        z: height of the points.
        part: with n elements of charge density 1.
        side: 1, or -1 for the image of the part below the plane.
    """
    # All elements by few nodes, as if they were far from the points.
    node, weight = np.polynomial.legendre.leggauss(_N_NODES)
    width = part.width
    ring_r, ring_z = part.curve(part.start[:, None] + width[:, None] * (node + 1) / 2)
    kernel = ring_potential(r[:, None, None], z[:, None, None], ring_r, side * ring_z)
    potentials = kernel @ (weight / 2) * width

    # Those that are near by more nodes, since the kernel has a pole at the point.
    nearest_share, distance = _nearest_points(r, z, part, side)
    point, element = np.nonzero(distance < _NEAR * width)
    potentials[point, element] = _near_potentials(
        r=r[point],
        z=z[point],
        part=part,
        element=element,
        nearest_share=nearest_share[point, element],
        side=side,
    )
    return potentials


def _nearest_points(
    r: Float[np.ndarray, "m"], z: Float[np.ndarray, "m"], part: Elements, side: float
) -> tuple[Float[np.ndarray, "m n"], Float[np.ndarray, "m n"]]:
    """Return where the chord of each element is nearest to each point, and the distance.

    The place is a share of the chord, from 0 at the start to 1 at the end. Arguments as
    `_potentials`.
    """
    start_r, start_z = part.curve(part.start)
    end_r, end_z = part.curve(part.end)

    # Vectors from the start of each element: along its chord, and to each point.
    chord_r = end_r - start_r
    chord_z = side * (end_z - start_z)
    point_r = r[:, None] - start_r
    point_z = z[:, None] - side * start_z

    # The nearest point is the projection on the chord, at most one of its ends.
    projection = point_r * chord_r + point_z * chord_z
    squared_length = chord_r**2 + chord_z**2
    share = np.clip(projection / squared_length, 0, 1)
    distance = np.hypot(point_r - share * chord_r, point_z - share * chord_z)
    return share, distance


def _near_potentials(
    r: Float[np.ndarray, "p"],
    z: Float[np.ndarray, "p"],
    part: Elements,
    element: np.ndarray,
    nearest_share: Float[np.ndarray, "p"],
    side: float,
) -> Float[np.ndarray, "p"]:
    """Return the potentials of elements at points near to them.

    Each element is split at the nearest point, towards which the nodes crowd.

    Args:
        r: distance of the points from the axis.
        z: height of the points.
        part: to which the elements belong.
        element: (p,) index of the element of each point.
        nearest_share: where the element is nearest to its point, see `_nearest_points`.
        side: 1, or -1 for the image of the part.
    """
    # Gauss-Legendre nodes u from 0 to 1, moved to u^4, and their weights with its derivative.
    node, weight = np.polynomial.legendre.leggauss(_N_NODES_NEAR)
    u = (node + 1) / 2
    crowded = u**4
    weight_of_crowded = 2 * u**3 * weight

    # From the nearest point to the start of the element, and to its end.
    before = nearest_share[:, None]
    after = 1 - before
    place = np.concatenate([before * (1 - crowded), before + after * crowded], axis=1)
    weights = np.concatenate([before * weight_of_crowded, after * weight_of_crowded], axis=1)

    width = part.width
    ring_r, ring_z = part.curve(part.start[element, None] + width[element, None] * place)
    kernel = ring_potential(r[:, None], z[:, None], ring_r, side * ring_z)
    return (kernel * weights).sum(axis=1) * width[element]


def charge_densities(
    parts: list[Elements], potentials: list[Callable[..., np.ndarray] | float]
) -> list[np.ndarray]:
    """Return the charge densities of the elements of each part that hold the parts at potentials.

    Args:
        parts: surfaces above the grounded plane z = 0.
        potentials: one for each part; a number, or a function of (r, z) where an outer field adds
            to it.
    """
    middles = [part.middles for part in parts]
    r, z = (np.concatenate(values) for values in zip(*middles, strict=True))
    columns = [_potentials(r, z, part, 1.0) - _potentials(r, z, part, -1.0) for part in parts]

    wanted = []
    for potential, middle in zip(potentials, middles, strict=True):
        if callable(potential):
            wanted.append(potential(*middle))
        else:
            wanted.append(np.full(middle[0].shape, potential))

    density = np.linalg.solve(np.hstack(columns), np.concatenate(wanted))
    ends = np.cumsum([part.start.size for part in parts])
    return np.split(density, ends[:-1])


def sphere_curve(centre: float) -> Curve:
    """Return the unit sphere about a centre, by the angle from its lowest point."""
    return lambda s: (np.sin(s), centre - np.cos(s))


def upward_force(sphere: Elements, density: np.ndarray) -> float:
    """Return the vertical force on the sphere.

    It is the integral of sigma^2 / 2 times the vertical part of the normal.
    """
    area = -np.pi * (np.sin(sphere.end) ** 2 - np.sin(sphere.start) ** 2)
    return float(np.sum(density**2 / 2 * area))
