"""Light from one robot at another, as functions of numbers: the rules of `sensors.optics` for one pair.

All functions take and return numbers, so that any compiler of Python functions can compile them; those of another
compiler have the same bits only if its arithmetic does. Units: mm, rad.
"""

import math
from typing import NamedTuple

from numba.extending import register_jitable

from iswarm_mj.config import OpticsConfig
from iswarm_mj.utils.robot import Point, Robot
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
    """See `Robot.optical_offset`."""
    n_senders: int
    """Senders in sight of a side that are told of, the nearest ones."""
    is_regular: bool
    """See `Sides.is_regular`."""
    leds: tuple[Point, ...]
    """Where each side's LED sits, ahead of and to the left of the robot's centre."""
    receivers: tuple[Point, ...]
    """Where each side receives light, likewise."""
    led_axes: tuple[Point, ...]
    """Where each LED looks, see `Sides`."""
    axes: tuple[Point, ...]
    """Where the photodiodes of each side look."""
    bearings: tuple[float, ...]
    """Their directions [rad]."""


def read_light(robot: Robot, optics: OpticsConfig) -> Light:
    """Numbers of a robot's optics."""
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
        leds=robot.leds,
        receivers=robot.receivers,
        led_axes=robot.sides.leds,
        axes=robot.sides.photodiodes,
        bearings=robot.sides.bearings,
    )


@register_jitable
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


@register_jitable
def onto_side(ahead: float, left: float, side: int) -> tuple[float, float]:
    """Components of (ahead, left) along a side's outward normal and to its left, of four regular sides."""
    if side == 0:
        return ahead, left
    if side == 1:
        return left, -ahead
    if side == 2:
        return -ahead, -left
    return -left, ahead


@register_jitable
def onto_axis(ahead: float, left: float, c: float, s: float) -> tuple[float, float]:
    """Components of (ahead, left) along an axis (c, s) and to its left."""
    return c * ahead + s * left, c * left - s * ahead


@register_jitable
def is_in_cone(along: float, across: float, tan: float) -> bool:
    """Whether a direction lies in a cone about the first component, `tan` the tangent of half its angle."""
    return abs(across) <= along * tan


@register_jitable
def sector_distance(
    ahead_r: float,
    left_r: float,
    ahead_s: float,
    left_s: float,
    photodiode_tan: float,
    led_tan: float,
    reach: float,
) -> float:
    """Effective distance in sector mode; infinite where no light arrives.

    Args:
        ahead_r: component of the sender's position, from the receiver's centre, along the receiver's heading.
        left_r: component to the left of that heading.
        ahead_s: of the receiver's position, from the sender's centre, along the sender's heading.
        left_s: likewise to the left.
        photodiode_tan: tangent of half the aperture.
        led_tan: likewise of the LED's beam.
        reach: light arrives from closer than this.
    """
    distance = math.sqrt(ahead_r * ahead_r + left_r * left_r)
    is_seen = min(abs(ahead_r), abs(left_r)) <= max(abs(ahead_r), abs(left_r)) * photodiode_tan
    is_lit = min(abs(ahead_s), abs(left_s)) <= max(abs(ahead_s), abs(left_s)) * led_tan
    if is_seen and is_lit and distance < reach:
        return distance
    return math.inf


@register_jitable
def power_reception(
    along_r: float,
    across_r: float,
    along_s: float,
    across_s: float,
    out_r: float,
    left_r: float,
    out_s: float,
    left_s: float,
    lobe_order: float,
    splay_cos: float,
    splay_sin: float,
    splay_tan: float,
    reach: float,
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
        lobe_order: power of the cosine in the LED's lobe.
        splay_cos: cosine of the photodiodes' splay.
        splay_sin: sine of it.
        splay_tan: tangent of it.
        reach: effective distance from which on nothing is received.

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
    lobe = math.pow(min(max(off_axis, 0.0), 1.0), lobe_order)
    a = max(gap_along * splay_cos + gap_across * splay_sin, 0.0) / gap
    b = max(gap_along * splay_cos - gap_across * splay_sin, 0.0) / gap
    gain = lobe * (a + b) / (2.0 * splay_cos)
    effective = gap / math.sqrt(max(gain, 1e-12)) + max(out_r + out_s, 0.0)
    if effective < reach:
        return math.atan((a - b) / max(a + b, 1e-9) / splay_tan), effective
    return 0.0, math.inf


@register_jitable
def is_crossed(ox: float, oy: float, vx: float, vy: float, c: float, s: float, hx: float, hy: float) -> bool:
    """Whether a straight path of light meets a rectangle; separating axis theorem.

    Args:
        ox: x of the path's beginning, from the rectangle's centre.
        oy: likewise y.
        vx: x of the vector to its end.
        vy: y of it.
        c: cosine of the rectangle's heading.
        s: sine of it.
        hx: half edge along the heading.
        hy: half edge across it.
    """
    ux = 0.5 * (c * vx + s * vy)
    uy = 0.5 * (c * vy - s * vx)
    x = c * ox + s * oy + ux  # of the path's middle
    y = c * oy - s * ox + uy
    is_beside = abs(x * uy - y * ux) > hx * abs(uy) + hy * abs(ux)
    is_away = abs(x) > hx + abs(ux) or abs(y) > hy + abs(uy)
    return not (is_beside or is_away)
