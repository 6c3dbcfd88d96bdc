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
    Curve,
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
"""Largest size of an element on the ball, before `RESOLUTION` [ball radii]."""
_SIZE_ON_ARC = 1.5
"""Largest size of an element on an arc, in radii of the arc."""
_LEAST_CURVATURE = 1e-3
"""Curvature below which it shortens no element [1/ball radius]."""
_SIZE_AT_CORNER = 0.02
"""Size of an element at a corner, over the corner's distance from the ball."""
_NEAREST_CORNER = 1e-2
"""Distance from the ball below which a corner's elements become no smaller [ball radii]."""
_SIZE_AT_TOP = 0.05
"""Size of an element at the edge of the tip's top, in radii of the tip."""
_SHORTEST_RUN = 1e-9
"""Length from which a run between two corners gets elements [ball radii]."""


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
    gap_in_radii = gap / ball_radius
    plate_gap = gap_in_radii if task == "release" else 0.0
    tip_gap = gap_in_radii if task == "pick" else 0.0

    # Ball and tip in their places, in radii of the ball.
    ball_height = 1 + plate_gap
    ball_curve = sphere_curve(ball_height)
    tip = profile.with_wall(WALL_LENGTH * ball_radius).scaled(1 / ball_radius)
    tip = tip.raised(ball_height - seat.height / ball_radius + tip_gap)
    tip_radius = profile.radius / ball_radius

    # Contacts of bodies at one potential have no field near them, and elements without end.
    if task == "release":
        contact_angle = np.arcsin(min(1.0, seat.radius / ball_radius))
        rim = _rim(tip, ball_height, contact_angle, tip_radius)
        ball_angles = (0.0, np.pi - rim)
        rim_r, rim_z = ball_curve(np.array([np.pi - rim]))
        _, nearest_to_rim = tip.nearest(rim_r, rim_z)
        tip_start = float(nearest_to_rim[0])
    else:
        ball_angles = (_PLATE_CONTACT, np.pi)
        tip_start = 0.0

    return Scene(
        ball=_ball_elements(ball_curve, ball_angles, tip, halvings),
        tip=_tip_elements(tip, ball_height, tip_radius, tip_start, halvings),
        corners=_corners_of(tip),
    )


def _ball_elements(
    ball_curve: Curve, angles: tuple[float, float], tip: Chain, halvings: int
) -> Elements:
    """Return the elements of the ball, which are smaller near plate and tip.

    Args:
        ball_curve: the ball, by the angle from its lowest point.
        angles: between which the ball has a field [rad].
        tip: profile with its wall, in its place [ball radii].
        halvings: see `scene_of`.
    """

    def size(angle: np.ndarray) -> np.ndarray:
        r, from_plate = ball_curve(angle)
        from_tip, _ = tip.nearest(r, from_plate)
        return np.minimum(_LARGEST_SIZE, np.minimum(from_plate, from_tip))

    return cut(ball_curve, angles, size, halvings)


def _tip_elements(
    tip: Chain, ball_height: float, tip_radius: float, tip_start: float, halvings: int
) -> list[Elements]:
    """Return the elements of the tip, a run of them between each corner and the next.

    Elements are smaller near ball, plate and corners, and where the profile is curved.

    Args:
        tip: profile with its wall, in its place [ball radii].
        ball_height: height of the ball's centre above the plate [ball radii].
        tip_radius: radius of the tip [ball radii].
        tip_start: arc length before which a contact leaves no field [ball radii].
        halvings: see `scene_of`.
    """
    corners = _corners_of(tip)
    sizes_at_corners = _sizes_at_corners(tip, ball_height, tip_radius)

    def size(arc_length: np.ndarray) -> np.ndarray:
        r, from_plate = tip.at(arc_length)
        from_ball = np.hypot(r, from_plate - ball_height) - 1
        curvature = np.abs(tip.curvature[tip.piece_at(arc_length)])
        of_curvature = _SIZE_ON_ARC / np.maximum(curvature, _LEAST_CURVATURE)

        smallest = np.minimum(np.minimum(from_ball, from_plate), of_curvature)
        for (corner_r, corner_z), size_at_corner in zip(corners, sizes_at_corners, strict=True):
            from_corner = np.hypot(r - corner_r, from_plate - corner_z)
            smallest = np.minimum(smallest, from_corner + size_at_corner)
        return smallest

    # The runs end at the corners and at the top's end; what lies before `tip_start` has no field.
    ends = np.append(tip.start[tip.is_corner], tip.total)
    starts = np.concatenate([[0.0], ends[:-1]])
    runs = []
    for start, end in zip(np.maximum(starts, tip_start), ends, strict=True):
        if end - start > _SHORTEST_RUN:
            just_before_end = np.nextafter(end, start)
            runs.append(cut(tip.at, (start, just_before_end), size, halvings))
    return runs


def _corners_of(tip: Chain) -> Float[np.ndarray, "c 2"]:
    """Return the sharp edges (r, z) of a tip."""
    return np.stack([tip.start_r[tip.is_corner], tip.start_z[tip.is_corner]], axis=1)


def _sizes_at_corners(tip: Chain, ball_height: float, tip_radius: float) -> Float[np.ndarray, "c"]:
    """Return the size of the elements at each corner of a tip; the last one is that of its top."""
    r, z = _corners_of(tip).T
    from_ball = np.hypot(r, z - ball_height) - 1
    scale = np.minimum(np.maximum(from_ball, _NEAREST_CORNER), min(tip_radius, 1.0))
    sizes = _SIZE_AT_CORNER * scale
    sizes[-1] = _SIZE_AT_TOP * tip_radius
    return sizes


def _rim(tip: Chain, ball_height: float, contact_angle: float, tip_radius: float) -> float:
    """Return the angle from the ball's top beyond which a touching contact has a field.

    In a channel of width g between equal potentials the field falls as exp(-integral of pi / g).
    """
    outermost = max(np.arcsin(min(1.0, tip_radius)), contact_angle + 2 * _LEAST_RIM)
    angle = contact_angle + np.geomspace(_LEAST_RIM, outermost - contact_angle, 2000)
    width, _ = tip.nearest(np.sin(angle), ball_height + np.cos(angle))

    # The exponent from each angle to the outermost one, by the trapezoidal rule.
    decay_rate = np.pi / np.maximum(width, 1e-9)
    exponents = np.diff(angle) * (decay_rate[1:] + decay_rate[:-1]) / 2
    exponent_to_outermost = np.append(np.cumsum(exponents[::-1])[::-1], 0.0)

    # The last angle from which on the field has decayed.
    decayed = angle[exponent_to_outermost > _DECAY]
    return float(decayed[-1]) if len(decayed) else float(angle[0])


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
    tip_potentials = [1.0] * len(scene.tip)
    densities = charge_densities([scene.ball, *scene.tip], [ball_potential, *tip_potentials])
    ball_density = densities[0]
    tip_densities = densities[1:]

    upwards = upward_force(scene.ball, ball_density)
    force = -upwards if task == "release" else upwards

    # The field at a conductor is its charge density. At a sharp edge it has no bound.
    tip_field = 0.0
    for part, density in zip(scene.tip, tip_densities, strict=True):
        is_counted = _distance_from_edges(part, scene.corners) > EDGE
        field = np.abs(density[is_counted])
        tip_field = max(tip_field, float(field.max(initial=0.0)))
    return Solution(
        force=VACUUM_PERMITTIVITY * force,
        ball_field=float(np.abs(ball_density).max()) / ball_radius,
        tip_field=tip_field / ball_radius,
    )


def _distance_from_edges(part: Elements, edges: Float[np.ndarray, "c 2"]) -> Float[np.ndarray, "n"]:
    """Return the distance of each element from the nearest sharp edge, infinite without any."""
    r, z = part.middles
    distance = np.full(len(r), np.inf)
    for edge_r, edge_z in edges:
        distance = np.minimum(distance, np.hypot(r - edge_r, z - edge_z))
    return distance


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
