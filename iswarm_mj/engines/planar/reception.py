"""Light from one robot at another, as functions of numbers.

They are the rules of `sensors.optics` for one pair. Any compiler of Python functions can compile
them; results of two compilers have the same bits only if their arithmetic does. Units: mm, rad.
"""

import math
from typing import NamedTuple

import numpy as np

from iswarm_mj.config.static import StaticOptics
from iswarm_mj.engines.planar.kinds import Place, Table, shared
from iswarm_mj.engines.planar.ray_geometry import into_frame
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.utils.units import mm_from_rd


class Light(NamedTuple):
    """Optics, the same for all pairs of robots."""

    is_power: bool
    """Power mode, otherwise sector mode (see `OpticsConfig.mode`)."""
    needs_sight: bool
    """A robot in between blocks the light."""
    reach: float
    """Effective distance at which light is no longer received."""
    farthest: float
    """Distance of the centres beyond which nothing is received."""
    photodiode_tan: float
    """Tangent of half the photodiodes' aperture, in sector mode."""
    led_tan: float
    """Tangent of half the aperture of the LEDs' beam, in sector mode."""
    lobe_order: float
    """Exponent of the cosine in the LEDs' lobe."""
    splay_cos: float
    """Cosine of the photodiodes' splay."""
    splay_sin: float
    """Sine of the photodiodes' splay."""
    splay_tan: float
    """Tangent of the photodiodes' splay."""
    wall_reach: float
    """Distance from an LED up to which a wall reflects its light."""
    optical_offset: float
    """Offset that effective distances are measured with, see `Robots.optical_offset` [mm]."""
    n_senders: int
    """Number of senders that a side reports, the nearest ones in sight."""
    is_regular: bool
    """The sides are the paper's, see `Sides.is_regular`."""
    n_sides: int
    """Number S of a robot's sides."""


class Reception(NamedTuple):
    """Light of one robot as another one receives it."""

    side: int
    """Side of the receiver that faces the sender."""
    led: int
    """LED of the sender that faces the receiver."""
    turn: float
    """Measured direction of the sender, from the axis of the photodiodes to its left [rad]."""
    effective: float
    """Effective distance, infinite where no light arrives."""


def read_light(robot: Robots, optics: StaticOptics) -> Light:
    """Return the numbers of the robots' optics."""
    reach = mm_from_rd(optics.communication_radius)
    splay = math.radians(optics.photodiode_splay)
    half_beam = math.radians(optics.led_beam_aperture / 2)
    return Light(
        is_power=optics.mode == "power",
        needs_sight=optics.line_of_sight,
        reach=reach,
        farthest=reach + 2 * robot.optical_offset,
        photodiode_tan=math.tan(math.radians(optics.photodiode_aperture / 2)),
        led_tan=math.tan(half_beam),
        lobe_order=-math.log(2) / math.log(math.cos(half_beam)),
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
    """Return the points and axes (K 5 S, 2) of K kinds of robots with S sides.

    The rows of a kind begin at `plane.Kind.first_point`. They are, for each side: the position of
    the LED and where the side receives light, ahead of and to the left of the robot's centre; the
    axis of the LED and that of the photodiodes (see `Sides`); and the bearing of the photodiodes
    [rad], beside a zero. Axes and bearings are the same for all kinds. `led_position` and the
    next four functions read the table.
    """
    sides = robot.sides
    bearings = [(bearing, 0.0) for bearing in sides.bearings]
    rows = []
    for kind in robot.kinds:
        rows += [*kind.leds, *kind.receivers, *sides.leds, *sides.photodiodes, *bearings]
    return np.array(rows)


class Point(NamedTuple):
    """Vector in the frame of a robot."""

    ahead: float
    """Component along the robot's heading."""
    left: float
    """Component to the left of the heading."""


@shared
def point_in(points: Table, row: int) -> Point:
    """Return a row of `points_of`."""
    return Point(points[row, 0], points[row, 1])


@shared
def led_position(points: Table, first_point: int, side: int) -> Point:
    """Return where a side's LED is, on the kind whose rows begin at `first_point`."""
    return point_in(points, first_point + side)


@shared
def receiver_position(points: Table, first_point: int, side: int, n_sides: int) -> Point:
    """Return where a side receives light; arguments as for `led_position`."""
    return point_in(points, first_point + n_sides + side)


@shared
def led_axis(points: Table, side: int, n_sides: int) -> Point:
    """Return the optical axis of a side's LED."""
    return point_in(points, 2 * n_sides + side)


@shared
def photodiode_axis(points: Table, side: int, n_sides: int) -> Point:
    """Return the optical axis of a side's photodiodes."""
    return point_in(points, 3 * n_sides + side)


@shared
def photodiode_bearing(points: Table, side: int, n_sides: int) -> float:
    """Return the direction in which a side's photodiodes look [rad]."""
    return points[4 * n_sides + side, 0]


@shared
def facing_side(ahead: float, left: float) -> int:
    """Return the side in whose sector of 90 degrees a direction lies, of four regular sides."""
    along_heading = int(0)
    across = int(1)
    if ahead < 0.0:
        along_heading = 2
    if left < 0.0:
        across = 3
    if abs(ahead) < abs(left):
        return across
    return along_heading


@shared
def is_in_cone(along: float, across: float, tan: float) -> bool:
    """Return whether a direction lies in a cone about its first component.

    Args:
        along: component along the cone's axis.
        across: component across it.
        tan: tangent of half the cone's angle.
    """
    return abs(across) <= along * tan


@shared
def nearest_axis(ahead: float, left: float, points: Table, first_row: int, n_sides: int) -> int:
    """Return the number of the axis nearest to a direction; of equally near ones the first.

    Args:
        ahead: component of the direction along the robot's heading.
        left: component to the left.
        points: see `points_of`.
        first_row: row of the first axis.
        n_sides: number of axes.
    """
    side = int(0)
    nearest = float(-math.inf)
    for k in range(n_sides):
        axis = point_in(points, first_row + k)
        along = ahead * axis.ahead + left * axis.left
        if along > nearest:
            side = k
            nearest = along
    return side


@shared
def side_towards(ahead: float, left: float, light: Light, points: Table) -> int:
    """Return the side whose photodiodes face a direction."""
    if light.is_regular:
        return facing_side(ahead, left)
    return nearest_axis(ahead, left, points, 3 * light.n_sides, light.n_sides)


@shared
def led_towards(ahead: float, left: float, light: Light, points: Table) -> int:
    """Return the LED that faces a direction."""
    if light.is_regular:
        return facing_side(ahead, left)
    return nearest_axis(ahead, left, points, 2 * light.n_sides, light.n_sides)


class Port(NamedTuple):
    """One end of a link, in the frame of the optical axis there.

    The components are along the axis and to its left, from the robot's centre.
    """

    partner_along: float
    """Component of the other robot's position along the axis."""
    partner_across: float
    """Component of the other robot's position to the left of the axis."""
    along: float
    """Component of the position of the LED or the photodiodes along the axis."""
    across: float
    """Component of that position to the left of the axis."""


@shared
def port(partner_along: float, partner_across: float, position: Point, axis: Point) -> Port:
    """Return an end of a link, whose position and axis are in the robot's frame."""
    along, across = into_frame(position.ahead, position.left, axis.ahead, axis.left)
    return Port(partner_along, partner_across, along, across)


@shared
def power_reception(
    receiver: Port,
    sender: Port,
    power: float,
    light: Light,
) -> tuple[float, float]:
    """Return the reception in power mode.

    Args:
        receiver: photodiodes of the receiver.
        sender: LED of the sender.
        power: power of the LED, above 0 and at most 1.
        light: optics.

    Returns:
        Measured direction of the sender, from the axis of the photodiodes to its left [rad]; and
        the effective distance, infinite where no light arrives [mm].
    """
    along_r = receiver.partner_along
    across_r = receiver.partner_across
    along_s = sender.partner_along
    across_s = sender.partner_across
    distance = max(math.sqrt(along_r * along_r + across_r * across_r), 1e-6)

    # The sender's axis, seen from the receiving side: its angle follows from the two views.
    cos = -(along_r * along_s + across_r * across_s) / (distance * distance)
    sin = -(along_r * across_s - across_r * along_s) / (distance * distance)

    # The vector from the photodiodes to the LED.
    gap_along = along_r - receiver.along + sender.along * cos + sender.across * sin
    gap_across = across_r - receiver.across - sender.along * sin + sender.across * cos
    gap = max(math.sqrt(gap_along * gap_along + gap_across * gap_across), 1e-6)

    # The LED's lobe, and the gain of both photodiodes.
    off_axis = (along_s - sender.along + receiver.along * cos - receiver.across * sin) / gap
    lobe = math.pow(min(max(off_axis, 0.0), 1.0), light.lobe_order)
    left_gain = max(gap_along * light.splay_cos + gap_across * light.splay_sin, 0.0) / gap
    right_gain = max(gap_along * light.splay_cos - gap_across * light.splay_sin, 0.0) / gap
    gain = power * lobe * (left_gain + right_gain) / (2.0 * light.splay_cos)

    effective = gap / math.sqrt(max(gain, 1e-12)) + max(receiver.along + sender.along, 0.0)
    if effective < light.reach:
        balance = (left_gain - right_gain) / max(left_gain + right_gain, 1e-9)
        return math.atan(balance / light.splay_tan), effective
    return 0.0, math.inf


@shared
def receive(
    receiver: Place,
    sender: Place,
    receiver_points: int,
    sender_points: int,
    power: float,
    light: Light,
    points: Table,
) -> Reception:
    """Return how a receiver gets the light of a sender.

    Args:
        receiver: place of the receiver.
        sender: place of the sender.
        receiver_points: `Kind.first_point` of the receiver.
        sender_points: `Kind.first_point` of the sender.
        power: power of the sender's LEDs, above 0 and at most 1.
        light: optics.
        points: see `points_of`.
    """
    n_sides = light.n_sides
    dx = sender.x - receiver.x
    dy = sender.y - receiver.y

    # Where each sees the other: in the robots' frames, and in those of the sides that face each
    # other.
    ahead_r, left_r = into_frame(dx, dy, receiver.cos, receiver.sin)
    ahead_s, left_s = into_frame(-dx, -dy, sender.cos, sender.sin)
    side = side_towards(ahead_r, left_r, light, points)
    led = led_towards(ahead_s, left_s, light, points)
    axis_r = photodiode_axis(points, side, n_sides)
    axis_s = led_axis(points, led, n_sides)
    along_r, across_r = into_frame(ahead_r, left_r, axis_r.ahead, axis_r.left)
    along_s, across_s = into_frame(ahead_s, left_s, axis_s.ahead, axis_s.left)

    turn = float(0.0)
    effective = float(math.inf)
    if light.is_power:
        photodiodes = receiver_position(points, receiver_points, side, n_sides)
        emitter = led_position(points, sender_points, led)
        turn, effective = power_reception(
            port(along_r, across_r, photodiodes, axis_r),
            port(along_s, across_s, emitter, axis_s),
            power,
            light,
        )
    else:
        distance = math.sqrt(ahead_r * ahead_r + left_r * left_r) / math.sqrt(power)
        is_received = is_in_cone(along_r, across_r, light.photodiode_tan)
        is_sent = is_in_cone(along_s, across_s, light.led_tan)
        if is_received and is_sent and distance < light.reach:
            effective = distance
    return Reception(side, led, turn, effective)
