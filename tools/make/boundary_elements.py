"""Make the table of electrostatic forces on a ball between plate and probe, by boundary elements.

    python tools/make/boundary_elements.py        # a few minutes; writes the table of the package

The bodies are axisymmetric: a sphere between a plane and a cylindrical probe. The unknown is the
surface charge density, constant on each ring-shaped element. The potential of a ring is a complete
elliptic integral; the grounded plane z = 0 is an image of opposite sign; the force on the sphere is
the integral of the Maxwell stress sigma^2 / (2 eps0). Lengths are in sphere radii, potentials in
units of the applied one, and eps0 = 1.
"""

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.special import ellipkm1

from iswarm_mj.gripper.laws import probe_table
from iswarm_mj.gripper.laws.probe_table import FILE, GAP_EXPONENTS, PROBE_EXPONENTS

PROBE_LENGTH = 20.0
"""Length of the probe [sphere radii]; at small gaps the force does not depend on it."""

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
    curve: Curve, length: tuple[float, float], size: Callable[..., np.ndarray], halvings: int
) -> Elements:
    """Return elements of length `RESOLUTION` * size(r, z) between two arc lengths.

    Args:
        curve: that is cut.
        length: arc lengths at which the first element begins and the last one ends.
        size: function of (r, z).
        halvings: number of times that each element is halved.
    """
    share = (1 - np.cos(np.linspace(0, np.pi, 20001))) / 2
    arc_length = length[0] + (length[1] - length[0]) * share

    # Elements before each arc length, as a number that need not be whole.
    density = 1 / size(*curve(arc_length))
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
    node, weight = np.polynomial.legendre.leggauss(_N_NODES)
    width = part.width
    ring_r, ring_z = part.curve(part.start[:, None] + width[:, None] * (node + 1) / 2)
    kernel = ring_potential(r[:, None, None], z[:, None, None], ring_r, side * ring_z)
    potentials = kernel @ (weight / 2) * width

    foot, distance = _nearest_points(r, z, part, side)
    point, element = np.nonzero(distance < _NEAR * width)
    potentials[point, element] = _near_potentials(
        r[point], z[point], part, element, foot[point, element], side
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
    along_r = end_r - start_r
    along_z = side * (end_z - start_z)
    squared_length = along_r**2 + along_z**2
    from_start_r = r[:, None] - start_r
    from_start_z = z[:, None] - side * start_z
    foot = np.clip((from_start_r * along_r + from_start_z * along_z) / squared_length, 0, 1)
    distance = np.hypot(
        r[:, None] - start_r - foot * along_r, z[:, None] - side * start_z - foot * along_z
    )
    return foot, distance


def _near_potentials(
    r: Float[np.ndarray, "p"],
    z: Float[np.ndarray, "p"],
    part: Elements,
    element: np.ndarray,
    foot: Float[np.ndarray, "p"],
    side: float,
) -> Float[np.ndarray, "p"]:
    """Return the potentials of elements at points near to them.

    Each element is split at the nearest point, towards which the nodes crowd.

    Args:
        r: distance of the points from the axis.
        z: height of the points.
        part: to which the elements belong.
        element: (p,) index of the element of each point.
        foot: the nearest point, see `_nearest_points`.
        side: 1, or -1 for the image of the part.
    """
    node, weight = np.polynomial.legendre.leggauss(_N_NODES_NEAR)
    u = (node + 1) / 2
    crowded = u**4
    jacobian = 2 * u**3 * weight
    foot = foot[:, None]
    place = np.concatenate([foot * (1 - crowded), foot + (1 - foot) * crowded], axis=1)
    weights = np.concatenate([foot * jacobian, (1 - foot) * jacobian], axis=1)

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


def _contact_edge(probe_radius: float) -> float:
    """Return the angle within which the field of a touching contact is negligible.

    It is below exp(-20) of that at the contact's rim.
    """
    return 1 / (1 / min(probe_radius, 1.0) + 3.2)


def gripper_parts(
    gap: float,
    probe_radius: float,
    task: str,
    halvings: int = 0,
    probe_length: float = PROBE_LENGTH,
) -> list[Elements]:
    """Return the elements of the sphere and of the probe's face, wall and top.

    Args:
        gap: sphere to plane ("release", probe touching) or probe to sphere ("pick", plane touching)
            [radii].
        probe_radius: radius of the probe [radii].
        task: "release" or "pick".
        halvings: number of times that each element of the coarsest mesh is halved.
        probe_length: length of the probe [radii].
    """
    bottom = 2 + gap
    if task == "release":
        centre = 1 + gap
        rim = _contact_edge(probe_radius)
        sphere_angles = (0.0, np.pi - rim)
    else:
        centre = 1.0
        rim = 0.0
        sphere_angles = (_contact_edge(np.inf), np.pi)
    corner_gap = np.hypot(probe_radius, bottom - centre) - 1
    smallest = 0.02 * min(probe_radius, 1.0, corner_gap)

    def sphere_size(r, z):
        """Return the distance from the plane or the probe, 0.4 at most."""
        from_probe = np.hypot(bottom - z, np.maximum(r - probe_radius, 0))
        return np.minimum(np.minimum(z, 0.4), from_probe)

    def probe_size(r, z):
        """Return the distance from sphere, plane or corner, of a smallest size at the corners."""
        from_sphere = np.hypot(r, z - centre) - 1
        corner = np.hypot(r - probe_radius, z - bottom) + smallest
        top_corner = np.hypot(r - probe_radius, z - bottom - probe_length) + 0.05 * probe_radius
        return np.minimum.reduce([from_sphere, corner, top_corner, z])

    def face(s):
        return s, np.full_like(s, bottom)

    def wall(s):
        return np.full_like(s, probe_radius), bottom + s

    def top(s):
        return probe_radius - s, np.full_like(s, bottom + probe_length)

    return [
        cut(sphere_curve(centre), sphere_angles, sphere_size, halvings),
        cut(face, (np.sin(rim), probe_radius), probe_size, halvings),
        cut(wall, (0.0, probe_length), probe_size, halvings),
        cut(top, (0.0, probe_radius), probe_size, halvings),
    ]


def shape_factor(
    gap: float,
    probe_radius: float,
    task: str,
    halvings: int = 0,
    probe_length: float = PROBE_LENGTH,
) -> float:
    """Return the force on the sphere over that of the asymptote, F D / (R pi eps0 V^2).

    It is positive downwards for "release" (sphere and probe at V), and upwards for "pick" (sphere
    and plane at 0, probe at V). Arguments as `gripper_parts`.
    """
    parts = gripper_parts(gap, probe_radius, task, halvings, probe_length)
    ball_potential = 1.0 if task == "release" else 0.0
    sphere_density, *_ = charge_densities(parts, [ball_potential, 1.0, 1.0, 1.0])
    force = upward_force(parts[0], sphere_density)
    return gap / np.pi * (-force if task == "release" else force)


def extrapolated_factor(gap: float, probe_radius: float, task: str) -> float:
    """Return the shape factor without its error of second order in the length of the elements.

    This is Richardson's extrapolation.
    """
    coarse = shape_factor(gap, probe_radius, task, halvings=0)
    fine = shape_factor(gap, probe_radius, task, halvings=1)
    return (4 * fine - coarse) / 3


def table() -> str:
    """Return the table of shape factors."""
    lines = [
        "# F D / (R pi eps0 V^2); made by: python tools/make/boundary_elements.py",
        "# log2_D_over_R,log2_Rm_over_R,release,pick",
    ]
    for gap in GAP_EXPONENTS:
        for probe in PROBE_EXPONENTS:
            release = extrapolated_factor(2.0**gap, 2.0**probe, "release")
            pick = extrapolated_factor(2.0**gap, 2.0**probe, "pick")
            lines.append(f"{gap:.4f},{probe:.4f},{release:.6f},{pick:.6f}")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the table beside the module that reads it."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    beside_reader = Path(probe_table.__file__).with_name(FILE)
    parser.add_argument("--out", type=Path, default=beside_reader, help="the table")
    arguments = parser.parse_args()
    arguments.out.write_text(table(), encoding="utf-8")


if __name__ == "__main__":
    main()
