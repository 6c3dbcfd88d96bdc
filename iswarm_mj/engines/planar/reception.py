"""Light from one robot at another, as functions of numbers: the rules of `sensors.optics` for one pair.

All functions take and return numbers, so that any compiler of Python functions can compile them; those of another
compiler have the same bits only if its arithmetic does. Units: mm, rad.
"""

import math
from typing import NamedTuple

import numpy as np

from iswarm_mj.config.static import StaticOptics
from iswarm_mj.engines.planar.kinds import Place, Table, shared
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.utils.units import mm_from_rd


class Light(NamedTuple):
    """What reception depends on, the same for all pairs."""

    is_power: bool
    """Power mode, otherwise sector mode."""
    needs_sight: bool
    """A robot in between blocks the light."""
    reach: float
    """Effective distance from which on nothing is received."""
    farthest: float
    """Distance of the centres beyond which nothing is received."""
    photodiode_tan: float
    """Tangent of half the photodiodes' aperture, in sector mode."""
    led_tan: float
    """Likewise of the LEDs' beam."""
    lobe_order: float
    """Power of the cosine in the LEDs' lobe."""
    splay_cos: float
    """Cosine of the photodiodes' splay."""
    splay_sin: float
    splay_tan: float
    wall_reach: float
    """Distance from a LED up to which a wall reflects its light."""
    optical_offset: float
    """See `Robots.optical_offset`."""
    n_senders: int
    """Senders in sight of a side that are told of, the nearest ones."""
    is_regular: bool
    """See `Sides.is_regular`."""
    n_sides: int
    """S, of a robot."""


class Reception(NamedTuple):
    """How a robot gets the light of another one."""

    side: int
    """Of the receiver, that faces the sender."""
    led: int
    """Of the sender, that faces the receiver."""
    turn: float
    """Measured direction of the sender, from the axis of the side's photodiodes to its left [rad]."""
    effective: float
    """Effective distance, infinite where no light arrives."""


def read_light(robot: Robots, optics: StaticOptics) -> Light:
    """Numbers of the robots' optics."""
    reach, splay = mm_from_rd(optics.communication_radius), math.radians(optics.photodiode_splay)
    beam = math.radians(optics.led_beam_aperture / 2)
    return Light(
        is_power=optics.mode == "power",
        needs_sight=optics.line_of_sight,
        reach=reach,
        farthest=reach + 2 * robot.optical_offset,
        photodiode_tan=math.tan(math.radians(optics.photodiode_aperture / 2)),
        led_tan=math.tan(beam),
        lobe_order=-math.log(2) / math.log(math.cos(beam)),
        splay_cos=math.cos(splay),
        splay_sin=math.sin(splay),
        splay_tan=math.tan(splay),
        wall_reach=mm_from_rd(optics.wall_range),
        optical_offset=robot.optical_offset,
        n_senders=optics.n_senders,
        is_regular=robot.sides.is_regular,
        n_sides=len(robot.sides),
    )


def points_of(robot: Robots) -> np.ndarray:
    """Pairs of numbers of S sides of K kinds (K 5 S, 2), one kind after the other, see `plane.Kind.points`.

    They are the places of the LEDs and where each side receives light, ahead of and to the left of the robot's centre;
    the axes of the LEDs and of the photodiodes, see `Sides`; and the bearings of these [rad], beside a zero. The axes
    and the bearings are those of all kinds.
    """
    sides, bearings = robot.sides, [(bearing, 0.0) for bearing in robot.sides.bearings]
    each = ([*kind.leds, *kind.receivers, *sides.leds, *sides.photodiodes, *bearings] for kind in robot.kinds)
    return np.array([row for rows in each for row in rows])


@shared
def facing_side(ahead: float, left: float) -> int:
    """Number of the side in whose sector of 90 degrees the direction (ahead, left) lies, of four regular sides."""
    side = 0
    across = 1
    if ahead < 0.0:
        side = 2
    if left < 0.0:
        across = 3
    if abs(ahead) < abs(left):
        side = across
    return side


@shared
def onto_axis(ahead: float, left: float, c: float, s: float) -> tuple[float, float]:
    """Components of (ahead, left) along an axis (c, s) and to its left."""
    return c * ahead + s * left, c * left - s * ahead


@shared
def is_in_cone(along: float, across: float, tan: float) -> bool:
    """Whether a direction lies in a cone about the first component, `tan` the tangent of half its angle."""
    return abs(across) <= along * tan


@shared
def power_reception(
    along_r: float,
    across_r: float,
    along_s: float,
    across_s: float,
    out_r: float,
    left_r: float,
    out_s: float,
    left_s: float,
    power: float,
    light: Light,
) -> tuple[float, float]:
    """Reception in power mode.

    Args:
        along_r: component of the sender's position, from the receiver's centre, along the normal of the receiver's
            side that faces it.
        across_r: component to the left of that normal.
        along_s: of the receiver's position, from the sender's centre, along the normal of the side that faces it.
        across_s: likewise to the left.
        out_r: position of the receiver's photodiodes along the normal of their side.
        left_r: to the left of it.
        out_s: position of the sender's LED along the normal of its side.
        left_s: to the left of it.
        power: of the LED, above 0 and at most 1.
        light: optics.

    Returns:
        Measured direction of the sender, from the normal of the receiver's side to its left; and the effective
        distance, infinite where no light arrives.
    """
    distance = max(math.sqrt(along_r * along_r + across_r * across_r), 1e-6)
    # The sender's normal, seen from the receiving side: the angle between both normals follows from the two views.
    cos = -(along_r * along_s + across_r * across_s) / (distance * distance)
    sin = -(along_r * across_s - across_r * along_s) / (distance * distance)
    gap_along = along_r - out_r + out_s * cos + left_s * sin
    gap_across = across_r - left_r - out_s * sin + left_s * cos
    gap = max(math.sqrt(gap_along * gap_along + gap_across * gap_across), 1e-6)
    off_axis = (along_s - out_s + out_r * cos - left_r * sin) / gap
    lobe = math.pow(min(max(off_axis, 0.0), 1.0), light.lobe_order)
    a = max(gap_along * light.splay_cos + gap_across * light.splay_sin, 0.0) / gap
    b = max(gap_along * light.splay_cos - gap_across * light.splay_sin, 0.0) / gap
    gain = power * lobe * (a + b) / (2.0 * light.splay_cos)
    effective = gap / math.sqrt(max(gain, 1e-12)) + max(out_r + out_s, 0.0)
    if effective < light.reach:
        return math.atan((a - b) / max(a + b, 1e-9) / light.splay_tan), effective
    return 0.0, math.inf


@shared
def receive(
    dx: float,
    dy: float,
    receiver: Place,
    sender: Place,
    row_r: int,
    row_s: int,
    power: float,
    light: Light,
    points: Table,
) -> Reception:
    """How a receiver gets the light of a sender that is (dx, dy) away from it.

    Args:
        dx: x of the sender's centre less that of the receiver.
        dy: y likewise.
        receiver: where it is.
        sender: likewise.
        row_r: `points` of the receiver's kind.
        row_s: of the sender's kind.
        power: of the sender's LEDs, above 0 and at most 1.
        light: optics.
        points: see `points_of`.
    """
    n_sides = light.n_sides
    ahead_r, left_r = onto_axis(dx, dy, receiver[2], receiver[3])
    ahead_s, left_s = onto_axis(-dx, -dy, sender[2], sender[3])
    side, led = facing_side(ahead_r, left_r), facing_side(ahead_s, left_s)
    if not light.is_regular:
        side = nearest_axis(ahead_r, left_r, points, 3 * n_sides, n_sides)
        led = nearest_axis(ahead_s, left_s, points, 2 * n_sides, n_sides)
    c, s = points[3 * n_sides + side, 0], points[3 * n_sides + side, 1]
    c_led, s_led = points[2 * n_sides + led, 0], points[2 * n_sides + led, 1]
    along_r, across_r = onto_axis(ahead_r, left_r, c, s)
    along_s, across_s = onto_axis(ahead_s, left_s, c_led, s_led)
    turn, effective = 0.0, math.inf
    if light.is_power:
        out_r, aside_r = onto_axis(points[row_r + n_sides + side, 0], points[row_r + n_sides + side, 1], c, s)
        out_s, aside_s = onto_axis(points[row_s + led, 0], points[row_s + led, 1], c_led, s_led)
        turn, effective = power_reception(
            along_r, across_r, along_s, across_s, out_r, aside_r, out_s, aside_s, power, light
        )
    else:
        distance = math.sqrt(ahead_r * ahead_r + left_r * left_r) / math.sqrt(power)
        is_lit = is_in_cone(along_r, across_r, light.photodiode_tan) and is_in_cone(along_s, across_s, light.led_tan)
        if is_lit and distance < light.reach:
            effective = distance
    return Reception(side, led, turn, effective)


@shared
def nearest_axis(ahead: float, left: float, points: Table, first: int, n_sides: int) -> int:
    """Number of the axis nearest to a direction, of those that begin at `first`; of equally near ones the first."""
    side, nearest = int(0), float(-math.inf)
    for k in range(n_sides):
        along = ahead * points[first + k, 0] + left * points[first + k, 1]
        if along > nearest:
            side, nearest = k, along
    return side
