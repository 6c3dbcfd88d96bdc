"""Electrostatic force on a ball between plate and tip, and fields, by boundary elements.

Two tasks, as in `laws.electrostatics`: "pick", where ball and plate are at 0, the ball on the plate
and the tip at V above it across a gap; and "release", where ball and tip are at V, the ball at the
tip and above the plate across a gap. Gaps are measured along the axis, beyond the touch of
`profile.seat_of`.

Lengths inside are in radii of the ball, and eps0 = 1.

Validity: conductors with smooth surfaces, the ball on the axis. The elements converge with their
length squared; the force without halvings is within 1 %, and extrapolated within 5e-4
(`tests/gripper/test_tip_forces.py`).
"""

from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from iswarm_mj.gripper.tips.elements import (
    Elements,
    charge_densities,
    cut,
    sphere_curve,
    upward_force,
)
from iswarm_mj.gripper.tips.profile import Chain, Profile, seat_of
from iswarm_mj.gripper.units import VACUUM_PERMITTIVITY

Task = Literal["pick", "release"]

WALL_LENGTH = 20.0
"""Length of the tip's wall [ball radii]; at small gaps the force does not depend on it."""
_DECAY = 20.0
"""Natural logarithm by which the field has decayed where a touching contact is cut off."""
_LEAST_RIM = 1e-3
"""Least angle on the ball between a contact and the place where it is cut off [rad]."""
_PLATE_CONTACT = 1 / (1 + _DECAY / (2 * np.pi))
"""Angle within which the field of a ball on the plate is below exp(-20) of that at its side."""
_LARGEST_SIZE = 0.4
"""Largest size of an element on the ball, before `RESOLUTION`."""


class Scene(NamedTuple):
    """Elements of ball and tip, in radii of the ball."""

    ball: Elements
    tip: list[Elements]
    corners: Float[np.ndarray, "c 2"]
    """Sharp edges (r, z) of the tip, where the field has no bound."""


def scene_of(
    profile: Profile, ball_radius: float, gap: float, task: Task, halvings: int = 0
) -> Scene:
    """Return the elements of ball and tip.

    Args:
        profile: of the tip.
        ball_radius: of the ball [m].
        gap: of tip and ball in "pick", of ball and plate in "release" [m].
        task: "pick" or "release".
        halvings: number of times that each element of the coarsest mesh is halved.
    """
    seat = seat_of(profile, ball_radius)
    ball_height = 1 + (gap / ball_radius if task == "release" else 0.0)
    tip_gap = gap / ball_radius if task == "pick" else 0.0
    tip = profile.with_wall(WALL_LENGTH * ball_radius).scaled(1 / ball_radius)
    tip = tip.raised(ball_height - seat.height / ball_radius + tip_gap)
    radius = profile.radius / ball_radius

    # Contacts of bodies at one potential have no field near them, and elements without end.
    ball_curve = sphere_curve(ball_height)
    if task == "release":
        contact_angle = np.arcsin(min(1.0, seat.radius / ball_radius))
        rim = _rim(tip, ball_height, contact_angle, radius)
        ball_angles = (0.0, np.pi - rim)
        rim_r, rim_z = ball_curve(np.array([np.pi - rim]))
        tip_start = float(tip.nearest(rim_r, rim_z)[1][0])
    else:
        ball_angles = (_PLATE_CONTACT, np.pi)
        tip_start = 0.0

    def ball_size(angle):
        r, z = ball_curve(angle)
        from_tip, _ = tip.nearest(r, z)
        return np.minimum.reduce([z, np.full_like(z, _LARGEST_SIZE), from_tip])

    ball = cut(ball_curve, ball_angles, ball_size, halvings)
    parts = _tip_elements(tip, ball_height, radius, tip_start, halvings)
    corners = np.stack([tip.start_r[tip.is_corner], tip.start_z[tip.is_corner]], axis=1)
    return Scene(ball, parts, corners)


def _tip_elements(
    tip: Chain, ball_height: float, radius: float, tip_start: float, halvings: int
) -> list[Elements]:
    """Return the elements of the tip, a run of them between each corner and the next.

    Elements are smaller near ball, plate and corners, and where the profile is curved.

    Args:
        tip: profile with its wall, in its place [ball radii].
        ball_height: height of the ball's centre above the plate [ball radii].
        radius: radius of the tip [ball radii].
        tip_start: arc length before which a contact leaves no field [ball radii].
        halvings: see `scene_of`.
    """
    corners = np.stack([tip.start_r[tip.is_corner], tip.start_z[tip.is_corner]], axis=1)
    smallest = _smallest_sizes(tip, ball_height, radius)

    def tip_size(arc_length):
        r, z = tip.at(arc_length)
        sizes = [np.hypot(r, z - ball_height) - 1, z]
        for (corner_r, corner_z), smallest_size in zip(corners, smallest, strict=True):
            sizes.append(np.hypot(r - corner_r, z - corner_z) + smallest_size)
        curvature = np.abs(tip.curvature[tip.piece_at(arc_length)])
        sizes.append(1.5 / np.maximum(curvature, 1e-3))
        return np.minimum.reduce(sizes)

    ends = np.append(tip.start[tip.is_corner], tip.total)
    starts = np.concatenate([[0.0], ends[:-1]])
    parts = []
    for start, end in zip(np.maximum(starts, tip_start), ends, strict=True):
        if end - start > 1e-9:
            inside = np.nextafter(end, start)
            parts.append(cut(tip.at, (start, inside), tip_size, halvings))
    return parts


def _smallest_sizes(tip: Chain, ball_height: float, radius: float) -> Float[np.ndarray, "c"]:
    """Return the size of the elements at each corner of a tip; the last one is that of its top."""
    r = tip.start_r[tip.is_corner]
    z = tip.start_z[tip.is_corner]
    from_ball = np.hypot(r, z - ball_height) - 1
    sizes = 0.02 * np.minimum(np.maximum(from_ball, 1e-2), min(radius, 1.0))
    sizes[-1] = 0.05 * radius
    return sizes


def _rim(tip: Chain, ball_height: float, contact_angle: float, radius: float) -> float:
    """Return the angle from the ball's top beyond which a touching contact has a field.

    In a channel of width g between equal potentials the field falls as exp(-integral of pi / g).
    """
    outermost = max(np.arcsin(min(1.0, radius)), contact_angle + 2 * _LEAST_RIM)
    angle = contact_angle + np.geomspace(_LEAST_RIM, outermost - contact_angle, 2000)
    width, _ = tip.nearest(np.sin(angle), ball_height + np.cos(angle))

    # The exponent from each angle to the outermost one, by the trapezoidal rule.
    decay_rate = np.pi / np.maximum(width, 1e-9)
    exponents = np.diff(angle) * (decay_rate[1:] + decay_rate[:-1]) / 2
    exponent_to_outermost = np.append(np.cumsum(exponents[::-1])[::-1], 0.0)
    is_decayed = exponent_to_outermost > _DECAY
    return float(angle[is_decayed][-1]) if is_decayed.any() else float(angle[0])


class Solution(NamedTuple):
    """Force and fields at 1 V."""

    force: float
    """Force on the ball per V^2, towards the tip in "pick" and the plate in "release" [N/V^2]."""
    ball_field: float
    """Greatest field at the ball per V [1/m]."""
    tip_field: float
    """Greatest field at the tip per V, farther than `EDGE` from sharp edges [1/m]."""


EDGE = 0.05
"""Distance from sharp edges within which the field at the tip is left out [ball radii]."""


def solve(
    profile: Profile, ball_radius: float, gap: float, task: Task, halvings: int = 0
) -> Solution:
    """Return force and fields; arguments as `scene_of`."""
    scene = scene_of(profile, ball_radius, gap, task, halvings)
    ball_potential = 1.0 if task == "release" else 0.0
    parts = [scene.ball, *scene.tip]
    ball_density, *tip_densities = charge_densities(
        parts, [ball_potential, *(1.0 for _ in scene.tip)]
    )

    upwards = upward_force(scene.ball, ball_density)
    force = -upwards if task == "release" else upwards

    tip_field = 0.0
    for part, density in zip(scene.tip, tip_densities, strict=True):
        r, z = part.middles
        from_edges = np.full(len(r), np.inf)
        for edge_r, edge_z in scene.corners:
            from_edges = np.minimum(from_edges, np.hypot(r - edge_r, z - edge_z))
        field = np.abs(density[from_edges > EDGE])
        tip_field = max(tip_field, float(field.max(initial=0.0)))
    return Solution(
        force=VACUUM_PERMITTIVITY * force,
        ball_field=float(np.abs(ball_density).max()) / ball_radius,
        tip_field=tip_field / ball_radius,
    )


def extrapolated_force(profile: Profile, ball_radius: float, gap: float, task: Task) -> float:
    """Return the force per V^2 without its error of second order in the elements' length [N/V^2].

    This is Richardson's extrapolation. Arguments as `scene_of`.
    """
    coarse = solve(profile, ball_radius, gap, task, halvings=0).force
    fine = solve(profile, ball_radius, gap, task, halvings=1).force
    return (4 * fine - coarse) / 3


def shape_factor(profile: Profile, ball_radius: float, gap: float, task: Task) -> float:
    """Return the extrapolated force over that of Eq. 2, F D / (R pi eps0 V^2)."""
    force = extrapolated_force(profile, ball_radius, gap, task)
    return force * gap / (ball_radius * np.pi * VACUUM_PERMITTIVITY)
