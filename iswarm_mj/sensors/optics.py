"""Beams and photodiodes: light of one robot at another (paper, sections 3.1 and 4.3).

Each side of a robot has one LED and two photodiodes. Those of the paper's robot are numbered 0
front, 1 left, 2 back, 3 right; other robots have S sides, from two to eight, in any directions.
Light from a direction falls on the side whose photodiodes look nearest there, and light towards a
direction comes from the LED that does. The functions accept NumPy and JAX arrays of pairs; lengths
are in mm, angles in rad. They ignore what stands between two robots, see `links`, and robots do
not shade their own LEDs and photodiodes.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from iswarm_mj.config.static import StaticOptics
from iswarm_mj.geometry.directions import Components, into_frame
from iswarm_mj.geometry.robot import SIDES, Point, Robots, Sides
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.units import mm_from_rd

_SHORTEST = 1e-6
"""Distance below which light has no direction [mm]."""

_WEAKEST_POWER = 1e-12
"""Share of the full power, or of the gain on both axes, below which no light arrives."""

_WEAKEST_CURRENT = 1e-9
"""Sum of two currents below which they show no direction."""

Axes = tuple[Point, ...]
"""Unit vectors ahead and to the left, one of each side."""

Kinds = tuple[Int[Array, "*#P"] | int, Int[Array, "*#P"] | int]
"""Index in `robot.kinds` of receivers and of senders."""


class Reception(NamedTuple):
    """Light of senders at receivers, one entry a pair."""

    side: Int[Array, "*P"]
    """The receiver's side that faces the sender."""
    led: Int[Array, "*P"]
    """The sender's LED that shines towards the receiver."""
    bearing: Float[Array, "*P"]
    """Direction of the sender in the receiver's frame, as the photodiodes measure it [rad]."""
    effective_distance: Float[Array, "*P"]
    """Distance at which a sender on both optical axes is received equally well [mm]; infinite where
    it is not."""


class Views(NamedTuple):
    """Positions and sides of the robots of each pair, as they see each other."""

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


class _Light(NamedTuple):
    """Light of senders at the receivers' photodiodes."""

    bearing: Float[Array, "*P"]
    """Direction of the sender, see `Reception.bearing` [rad]."""
    path: Float[Array, "*P"]
    """Length of a path along both optical axes on which light loses as much [mm]."""
    offset: Any
    """Distance from centre to centre beside the path [mm]."""


class _LightPath(NamedTuple):
    """Straight path from an LED to the point halfway between a side's photodiodes."""

    along: Float[Array, "*P"]
    """Position of the LED along the side's axis, from the photodiodes [mm]."""
    across: Float[Array, "*P"]
    """Position of the LED to the left of the axis [mm]."""
    length: Float[Array, "*P"]
    """Length of the path [mm]."""
    emission_cos: Float[Array, "*P"]
    """Cosine of the angle between path and LED's axis."""
    offset: Float[Array, "*P"]
    """Distance of photodiodes and LED from the robots' centres, along their axes [mm]."""


def onto_axis(
    ahead: Float[Array, "*P"],
    left: Float[Array, "*P"],
    side: Int[Array, "*P"],
    axes: Axes,
) -> Components:
    """Return components of (ahead, left) along the axis of a side and to its left."""
    xp = array_module(ahead)
    if axes == SIDES:
        cos = xp.where(side == 0, 1.0, xp.where(side == 2, -1.0, 0.0))
        sin = xp.where(side == 1, 1.0, xp.where(side == 3, -1.0, 0.0))
    else:
        cos, sin = (_look_up(values, side, ahead) for values in zip(*axes, strict=True))
    return into_frame(ahead, left, (cos, sin))


def facing_side(
    ahead: Float[Array, "*P"],
    left: Float[Array, "*P"],
    axes: Axes = SIDES,
) -> Int[Array, "*P"]:
    """Return the side whose axis is nearest to (ahead, left), the first of equally near ones."""
    xp = array_module(ahead)
    if axes == SIDES:
        front_or_back = 2 * (ahead < 0)
        left_or_right = 1 + 2 * (left < 0)
        return xp.where(xp.abs(ahead) >= xp.abs(left), front_or_back, left_or_right)

    side = xp.zeros(ahead.shape, int)
    longest = ahead * axes[0][0] + left * axes[0][1]
    for index, (x, y) in enumerate(axes[1:], start=1):
        along = ahead * x + left * y
        side = xp.where(along > longest, index, side)
        longest = xp.maximum(along, longest)
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
    """Return how light arrives in pairs of robots.

    Args:
        dx: world x of the sender minus that of the receiver [mm].
        dy: world y of the sender minus that of the receiver [mm].
        receiver: cosine and sine of the receiver's yaw.
        sender: cosine and sine of the sender's yaw.
        robot: positions of LEDs and photodiodes.
        optics: mode, range and cones.
        power: power of the sender's LEDs, from 0 to 1; None for full power.
        kinds: index in `robot.kinds` of the receivers and of the senders.
    """
    at_receiver = into_frame(dx, dy, receiver)
    at_sender = into_frame(-dx, -dy, sender)
    views = Views(
        at_receiver=at_receiver,
        at_sender=at_sender,
        side=facing_side(*at_receiver, robot.sides.photodiodes),
        led=facing_side(*at_sender, robot.sides.leds),
        kinds=kinds,
    )
    return receive_views(views, robot, optics, power)


def receive_views(
    views: Views, robot: Robots, optics: StaticOptics, power: Float[Array, "*#P"] | None = None
) -> Reception:
    """Return how light arrives, as `receive`, between robots whose views are known."""
    xp = array_module(views.side)
    rule = _by_sector if optics.mode == "sector" else _by_power
    light = rule(views, robot, optics)

    # By the inverse square law, light of an LED of less power arrives as from farther away.
    path = light.path
    if power is not None:
        path = path / xp.sqrt(xp.maximum(power, _WEAKEST_POWER))
    distance = path + light.offset
    is_received = distance < mm_from_rd(optics.communication_radius)
    return Reception(
        side=views.side,
        led=views.led,
        bearing=light.bearing,
        effective_distance=xp.where(is_received, distance, math.inf),
    )


def _by_sector(views: Views, robot: Robots, optics: StaticOptics) -> _Light:
    """Return the light by the paper's rule: in the receiver's sector and in the sender's beam."""
    xp = array_module(views.side)
    sides = robot.sides
    ahead, left = views.at_receiver
    distance = xp.sqrt(ahead**2 + left**2)
    sector = optics.photodiode_aperture
    beam = optics.led_beam_aperture
    in_sector = _in_cone(views.at_receiver, views.side, sides.photodiodes, sector)
    in_beam = _in_cone(views.at_sender, views.led, sides.leds, beam)
    return _Light(
        bearing=_bearing(views.side, sides, distance),
        path=xp.where(in_sector & in_beam, distance, math.inf),
        offset=0.0,
    )


def _in_cone(direction: Components, side: Array, axes: Axes, aperture: float) -> Array:
    """Return whether a direction lies in a cone around the axis of the side that faces it.

    Args:
        direction: ahead and to the left.
        side: number of the side.
        axes: axes of all sides.
        aperture: full angle of the cone [deg].
    """
    xp = array_module(side)
    slope = math.tan(math.radians(aperture / 2))
    if axes == SIDES:
        ahead = xp.abs(direction[0])
        left = xp.abs(direction[1])
        return xp.minimum(ahead, left) <= xp.maximum(ahead, left) * slope
    along, across = onto_axis(*direction, side, axes)
    return xp.abs(across) <= along * slope


def _bearing(side: Array, sides: Sides, like: Array) -> Array:
    """Return the direction of a side's photodiodes [rad], of the type of `like`."""
    if sides.photodiodes == SIDES:
        return side * (math.pi / 2)
    return _look_up(sides.bearings, side, like)


def _by_power(views: Views, robot: Robots, optics: StaticOptics) -> _Light:
    """Return the light by power: Lambertian lobe, inverse square, acceptance of the photodiodes.

    The lobe is cos^m with half its power at half the beam's aperture,
    m = -ln 2 / ln cos(aperture / 2) (Kahn & Barry 1997, Proc. IEEE 85, 265). Light travels from the
    LED of the sending side to the point halfway between the photodiodes of the receiving one. Each
    of these accepts cos(angle) about an axis splayed from the side's normal; their powers a and b
    give the bearing, tan(bearing) tan(splay) = (a - b) / (a + b). The threshold is such that a
    sender on both axes is received up to `communication_radius`, from centre to centre.
    """
    xp = array_module(views.side)
    path = _light_path(views, robot)

    order = -math.log(2) / math.log(math.cos(math.radians(optics.led_beam_aperture / 2)))
    lobe = xp.clip(path.emission_cos, 0.0, 1.0) ** order

    splay = math.radians(optics.photodiode_splay)
    towards_left = path.along * math.cos(splay) + path.across * math.sin(splay)
    towards_right = path.along * math.cos(splay) - path.across * math.sin(splay)
    a = xp.maximum(towards_left, 0.0) / path.length
    b = xp.maximum(towards_right, 0.0) / path.length

    gain = lobe * (a + b) / (2 * math.cos(splay))
    off_axis = xp.arctan((a - b) / xp.maximum(a + b, _WEAKEST_CURRENT) / math.tan(splay))
    return _Light(
        bearing=_bearing(views.side, robot.sides, path.length) + off_axis,
        path=path.length / xp.sqrt(xp.maximum(gain, _WEAKEST_POWER)),
        offset=xp.maximum(path.offset, 0.0),
    )


def _light_path(views: Views, robot: Robots) -> _LightPath:
    """Return the paths from LEDs to photodiodes, in the frames of the receiving sides.

    Index r means the frame of the receiver's side, s that of the sender's LED: x along its optical
    axis and y to the left, from the robot's centre.
    """
    xp = array_module(views.side)
    sides = robot.sides
    kind_r, kind_s = views.kinds

    # The other robot's centre in either frame, and the rotation between the frames.
    x_r, y_r = onto_axis(*views.at_receiver, views.side, sides.photodiodes)
    x_s, y_s = onto_axis(*views.at_sender, views.led, sides.leds)
    distance = xp.maximum(xp.hypot(x_r, y_r), _SHORTEST)
    cos = -(x_r * x_s + y_r * y_s) / distance**2
    sin = -(x_r * y_s - y_r * x_s) / distance**2

    # Photodiodes and LED, each in its own frame.
    receivers = tuple(kind.receivers for kind in robot.kinds)
    leds = tuple(kind.leds for kind in robot.kinds)
    diode_x, diode_y = _on_side(receivers, sides.photodiodes, kind_r, views.side, distance)
    led_x, led_y = _on_side(leds, sides.leds, kind_s, views.led, distance)

    along = x_r - diode_x + led_x * cos + led_y * sin
    across = y_r - diode_y - led_x * sin + led_y * cos
    length = xp.maximum(xp.hypot(along, across), _SHORTEST)
    return _LightPath(
        along=along,
        across=across,
        length=length,
        emission_cos=(x_s - led_x + diode_x * cos - diode_y * sin) / length,
        offset=diode_x + led_x,
    )


def _on_side(
    points: tuple[tuple[Point, ...], ...],
    axes: Axes,
    kind: Array | int,
    side: Array,
    like: Array,
) -> tuple[Array, Array]:
    """Return the components of points of sides along their axes and to the left [mm].

    Args:
        points: point of each side, of each kind of robot [mm].
        axes: axes of the sides.
        kind: (P,) indices of kinds.
        side: (P,) numbers of sides.
        like: array of the type to return.
    """
    along = []
    left = []
    for points_of_kind in points:
        for (axis_x, axis_y), (x, y) in zip(axes, points_of_kind, strict=True):
            along.append(x * axis_x + y * axis_y)
            left.append(y * axis_x - x * axis_y)
    index = kind * len(axes) + side
    return _look_up(tuple(along), index, like), _look_up(tuple(left), index, like)


def _look_up(values: tuple[float, ...], index: Array, like: Array) -> Any:
    """Return the values at indices (P,), of the type of `like`; one number if all are equal."""
    if len(set(values)) == 1:
        return values[0]
    return array_module(index).asarray(values, dtype=like.dtype)[index]


def led_positions(
    poses: Float[Array, "*N 3"],
    robot: Robots,
    which: Any = None,
) -> Float[Array, "*N S 2"]:
    """Return the world positions of LEDs [mm].

    Args:
        poses: x, y [mm] and yaw [rad] of robots.
        robot: positions of the LEDs.
        which: indices of the robots, by default the first ones.
    """
    which = poses.shape[-2] if which is None else which
    return poses[..., None, :2] + _into_world(poses, robot.each("leds", which))


def receiver_positions(poses: Float[Array, "*N 3"], robot: Robots) -> Float[Array, "*N S 2"]:
    """Return the world positions [mm] at which the sides of the first robots receive light.

    Args:
        poses: x, y [mm] and yaw [rad] of the robots.
        robot: positions of the photodiodes.
    """
    return poses[..., None, :2] + _into_world(poses, robot.each("receivers", poses.shape[-2]))


def led_axes(poses: Float[Array, "*N 3"], robot: Robots) -> Float[Array, "*N S 2"]:
    """Return the optical axes of LEDs, unit vectors in the world.

    Args:
        poses: x, y [mm] and yaw [rad] of robots.
        robot: directions of the LEDs.
    """
    return _into_world(poses, np.array(robot.sides.leds))


def _into_world(poses: Array, points: Float[np.ndarray, "*#N S 2"]) -> Array:
    """Return vectors (..., N, S, 2) in the world, of points in the frames of robots at `poses`."""
    xp = array_module(poses)
    cos = xp.cos(poses[..., 2, None])
    sin = xp.sin(poses[..., 2, None])
    ahead = xp.asarray(points[..., 0], dtype=poses.dtype)
    left = xp.asarray(points[..., 1], dtype=poses.dtype)
    return xp.stack([cos * ahead - sin * left, sin * ahead + cos * left], axis=-1)
