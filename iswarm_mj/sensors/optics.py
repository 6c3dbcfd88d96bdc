"""Beams and photodiodes: what light from one robot does at another (sections 3.1 and 4.3 of the paper).

Each side of a robot has one LED and two photodiodes. Those of the paper's robot are numbered 0 front, 1 left, 2 back,
3 right; other robots have S sides, from two to eight, in any directions. Light from a direction falls on the side whose
photodiodes look nearest there, and light towards a direction comes from the LED that does. The functions accept NumPy
and JAX arrays of pairs; lengths are in mm, angles in rad. They ignore what stands between two robots, see `links`, and
robots do not shade their own LEDs and photodiodes.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from iswarm_mj.config.static import StaticOptics
from iswarm_mj.geometry.robot import SIDES, Point, Robots, Sides
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.units import mm_from_rd


class Reception(NamedTuple):
    """How receivers get light from senders, one entry a pair."""

    side: Int[Array, "*P"]
    """The receiver's side that faces the sender."""
    led: Int[Array, "*P"]
    """The sender's LED that shines towards the receiver."""
    bearing: Float[Array, "*P"]
    """Direction of the sender in the receiver's frame, as the photodiodes measure it [rad]."""
    effective_distance: Float[Array, "*P"]
    """Distance at which a sender on both optical axes is received equally well [mm]; infinite where it is not."""


Axes = tuple[Point, ...]
"""Unit vectors ahead and to the left, one of each side."""

Kinds = tuple[Int[Array, "*#P"] | int, Int[Array, "*#P"] | int]
"""Of receivers and of senders."""

Components = tuple[Float[Array, "*#P"], Float[Array, "*#P"]]
"""Two components of vectors: ahead and to the left in a robot's frame, or cosine and sine of its yaw."""


class Views(NamedTuple):
    """How the robots of each pair see each other."""

    at_receiver: Components
    """The sender's position ahead and to the left of the receiver [mm]."""
    at_sender: Components
    """The receiver's position ahead and to the left of the sender [mm]."""
    side: Int[Array, "*P"]
    """The receiver's side that faces the sender."""
    led: Int[Array, "*P"]
    """The sender's LED that faces the receiver."""
    kinds: Kinds
    """Index in `robot.kinds` of the receivers and of the senders."""


def into_frame(dx: Float[Array, "*#P"], dy: Float[Array, "*#P"], heading: Components) -> Components:
    """Components ahead and to the left of world vectors (dx, dy), in frames that look along `heading` (cos, sin)."""
    c, s = heading
    return c * dx + s * dy, c * dy - s * dx


def onto_axis(ahead: Float[Array, "*P"], left: Float[Array, "*P"], side: Int[Array, "*P"], axes: Axes) -> Components:
    """Components of (ahead, left) along the axis of a side and to its left."""
    xp = array_module(ahead)
    if axes == SIDES:
        c = xp.where(side == 0, 1.0, xp.where(side == 2, -1.0, 0.0))
        s = xp.where(side == 1, 1.0, xp.where(side == 3, -1.0, 0.0))
    else:
        c, s = (_look_up(values, side, ahead) for values in zip(*axes, strict=True))
    return into_frame(ahead, left, (c, s))


def facing_side(ahead: Float[Array, "*P"], left: Float[Array, "*P"], axes: Axes = SIDES) -> Int[Array, "*P"]:
    """Number of the side whose axis is nearest to the direction (ahead, left), of equally near ones the first."""
    xp = array_module(ahead)
    if axes == SIDES:
        return xp.where(xp.abs(ahead) >= xp.abs(left), 2 * (ahead < 0), 1 + 2 * (left < 0))
    side, nearest = xp.zeros(ahead.shape, int), ahead * axes[0][0] + left * axes[0][1]
    for k, (x, y) in enumerate(axes[1:], start=1):
        along = ahead * x + left * y
        side, nearest = xp.where(along > nearest, k, side), xp.maximum(along, nearest)
    return side


def receive(
    dx: Float[Array, "*#P"],
    dy: Float[Array, "*#P"],
    receiver: Components,
    sender: Components,
    robot: Robots,
    optics: StaticOptics,
    power: Float[Array, "*#P"] | None = None,
    kinds: Kinds = (0, 0),
) -> Reception:
    """Reception of light by pairs of robots.

    Args:
        dx: world x of the sender minus that of the receiver [mm].
        dy: the same of y.
        receiver: cosine and sine of the receiver's yaw.
        sender: cosine and sine of the sender's yaw.
        robot: positions of LEDs and photodiodes.
        optics: mode, range and cones.
        power: of the sender's LEDs, from 0 to 1; None for full power.
        kinds: index in `robot.kinds` of the receivers and of the senders.
    """
    at_receiver = into_frame(dx, dy, receiver)
    at_sender = into_frame(-dx, -dy, sender)
    side, led = facing_side(*at_receiver, robot.sides.photodiodes), facing_side(*at_sender, robot.sides.leds)
    return receive_views(Views(at_receiver, at_sender, side, led, kinds), robot, optics, power)


def receive_views(
    views: Views, robot: Robots, optics: StaticOptics, power: Float[Array, "*#P"] | None = None
) -> Reception:
    """As `receive`, for callers that know how the robots of each pair see each other."""
    rule = _in_sector if optics.mode == "sector" else _by_power
    bearing, way, beside = rule(views, robot, optics)
    xp = array_module(views.side)
    effective = (way if power is None else way / xp.sqrt(xp.maximum(power, 1e-12))) + beside  # the inverse square
    received = effective < mm_from_rd(optics.communication_radius)
    return Reception(views.side, views.led, bearing, xp.where(received, effective, math.inf))


def _in_sector(views: Views, robot: Robots, optics: StaticOptics) -> tuple[Array, Array, Any]:
    """Bearing and way of the light by the paper's rule: in the receiver's sector and in the sender's beam."""
    at_receiver, at_sender, side, led, _ = views
    xp, sides = array_module(side), robot.sides
    distance = xp.sqrt(at_receiver[0] ** 2 + at_receiver[1] ** 2)
    seen = _in_cone(at_receiver, side, sides.photodiodes, optics.photodiode_aperture)
    lit = _in_cone(at_sender, led, sides.leds, optics.led_beam_aperture)
    return _bearing(side, sides, distance), xp.where(seen & lit, distance, math.inf), 0.0


def _in_cone(direction: Components, side: Array, axes: Axes, aperture: float) -> Array:
    """Whether a direction lies in the cone of the `side` that faces it; `aperture` is its full angle [deg]."""
    xp, half = array_module(side), math.tan(math.radians(aperture / 2))
    if axes == SIDES:
        ahead, left = xp.abs(direction[0]), xp.abs(direction[1])
        return xp.minimum(ahead, left) <= xp.maximum(ahead, left) * half
    along, across = onto_axis(*direction, side, axes)
    return xp.abs(across) <= along * half


def _bearing(side: Array, sides: Sides, like: Array) -> Array:
    """Direction in which the photodiodes of a side look [rad], as `like` in type."""
    if sides.photodiodes == SIDES:
        return side * (math.pi / 2)
    return _look_up(sides.bearings, side, like)


def _by_power(views: Views, robot: Robots, optics: StaticOptics) -> tuple[Array, Array, Any]:
    """Bearing and way of the light by power: Lambertian lobe, inverse square, acceptance of the photodiodes.

    The lobe is cos^m with half its power at half the beam's aperture, m = -ln 2 / ln cos(aperture / 2) (Kahn &
    Barry 1997, Proc. IEEE 85, 265). Light travels from the LED of the sending side to the point halfway between the
    photodiodes of the receiving one. Each of these accepts cos(angle) about an axis splayed from the side's normal;
    their powers a and b give the bearing, tan(bearing) tan(splay) = (a - b) / (a + b). The threshold is such that a
    sender on both axes is received up to `communication_radius`, from centre to centre.
    """
    at_receiver, at_sender, side, led, kinds = views
    xp = array_module(side)
    along_r, across_r = onto_axis(at_receiver[0], at_receiver[1], side, robot.sides.photodiodes)
    along_s, across_s = onto_axis(at_sender[0], at_sender[1], led, robot.sides.leds)
    distance = xp.maximum(xp.hypot(along_r, across_r), 1e-6)
    # The sender's normal, seen from the receiving side: the angle between both normals follows from the two views.
    cos = -(along_r * along_s + across_r * across_s) / distance**2
    sin = -(along_r * across_s - across_r * along_s) / distance**2
    receivers, leds = zip(*((kind.receivers, kind.leds) for kind in robot.kinds), strict=True)
    out_r, left_r = _on_side(receivers, robot.sides.photodiodes, kinds[0], side, distance)
    out_s, left_s = _on_side(leds, robot.sides.leds, kinds[1], led, distance)
    gap_along = along_r - out_r + out_s * cos + left_s * sin
    gap_across = across_r - left_r - out_s * sin + left_s * cos
    gap = xp.maximum(xp.hypot(gap_along, gap_across), 1e-6)
    off_axis = (along_s - out_s + out_r * cos - left_r * sin) / gap
    order = -math.log(2) / math.log(math.cos(math.radians(optics.led_beam_aperture / 2)))
    lobe = xp.clip(off_axis, 0.0, 1.0) ** order
    splay = math.radians(optics.photodiode_splay)
    a = xp.maximum(gap_along * math.cos(splay) + gap_across * math.sin(splay), 0.0) / gap
    b = xp.maximum(gap_along * math.cos(splay) - gap_across * math.sin(splay), 0.0) / gap
    bearing = _bearing(side, robot.sides, distance) + xp.arctan((a - b) / xp.maximum(a + b, 1e-9) / math.tan(splay))
    gain = lobe * (a + b) / (2 * math.cos(splay))
    return bearing, gap / xp.sqrt(xp.maximum(gain, 1e-12)), xp.maximum(out_r + out_s, 0.0)


def _on_side(
    points: tuple[tuple[Point, ...], ...], axes: Axes, kind: Array | int, side: Array, like: Array
) -> tuple[Array, Array]:
    """Components of a kind's point of each side along the side's axis and to its left, for `kind` and `side` (P,)."""
    each = [(axis, point) for own in points for axis, point in zip(axes, own, strict=True)]
    along = tuple(x * axis[0] + y * axis[1] for axis, (x, y) in each)
    left = tuple(y * axis[0] - x * axis[1] for axis, (x, y) in each)
    return _look_up(along, kind * len(axes) + side, like), _look_up(left, kind * len(axes) + side, like)


def _look_up(values: tuple[float, ...], side: Array, like: Array) -> Any:
    """The value of each of `side` (P,), as `like` in type, or one number if all sides have the same."""
    if len(set(values)) == 1:
        return values[0]
    return array_module(side).asarray(values, dtype=like.dtype)[side]


def led_positions(poses: Float[Array, "*N 3"], robot: Robots, which: Any = None) -> Float[Array, "*N S 2"]:
    """World positions of the LEDs [mm] of robots at `poses` [mm, mm, rad], the first ones or those of these numbers."""
    return poses[..., None, :2] + _turned(poses, robot.each("leds", poses.shape[-2] if which is None else which))


def receiver_positions(poses: Float[Array, "*N 3"], robot: Robots) -> Float[Array, "*N S 2"]:
    """World positions [mm] at which the sides of the first robots, at `poses` [mm, mm, rad], receive light."""
    return poses[..., None, :2] + _turned(poses, robot.each("receivers", poses.shape[-2]))


def led_axes(poses: Float[Array, "*N 3"], robot: Robots) -> Float[Array, "*N S 2"]:
    """Optical axes of the LEDs, unit vectors in the world, of robots at `poses` [mm, mm, rad]."""
    return _turned(poses, np.array(robot.sides.leds))


def _turned(poses: Array, points: Float[np.ndarray, "*#N S 2"]) -> Array:
    """Vectors (..., N, S, 2) in the world, from `points` in the frames of robots at `poses` (..., N, 3)."""
    xp = array_module(poses)
    c, s = xp.cos(poses[..., 2, None]), xp.sin(poses[..., 2, None])
    ahead, left = (xp.asarray(points[..., k], dtype=poses.dtype) for k in (0, 1))
    return xp.stack([c * ahead - s * left, s * ahead + c * left], axis=-1)
