"""Profile of a tip: the curve from its axis over its face and edge to its wall, a chain of arcs.

Lengths are in any unit, the same for all. The tip hangs above the ball: z points from the face into
the tip. A chain begins on the axis, and the body lies on its left: the wall goes up.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

_STRAIGHT = 1e-9
"""Turn of a piece below which it counts as straight [rad]."""
_CORNER = math.radians(12)
"""Change of heading at a joint from which it counts as a corner."""


@dataclass(frozen=True)
class Chain:
    """Arcs and straight lines, one after the other.

    Attributes:
        start_r: (n,) distance of the starts of the pieces from the axis.
        start_z: (n,) height of the starts.
        heading: (n,) direction at the starts, 0 away from the axis and pi/2 upwards [rad].
        curvature: (n,) change of heading per length, positive to the left, 0 for lines.
        length: (n,) lengths.
    """

    start_r: Float[np.ndarray, "n"]
    start_z: Float[np.ndarray, "n"]
    heading: Float[np.ndarray, "n"]
    curvature: Float[np.ndarray, "n"]
    length: Float[np.ndarray, "n"]

    @cached_property
    def start(self) -> Float[np.ndarray, "n"]:
        """Arc length at which each piece begins."""
        return np.concatenate([[0.0], np.cumsum(self.length)[:-1]])

    @property
    def total(self) -> float:
        """Length of the chain."""
        return float(self.length.sum())

    @property
    def end_heading(self) -> Float[np.ndarray, "n"]:
        """Direction at the ends of the pieces."""
        return self.heading + self.curvature * self.length

    @cached_property
    def is_corner(self) -> Bool[np.ndarray, "n"]:
        """Whether the heading jumps where a piece begins; not at the first piece."""
        jumps = np.abs(self.heading[1:] - self.end_heading[:-1]) > _CORNER
        return np.concatenate([[False], jumps])

    def piece_at(self, arc_length: np.ndarray) -> np.ndarray:
        """Return the indices of the pieces at arc lengths."""
        last = len(self.length) - 1
        return np.clip(np.searchsorted(self.start, arc_length, side="right") - 1, 0, last)

    def at(self, arc_length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the points (r, z) at arc lengths of any shape."""
        piece = self.piece_at(arc_length)
        way = np.asarray(arc_length) - self.start[piece]

        # The chord of an arc: as long as its way times sinc(turn / 2), at half the turn.
        half_turn = self.curvature[piece] * way / 2
        chord = way * np.sinc(half_turn / np.pi)
        direction = self.heading[piece] + half_turn
        r = self.start_r[piece] + chord * np.cos(direction)
        return np.maximum(r, 0.0), self.start_z[piece] + chord * np.sin(direction)

    def nearest(self, r: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the distance of points (m,) from the chain, and the arc length nearest to them."""
        # Candidates are the foot of each point on each piece. That on an arc may be farther away
        # than an end of the arc, if the point is on the far side of the circle.
        feet = self._feet(r, z)
        candidates = [feet]
        if self._is_arc.any():
            candidates.append(np.zeros_like(feet))
            candidates.append(np.broadcast_to(self.length, feet.shape))
        arc_lengths = self.start[:, None] + np.stack(candidates, axis=-1)

        # An arc length at which a piece ends belongs to the next piece: stop just before it.
        last = np.nextafter(self.start + self.length, self.start)
        candidate_r, candidate_z = self.at(np.minimum(arc_lengths, last[:, None]))
        distances = np.hypot(
            r[:, None, None] - candidate_r,
            z[:, None, None] - candidate_z,
        )

        # The nearest of all candidates of a point.
        arc_lengths = arc_lengths.reshape(len(r), -1)
        distances = distances.reshape(len(r), -1)
        best = distances.argmin(axis=1)
        point = np.arange(len(r))
        return distances[point, best], arc_lengths[point, best]

    def _feet(self, r: np.ndarray, z: np.ndarray) -> Float[np.ndarray, "m n"]:
        """Return how far along each piece the feet of points (m,) are, at most at its ends."""
        # Each point as seen from the start of each piece: along its first heading, and to the left.
        across = r[:, None] - self.start_r
        up = z[:, None] - self.start_z
        cosine = np.cos(self.heading)
        sine = np.sin(self.heading)
        along = across * cosine + up * sine
        left = up * cosine - across * sine

        # The foot on a line is as far along as the point. The foot on an arc is at the angle about
        # its centre, which lies one radius to the left, or to the right of an arc to the right.
        curvature = np.where(self._is_arc, self.curvature, 1.0)
        radius = 1 / np.abs(curvature)
        angle = np.arctan2(along, radius - left * np.sign(curvature))
        foot = np.where(self._is_arc, radius * angle, along)
        return np.clip(foot, 0.0, self.length)

    @cached_property
    def _is_arc(self) -> Bool[np.ndarray, "n"]:
        """Whether each piece is an arc, and no straight line."""
        return np.abs(self.curvature * self.length) > _STRAIGHT

    def scaled(self, factor: float) -> "Chain":
        """Return the chain with all lengths times a factor."""
        return Chain(
            start_r=self.start_r * factor,
            start_z=self.start_z * factor,
            heading=self.heading,
            curvature=self.curvature / factor,
            length=self.length * factor,
        )

    def raised(self, height: float) -> "Chain":
        """Return the chain at another height."""
        return replace(self, start_z=self.start_z + height)


def chain_of(
    pieces: list[tuple[float, float]], start_z: float = 0.0, turns: dict[int, float] | None = None
) -> Chain:
    """Return a chain from the axis, by lengths and curvatures of its pieces.

    Args:
        pieces: length and curvature of each piece.
        start_z: height at the axis.
        turns: changes of heading before pieces, by their indices [rad].
    """
    r = 0.0
    z = start_z
    heading = 0.0
    rows = []
    for index, (length, curvature) in enumerate(pieces):
        heading += (turns or {}).get(index, 0.0)
        rows.append((r, z, heading, curvature, length))
        half_turn = curvature * length / 2
        chord = length * float(np.sinc(half_turn / np.pi))
        r += chord * math.cos(heading + half_turn)
        z += chord * math.sin(heading + half_turn)
        heading += curvature * length
    return Chain(*(np.array(column, float) for column in zip(*rows, strict=True)))


def polyline(r: Float[np.ndarray, "n"], z: Float[np.ndarray, "n"]) -> Chain:
    """Return the chain of straight lines through points, the first on the axis."""
    return Chain(
        start_r=r[:-1],
        start_z=z[:-1],
        heading=np.arctan2(np.diff(z), np.diff(r)),
        curvature=np.zeros(len(r) - 1),
        length=np.hypot(np.diff(r), np.diff(z)),
    )


@dataclass(frozen=True)
class Profile:
    """A tip, in metres.

    Attributes:
        name: of the shape.
        face: from the axis to the wall, without the wall, which follows straight up.
        apex_curvature: curvature where the face meets the axis, positive if it bulges [1/m].
    """

    name: str
    face: Chain
    apex_curvature: float

    @cached_property
    def points(self) -> tuple[np.ndarray, np.ndarray]:
        """Points (r, z) along the face, close together [m]."""
        return self.face.at(np.linspace(0, self.face.total, 4001))

    @property
    def radius(self) -> float:
        """Greatest radius, that of the wall [m]."""
        r, _ = self.points
        return float(r[-1])

    @property
    def height(self) -> float:
        """Height from the lowest to the highest point of the face [m]."""
        _, z = self.points
        return float(np.ptp(z))

    def with_wall(self, length: float) -> Chain:
        """Return the whole tip: face, wall of a length, and top [m]."""
        r, z = (float(values[-1]) for values in self.points)
        ends = Chain(
            start_r=np.array([r, r]),
            start_z=np.array([z, z + length]),
            heading=np.array([np.pi / 2, np.pi]),
            curvature=np.zeros(2),
            length=np.array([length, r]),
        )
        columns = ("start_r", "start_z", "heading", "curvature", "length")
        return Chain(
            *(np.concatenate([getattr(self.face, name), getattr(ends, name)]) for name in columns)
        )


@dataclass(frozen=True)
class Seat:
    """Place where a ball touches a tip from below, both on one axis."""

    height: float
    """Height of the ball's centre in the profile's coordinates [m]."""
    radius: float
    """Radius of the circle of contact, 0 on the axis [m]."""
    angle: float
    """Angle between the contact's normal and the axis [rad]."""

    @property
    def is_point(self) -> bool:
        """The ball touches on the axis."""
        return self.radius == 0


def seat_of(profile: Profile, ball_radius: float) -> Seat:
    """Return where a ball of a radius [m] touches a tip.

    It rises until the face stops it: to the least of z(r) - sqrt(R^2 - r^2).
    """
    face = profile.face
    arc_length = _dense(face)
    stop_height = _stop_height(face, arc_length, ball_radius)
    lowest = int(stop_height.argmin())

    # On the axis, unless a place beside it stops the ball earlier by more than rounding.
    at_axis = float(stop_height[0])
    is_on_axis = lowest == 0 or at_axis - stop_height[lowest] < 1e-9 * ball_radius
    if is_on_axis:
        return Seat(height=at_axis, radius=0.0, angle=0.0)

    # The lowest place between the neighbours of the lowest sample.
    before = arc_length[lowest - 1]
    after = arc_length[min(lowest + 1, len(arc_length) - 1)]
    span = np.linspace(before, after, 2001)
    stop_height = _stop_height(face, span, ball_radius)
    place = float(span[stop_height.argmin()])

    r, _ = face.at(np.array(place))
    radius = float(r)
    angle = math.asin(min(1.0, radius / ball_radius))
    return Seat(height=float(stop_height.min()), radius=radius, angle=angle)


def _dense(chain: Chain) -> np.ndarray:
    """Return arc lengths close together, with the ends of all pieces among them."""
    ends = np.append(chain.start, chain.total)
    return np.unique(np.concatenate([ends, np.linspace(0, chain.total, 4001)]))


def _stop_height(chain: Chain, arc_length: np.ndarray, ball_radius: float) -> np.ndarray:
    """Return the height at which points of a chain stop a ball's centre, infinite beside it."""
    r, z = chain.at(arc_length)
    is_above = r <= ball_radius
    below = np.sqrt(np.where(is_above, ball_radius**2 - r**2, 0.0))
    return np.where(is_above, z - below, np.inf)
