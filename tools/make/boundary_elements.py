"""Electrostatic force on a sphere between a plane and a cylindrical probe, by axisymmetric boundary
elements.

The unknown is the surface charge density, constant on each ring-shaped element; the potential of a
ring is a complete elliptic integral; the grounded plane z = 0 is an image of opposite sign; the
force on the sphere is the integral of the Maxwell stress sigma^2 / (2 eps0). Lengths are in sphere
radii, potentials in units of the applied one, and eps0 = 1. Needs SciPy. Makes the table of the
package:

    python tools/make/boundary_elements.py
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from iswarm_mj.gripper.laws import probe_table
from iswarm_mj.gripper.laws.probe_table import FILE, GAP_EXPONENTS, PROBE_EXPONENTS

PROBE_LENGTH = 20.0
"""Length of the probe [sphere radii]; at small gaps the force does not depend on it."""

RESOLUTION = 0.25
"""Length of an element of the coarsest mesh over the distance to the nearest other surface or
corner."""

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


def cut(
    curve: Curve, length: tuple[float, float], size: Callable[..., np.ndarray], halvings: int
) -> Elements:
    """Elements of length `RESOLUTION` * size(r, z) between two arc lengths, each halved `halvings`
    times."""
    s = length[0] + (length[1] - length[0]) * (1 - np.cos(np.linspace(0, np.pi, 20001))) / 2
    density = 1 / size(*curve(s))
    count = np.concatenate([[0.0], np.cumsum(np.diff(s) * (density[1:] + density[:-1]) / 2)])
    n = max(2, int(np.ceil(count[-1] / RESOLUTION))) * 2**halvings
    edges = np.interp(np.linspace(0, count[-1], n + 1), count, s)
    return Elements(curve, edges[:-1], edges[1:])


def ring_potential(r, z, ring_r, ring_z):
    """Potential of a ring per unit of charge density times width, r' K(m) / (pi d), d the far
    distance."""
    from scipy.special import ellipkm1

    far = (r + ring_r) ** 2 + (z - ring_z) ** 2
    near = (r - ring_r) ** 2 + (z - ring_z) ** 2
    return ring_r * ellipkm1(near / far) / (np.pi * np.sqrt(far))


def _influence(r: np.ndarray, z: np.ndarray, part: Elements, side: float) -> np.ndarray:
    """Potentials (m, n) at m points of the n elements of a part (side 1) or of its image (side
    -1)."""
    width = part.end - part.start
    node, weight = np.polynomial.legendre.leggauss(4)
    ring_r, ring_z = part.curve(part.start[:, None] + width[:, None] * (node + 1) / 2)
    kernel = ring_potential(r[:, None, None], z[:, None, None], ring_r, side * ring_z)
    potential = kernel @ (weight / 2) * width
    # Close pairs: split at the nearest point and crowd the nodes towards it.
    (r0, z0), (r1, z1) = part.curve(part.start), part.curve(part.end)
    along_r, along_z = r1 - r0, side * (z1 - z0)
    chord = along_r**2 + along_z**2
    foot = ((r[:, None] - r0) * along_r + (z[:, None] - side * z0) * along_z) / chord
    foot = np.clip(foot, 0, 1)
    distance = np.hypot(r[:, None] - r0 - foot * along_r, z[:, None] - side * z0 - foot * along_z)
    i, j = np.nonzero(distance < 2.5 * width)
    node, weight = np.polynomial.legendre.leggauss(16)
    u = (node + 1) / 2
    crowded, jacobian = u**4, 2 * u**3 * weight
    foot = foot[i, j][:, None]
    t = np.concatenate([foot * (1 - crowded), foot + (1 - foot) * crowded], axis=1)
    w = np.concatenate([foot * jacobian, (1 - foot) * jacobian], axis=1)
    ring_r, ring_z = part.curve(part.start[j, None] + width[j, None] * t)
    kernel = ring_potential(r[i, None], z[i, None], ring_r, side * ring_z)
    potential[i, j] = (kernel * w).sum(axis=1) * width[j]
    return potential


def charge_densities(
    parts: list[Elements], potentials: list[Callable[..., np.ndarray] | float]
) -> list[np.ndarray]:
    """Charge densities of the elements of each part that hold the parts at their potentials above
    the plane.

    Args:
        parts: surfaces above the grounded plane z = 0.
        potentials: one for each part; a number, or a function of (r, z) where an outer field adds
            to it.
    """
    middles = [part.curve((part.start + part.end) / 2) for part in parts]
    r, z = (np.concatenate(values) for values in zip(*middles, strict=True))
    matrix = np.hstack(
        [_influence(r, z, part, 1.0) - _influence(r, z, part, -1.0) for part in parts]
    )
    given = [
        v(*middle) if callable(v) else np.full(middle[0].shape, v)
        for v, middle in zip(potentials, middles, strict=True)
    ]
    density = np.linalg.solve(matrix, np.concatenate(given))
    return np.split(density, np.cumsum([part.start.size for part in parts])[:-1])


def sphere_curve(centre: float) -> Curve:
    """Unit sphere, by the angle from its lowest point."""
    return lambda s: (np.sin(s), centre - np.cos(s))


def upward_force(sphere: Elements, density: np.ndarray) -> float:
    """Vertical force on the sphere, the integral of sigma^2 / 2 times the vertical part of the
    normal."""
    area = -np.pi * (np.sin(sphere.end) ** 2 - np.sin(sphere.start) ** 2)
    return float(np.sum(density**2 / 2 * area))


def _contact_edge(probe_radius: float) -> float:
    """Angle within which the field of a touching contact is below exp(-20) of that at its rim."""
    return 1 / (1 / min(probe_radius, 1.0) + 3.2)


def gripper_parts(
    gap: float,
    probe_radius: float,
    task: str,
    halvings: int = 0,
    probe_length: float = PROBE_LENGTH,
) -> list[Elements]:
    """Elements of the sphere and of the probe's face, wall and top.

    Args:
        gap: sphere to plane ("release", probe touching) or probe to sphere ("pick", plane touching)
            [radii].
        probe_radius: radius of the probe [radii].
        task: "release" or "pick".
        halvings: times that each element of the coarsest mesh is halved.
        probe_length: length of the probe [radii].
    """
    release = task == "release"
    centre, bottom = (1 + gap, 2 + gap) if release else (1.0, 2 + gap)
    rim = _contact_edge(probe_radius) if release else 0.0
    sphere_from, sphere_to = (0.0, np.pi - rim) if release else (_contact_edge(np.inf), np.pi)
    corner_gap = np.hypot(probe_radius, bottom - centre) - 1
    smallest = 0.02 * min(probe_radius, 1.0, corner_gap)

    def from_sphere(r, z):
        return np.hypot(r, z - centre) - 1

    def sphere_size(r, z):
        from_probe = np.hypot(bottom - z, np.maximum(r - probe_radius, 0))
        return np.minimum(np.minimum(z, 0.4), from_probe)

    def probe_size(r, z):
        corner = np.hypot(r - probe_radius, z - bottom) + smallest
        top_corner = np.hypot(r - probe_radius, z - bottom - probe_length) + 0.05 * probe_radius
        return np.minimum.reduce([from_sphere(r, z), corner, top_corner, z])

    def face(s):
        return s, np.full_like(s, bottom)

    def wall(s):
        return np.full_like(s, probe_radius), bottom + s

    def top(s):
        return probe_radius - s, np.full_like(s, bottom + probe_length)

    return [
        cut(sphere_curve(centre), (sphere_from, sphere_to), sphere_size, halvings),
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
    """Force on the sphere over that of the asymptote, F D / (R pi eps0 V^2).

    Downwards for "release" (sphere and probe at V), upwards for "pick" (sphere and plane at 0,
    probe at V). Arguments as `gripper_parts`.
    """
    parts = gripper_parts(gap, probe_radius, task, halvings, probe_length)
    ball_potential = 1.0 if task == "release" else 0.0
    density = charge_densities(parts, [ball_potential, 1.0, 1.0, 1.0])
    force = upward_force(parts[0], density[0])
    return gap / np.pi * (-force if task == "release" else force)


def extrapolated_factor(gap: float, probe_radius: float, task: str) -> float:
    """Shape factor without its error of second order in the length of the elements (Richardson
    extrapolation)."""
    coarse, fine = (shape_factor(gap, probe_radius, task, halvings) for halvings in (0, 1))
    return (4 * fine - coarse) / 3


def main() -> None:
    """Write the table of shape factors beside `probe_table`; a few minutes."""
    lines = [
        "# F D / (R pi eps0 V^2); made by: python tools/make/boundary_elements.py",
        "# log2_D_over_R,log2_Rm_over_R,release,pick",
    ]
    for gap in GAP_EXPONENTS:
        for probe in PROBE_EXPONENTS:
            factors = (
                extrapolated_factor(2.0**gap, 2.0**probe, task) for task in ("release", "pick")
            )
            lines.append(
                ",".join([f"{gap:.4f}", f"{probe:.4f}", *(f"{factor:.6f}" for factor in factors)])
            )
    Path(probe_table.__file__).with_name(FILE).write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
