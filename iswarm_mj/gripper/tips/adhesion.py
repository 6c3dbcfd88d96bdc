"""Adhesion of a ball to a tip of any profile, on its axis or beside it; shares of the field's pull.

Surfaces attract each other with the pressure 2 W z0^2 / (z0 + g)^3 at the gap g, of work W and reach
z0; its integral over the ball is the pull-off force (Derjaguin 1934). Where ball and tip touch at a
point, it is 2 pi W / (1 / R + c) for the tip's curvature c there, whatever the reach: 2 pi R W at a
flat tip, 1 / (1 + R / R_c) of that at a rounded one. Around a circle of contact it is that of a line
contact, (3 pi / 4) W sqrt(2 r / z0) per length, with 1 / r the sum of both curvatures.

The reach is a choice: the effective electrical gap of a contact, since surfaces as rough as that
adhere where they are as near. A bump that stands out less than the reach hardly lowers adhesion.

Validity: gaps that change slowly along the surfaces; roughness far below the tip's radius of
curvature. A rough ball that touches by one asperity adheres as that asperity does, and a sharper tip
lowers its adhesion less than this model says.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from iswarm_mj.gripper.tips.profile import Chain, Profile, seat_of

_N_RINGS = 800
"""Number of rings on the ball on either side of a contact."""
_N_RINGS_BESIDE, _N_SECTORS = 300, 24
"""Number of rings about the contact of a ball beside the axis, and of places around half a ring."""


class Gaps(NamedTuple):
    """Gaps between the upper half of a ball and a tip that touch each other."""

    gap: Float[np.ndarray, "places"]
    """Distance of places on the ball from the tip [m]."""
    area: Float[np.ndarray, "places"]
    """Area of the ball at each place, as seen from above [m^2]."""


def gaps_of(profile: Profile, ball_radius: float, offset: float = 0.0) -> Gaps:
    """Return the gaps of a ball at a tip.

    Args:
        profile: of the tip.
        ball_radius: of the ball [m].
        offset: distance of the ball's centre from the tip's axis [m].
    """
    if offset > 0:
        return _gaps_beside(profile, ball_radius, offset)

    # Rings about the ball's top, by their angles from it.
    seat = seat_of(profile, ball_radius)
    edges = _edges(seat.angle, 0.0, math.pi / 2)
    angle = _middles(edges)
    r = ball_radius * np.sin(angle)
    z = seat.height + ball_radius * np.cos(angle)
    gap, _ = _with_wall(profile, ball_radius).nearest(r, z)
    return Gaps(gap, _areas_of_rings(ball_radius, edges))


def _gaps_beside(profile: Profile, ball_radius: float, offset: float) -> Gaps:
    """Return the gaps of a ball beside the axis, in rings about the place where it touches."""
    centre_height, contact_angle = _seat_beside(profile, ball_radius, offset)

    # Directions from the ball's centre in a frame whose pole is the place of contact: polar angles
    # in rings, azimuths over half a turn, since both sides of the plane through the axes are alike.
    edges = _edges(0.0, 0.0, math.pi, _N_RINGS_BESIDE)
    polar = _middles(edges)[:, None]
    azimuth = math.pi * (np.arange(_N_SECTORS) + 0.5) / _N_SECTORS
    towards_pole = np.broadcast_to(np.cos(polar), (len(polar), _N_SECTORS))
    in_plane = np.sin(polar) * np.cos(azimuth)
    out_of_plane = np.sin(polar) * np.sin(azimuth)

    # The same directions in the tip's frame: x away from its axis, y out of the plane, and up. The
    # pole is the vertical turned by the angle of contact.
    sine = math.sin(contact_angle)
    cosine = math.cos(contact_angle)
    x = towards_pole * sine + in_plane * cosine
    y = out_of_plane
    up = towards_pole * cosine - in_plane * sine

    # Places on the upper half of the ball, with their areas as seen from above.
    solid_angle = 2 * math.pi * -np.diff(np.cos(edges))[:, None] / _N_SECTORS
    is_upper = up > 0
    area = (ball_radius**2 * solid_angle * up)[is_upper]
    r = np.hypot(offset + ball_radius * x, ball_radius * y)[is_upper]
    z = centre_height + ball_radius * up[is_upper]
    gap, _ = _with_wall(profile, ball_radius).nearest(r, z)
    return Gaps(gap, area)


def _edges(
    contact: float, low: float, high: float, n_rings: int = _N_RINGS
) -> Float[np.ndarray, "edges"]:
    """Return edges of rings, narrow near an angle of contact [rad]."""
    graded = np.linspace(0, 1, n_rings + 1) ** 3
    above = contact + (high - contact) * graded
    below = contact - (contact - low) * graded
    return np.unique(np.concatenate([below, above]))


def _middles(edges: Float[np.ndarray, "edges"]) -> Float[np.ndarray, "rings"]:
    """Return the angles in the middles of rings [rad]."""
    return (edges[1:] + edges[:-1]) / 2


def _areas_of_rings(
    ball_radius: float, edges: Float[np.ndarray, "edges"]
) -> Float[np.ndarray, "rings"]:
    """Return the areas of rings about the ball's top, as seen from above [m^2]."""
    return math.pi * ball_radius**2 * np.diff(np.sin(edges) ** 2)


def _with_wall(profile: Profile, ball_radius: float) -> Chain:
    """Return the tip with as much of its wall as a ball can be near to."""
    return profile.with_wall(2 * ball_radius)


def _seat_beside(profile: Profile, ball_radius: float, offset: float) -> tuple[float, float]:
    """Return where a ball beside the axis touches the tip.

    It touches on the plane through its centre and the axis.

    Returns:
        Height of its centre [m], and angle of the contact from its top, positive away from the axis
        [rad].
    """
    r, z = profile.face.at(np.linspace(0, profile.face.total, 20001))
    x = np.concatenate([-r[::-1], r]) - offset
    face_height = np.concatenate([z[::-1], z])

    # The ball rises until it meets the face somewhere: its centre stays below each point of the
    # face by the height of the ball's surface there.
    is_over_ball = np.abs(x) <= ball_radius
    surface_height = np.sqrt(np.where(is_over_ball, ball_radius**2 - x**2, 0.0))
    centre_height = np.where(is_over_ball, face_height - surface_height, np.inf)
    contact = int(centre_height.argmin())
    return float(centre_height[contact]), math.asin(float(x[contact]) / ball_radius)


def adhesion_radius(
    profile: Profile, ball_radius: float, reach: float, offset: float = 0.0
) -> float:
    """Return the radius of the ball that adheres to a plane as much as this one does here [m].

    The pull-off force is 2 pi W times it. The integral is taken over that at a plane, so that a
    reach that is not far below the ball's radius changes no work of adhesion.

    Args:
        profile: of the tip.
        ball_radius: of the ball [m].
        reach: z0 of the adhesion [m].
        offset: distance of the ball's centre from the tip's axis [m].
    """
    gap, area = gaps_of(profile, ball_radius, offset)
    pull_of_tip = (area / (reach + gap) ** 3).sum()

    # The same at a plane, which the ball touches with its top.
    edges = _edges(0.0, 0.0, math.pi / 2)
    plane_gap = ball_radius * (1 - np.cos(_middles(edges)))
    plane_area = _areas_of_rings(ball_radius, edges)
    pull_of_plane = (plane_area / (reach + plane_gap) ** 3).sum()
    return ball_radius * float(pull_of_tip / pull_of_plane)


def pull_ratio(profile: Profile, ball_radius: float, gap: float, offset: float) -> float:
    """Return the tip's pull on a ball beside its axis, over that on the axis.

    Both are integrals of the pressure of a plane capacitor, eps0 V^2 / (2 g^2), over the ball. This
    approximation is for the ratio only, since the boundary elements are axisymmetric.

    Args:
        profile: of the tip.
        ball_radius: of the ball [m].
        gap: effective electrical gap of the contact [m].
        offset: distance of the ball's centre from the tip's axis [m].
    """
    pulls = []
    for place in (offset, 0.0):
        distance, area = gaps_of(profile, ball_radius, place)
        pulls.append(float((area / (gap + distance) ** 2).sum()))
    return pulls[0] / pulls[1]
