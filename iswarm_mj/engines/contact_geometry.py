"""Contacts of rectangles with each other and with walls, as functions of numbers.

Robots, obstacles and boxes are upright boxes; seen from above they are rectangles. MuJoCo finds
up to four contact points of two boxes, two at the upper rim and two at the lower one. Points
above each other are alike, so two remain.

numba, Warp and JAX compile these functions. They take and return numbers and named tuples of
numbers, and choose between numbers by `where`, since JAX cannot branch on them. Units: mm, rad.
"""

from math import sqrt
from typing import Any, NamedTuple

from numba.extending import register_jitable

X_OF_FIRST = 0
"""Axis of `separation`: along the first rectangle's heading."""
X_OF_SECOND = 1
"""Axis of `separation`: along the second rectangle's heading."""
Y_OF_FIRST = 2
"""Axis of `separation`: across the first rectangle's heading."""
Y_OF_SECOND = 3
"""Axis of `separation`: across the second rectangle's heading."""
TOUCHING = 0.1
"""Distance of the surfaces up to which bodies that push each other touch [mm].

By default contacts begin before that, see `arena.contact_margin`. With a refinement of 5 and more
the margin is less, and so is the distance at which bodies touch."""
APART = 1e6
"""Distance of the surfaces at contact points that do not exist [mm]."""


class Rectangle(NamedTuple):
    """Rectangle in the plane."""

    x: float
    """x of its centre."""
    y: float
    """y of its centre."""
    cos: float
    """Cosine of its heading."""
    sin: float
    """Sine of its heading."""
    half_x: float
    """Half its length along the heading."""
    half_y: float
    """Half its width across the heading."""


class Side(NamedTuple):
    """Side of a rectangle, seen from the rectangle's centre."""

    normal_x: float
    """x of its outward normal."""
    normal_y: float
    """y of its outward normal."""
    reach: float
    """Distance from the centre."""
    half_width: float
    """Half its length."""


class Ends(NamedTuple):
    """Ends of an incident side, or of a part of it, in the frame of a reference side.

    The coordinate along the reference side grows to the left of its normal, from the middle of
    the side.
    """

    start: float
    """Coordinate of one end."""
    start_height: float
    """Height of that end above the reference side, negative inside."""
    end: float
    """Coordinate of the other end."""
    end_height: float
    """Height of the other end."""


class Corners(NamedTuple):
    """A corner of a reference side and the nearer end of an incident side, and their normal.

    They are in the frame of the reference side.
    """

    are_nearest: bool
    """They are the nearest points of both rectangles: no part of the incident side is in front of
    the reference side."""
    corner: float
    """Coordinate of the reference side's corner along that side."""
    aside: float
    """Coordinate of the incident end along the reference side, less that of the corner."""
    height: float
    """Height of the incident end above the reference side."""
    distance: float
    """Distance of the corners."""
    cos: float
    """Cosine of the angle from the reference side's normal to that of the contact."""
    sin: float
    """Sine of that angle, which grows to the left of the reference side's normal."""


class ContactPoints(NamedTuple):
    """Normal and two points of a contact, the points halfway between both surfaces."""

    normal_x: float
    """x of the normal, from the first body (or the wall) to the second."""
    normal_y: float
    """y of the normal."""
    x1: float
    """x of the first point, seen from the centre of the first rectangle."""
    y1: float
    """y of the first point."""
    distance1: float
    """Distance of the surfaces at the first point, negative where they overlap."""
    x2: float
    """x of the second point."""
    y2: float
    """y of the second point."""
    distance2: float
    """Distance of the surfaces at the second point."""


@register_jitable
def where(condition: Any, if_true: Any, if_false: Any) -> Any:
    """Return one of two numbers; each compiler has a function of its own for this."""
    return if_true if condition else if_false


@register_jitable
def wider_gap(gap: float, axis: int, other_gap: float, other_axis: int) -> tuple[float, int]:
    """Return the larger of two gaps and its axis, the first ones where the gaps are equal."""
    is_wider = other_gap > gap
    return where(is_wider, other_gap, gap), where(is_wider, other_axis, axis)


@register_jitable
def separation(first: Rectangle, second: Rectangle) -> tuple[float, int]:
    """Return the largest gap between two rectangles along the normals of their sides.

    By the separating axis theorem they overlap where it is negative.

    Returns:
        The gap, and its axis, such as `X_OF_FIRST`; of equal gaps the first one in MuJoCo's order
        of the axes.
    """
    # From centre to centre in the arena, and in the frames of both rectangles.
    dx = second.x - first.x
    dy = second.y - first.y
    ahead1 = first.cos * dx + first.sin * dy
    left1 = first.cos * dy - first.sin * dx
    ahead2 = second.cos * dx + second.sin * dy
    left2 = second.cos * dy - second.sin * dx

    # Cosine and sine of the angle between the rectangles, whose signs do not matter.
    cos = abs(first.cos * second.cos + first.sin * second.sin)
    sin = abs(first.cos * second.sin - first.sin * second.cos)

    # The distance of the centres along each axis at which the rectangles would touch.
    reach_x1 = first.half_x + second.half_x * cos + second.half_y * sin
    reach_x2 = second.half_x + first.half_x * cos + first.half_y * sin
    reach_y1 = first.half_y + second.half_x * sin + second.half_y * cos
    reach_y2 = second.half_y + first.half_x * sin + first.half_y * cos

    gap_x1 = abs(ahead1) - reach_x1
    gap_x2 = abs(ahead2) - reach_x2
    gap_y1 = abs(left1) - reach_y1
    gap_y2 = abs(left2) - reach_y2

    gap, axis = wider_gap(gap_x1, X_OF_FIRST, gap_x2, X_OF_SECOND)
    gap, axis = wider_gap(gap, axis, gap_y1, Y_OF_FIRST)
    return wider_gap(gap, axis, gap_y2, Y_OF_SECOND)


@register_jitable
def choose(condition: bool, if_true: Rectangle, if_false: Rectangle) -> Rectangle:
    """Return one of two rectangles."""
    return Rectangle(
        x=where(condition, if_true.x, if_false.x),
        y=where(condition, if_true.y, if_false.y),
        cos=where(condition, if_true.cos, if_false.cos),
        sin=where(condition, if_true.sin, if_false.sin),
        half_x=where(condition, if_true.half_x, if_false.half_x),
        half_y=where(condition, if_true.half_y, if_false.half_y),
    )


@register_jitable
def side_towards(rectangle: Rectangle, x: float, y: float, is_along_y: bool) -> Side:
    """Return the side of a rectangle that looks towards the direction (x, y).

    Args:
        rectangle: its centre does not matter.
        x: x of the direction.
        y: y of the direction.
        is_along_y: choose between the sides whose normals are along the rectangle's y axis,
            otherwise its x axis.
    """
    axis_x = where(is_along_y, -rectangle.sin, rectangle.cos)
    axis_y = where(is_along_y, rectangle.cos, rectangle.sin)
    looks_away = axis_x * x + axis_y * y < 0.0
    return Side(
        normal_x=where(looks_away, -axis_x, axis_x),
        normal_y=where(looks_away, -axis_y, axis_y),
        reach=where(is_along_y, rectangle.half_y, rectangle.half_x),
        half_width=where(is_along_y, rectangle.half_x, rectangle.half_y),
    )


@register_jitable
def ends_of(reference: Side, incident: Side, x: float, y: float) -> Ends:
    """Return the ends of an incident side in the frame of a reference side.

    Args:
        reference: a side of one rectangle.
        incident: the side of another rectangle that faces it most.
        x: x of the vector from the reference rectangle's centre to that of the incident one.
        y: y of the vector.
    """
    # The middle of the incident side, from the reference rectangle's centre.
    middle_x = x + incident.reach * incident.normal_x
    middle_y = y + incident.reach * incident.normal_y

    # Coordinates of the middle and of the vector from there to one end.
    middle = middle_x * -reference.normal_y + middle_y * reference.normal_x
    height = middle_x * reference.normal_x + middle_y * reference.normal_y - reference.reach
    alignment = incident.normal_y * reference.normal_y + incident.normal_x * reference.normal_x
    tilt = incident.normal_x * reference.normal_y - incident.normal_y * reference.normal_x
    half = incident.half_width * alignment
    rise = incident.half_width * tilt
    return Ends(middle - half, height - rise, middle + half, height + rise)


@register_jitable
def clip_side(ends: Ends, half_width: float) -> Ends:
    """Return the ends of the part of an incident side that is in front of a reference side.

    Args:
        ends: ends of the incident side, of which a part is in front.
        half_width: half the length of the reference side.
    """
    slope = (ends.end_height - ends.start_height) / (ends.end - ends.start)
    start = min(max(ends.start, -half_width), half_width)
    end = min(max(ends.end, -half_width), half_width)
    return Ends(
        start=start,
        start_height=ends.start_height + slope * (start - ends.start),
        end=end,
        end_height=ends.end_height + slope * (end - ends.end),
    )


@register_jitable
def nearest_corners(ends: Ends, half_width: float) -> Corners:
    """Return the corners that are nearest where an incident side is beside a reference side.

    Where it is in front of that side, or corners coincide, the normal is that of the side.

    Args:
        ends: ends of the incident side.
        half_width: half the length of the reference side.
    """
    is_left = min(ends.start, ends.end) >= half_width
    is_right = max(ends.start, ends.end) <= -half_width
    are_nearest = where(is_left, is_left, is_right)  # JAX has no `or` for arrays
    corner = where(is_left, half_width, -half_width)

    start_is_nearer = abs(ends.start) < abs(ends.end)
    aside = where(start_is_nearer, ends.start, ends.end) - corner
    height = where(start_is_nearer, ends.start_height, ends.end_height)
    distance = sqrt(aside * aside + height * height)

    are_apart = distance > 0.0
    length = where(are_apart, distance, 1.0)
    has_own_normal = where(are_nearest, are_apart, are_nearest)
    return Corners(
        are_nearest=are_nearest,
        corner=corner,
        aside=aside,
        height=height,
        distance=distance,
        cos=where(has_own_normal, height / length, 1.0),
        sin=where(has_own_normal, aside / length, 0.0),
    )


@register_jitable
def rectangle_contact(first: Rectangle, second: Rectangle) -> ContactPoints:
    """Return the contact of two rectangles that overlap or are near each other.

    The axis of least overlap, or of the largest gap, belongs to the reference rectangle. The side
    of the other, incident rectangle that faces it most is clipped to the reference side's width;
    its ends are the contact points.

    Where neither rectangle is in front of a side of the other, a corner of each is nearest, and
    the normal leads from one to the other, so that robots that pass corner to corner do not stop
    each other. The second point is then `APART`. MuJoCo has no contact there.
    """
    # The reference rectangle, whose side has the axis, and where the incident one is from there.
    _, axis = separation(first, second)
    is_of_first = axis % 2 == X_OF_FIRST
    is_along_y = axis >= Y_OF_FIRST
    reference = choose(is_of_first, first, second)
    incident = choose(is_of_first, second, first)
    second_x = second.x - first.x
    second_y = second.y - first.y
    incident_x = where(is_of_first, second_x, -second_x)
    incident_y = where(is_of_first, second_y, -second_y)

    # The reference side, with its outward normal, and the side of the other that faces it most.
    side = side_towards(reference, incident_x, incident_y, is_along_y)
    out_x = side.normal_x
    out_y = side.normal_y
    alignment_of_y = abs(incident.cos * out_y - incident.sin * out_x)
    alignment_of_x = abs(incident.cos * out_x + incident.sin * out_y)
    faces_with_y = alignment_of_y > alignment_of_x
    facing_side = side_towards(incident, -out_x, -out_y, faces_with_y)

    # What of that side is in front of the reference side, or else the nearest corners.
    ends = ends_of(side, facing_side, incident_x, incident_y)
    front = clip_side(ends, side.half_width)
    corners = nearest_corners(ends, side.half_width)
    are_corners = corners.are_nearest

    # The normal from the reference to the incident rectangle: that of the side, or between corners.
    normal_x = corners.cos * out_x - corners.sin * out_y
    normal_y = corners.cos * out_y + corners.sin * out_x

    # Both points in the frame of the side: along it, and outwards, halfway between both surfaces.
    along1 = where(are_corners, corners.corner + 0.5 * corners.aside, front.start)
    height1 = where(are_corners, corners.height, front.start_height)
    outwards1 = side.reach + 0.5 * height1
    along2 = front.end
    outwards2 = side.reach + 0.5 * front.end_height

    # The same, seen from the first rectangle's centre.
    reference_x = where(is_of_first, 0.0, second_x)
    reference_y = where(is_of_first, 0.0, second_y)
    return ContactPoints(
        normal_x=where(is_of_first, normal_x, -normal_x),
        normal_y=where(is_of_first, normal_y, -normal_y),
        x1=reference_x - along1 * out_y + outwards1 * out_x,
        y1=reference_y + along1 * out_x + outwards1 * out_y,
        distance1=where(are_corners, corners.distance, front.start_height),
        x2=reference_x - along2 * out_y + outwards2 * out_x,
        y2=reference_y + along2 * out_x + outwards2 * out_y,
        distance2=where(are_corners, APART, front.end_height),
    )


@register_jitable
def wall_contact(
    gap: float,
    normal_x: float,
    normal_y: float,
    rectangle: Rectangle,
) -> ContactPoints:
    """Return the contact of a rectangle with a wall: its two corners nearest to the wall.

    Args:
        gap: distance of the rectangle's centre from the wall.
        normal_x: x of the wall's normal, into the arena.
        normal_y: y of the wall's normal.
        rectangle: its centre does not matter; the points are seen from there.
    """
    # The wall's normal in the frame of the rectangle.
    ahead = normal_x * rectangle.cos + normal_y * rectangle.sin
    left = normal_y * rectangle.cos - normal_x * rectangle.sin

    # The nearest corner, and the second nearest.
    ahead1 = where(ahead > 0.0, -rectangle.half_x, rectangle.half_x)
    left1 = where(left > 0.0, -rectangle.half_y, rectangle.half_y)
    faces_with_x = rectangle.half_x * abs(ahead) >= rectangle.half_y * abs(left)
    ahead2 = where(faces_with_x, ahead1, -ahead1)
    left2 = where(faces_with_x, -left1, left1)

    distance1 = gap + ahead * ahead1 + left * left1
    distance2 = gap + ahead * ahead2 + left * left2
    return ContactPoints(
        normal_x=normal_x,
        normal_y=normal_y,
        x1=ahead1 * rectangle.cos - left1 * rectangle.sin - 0.5 * distance1 * normal_x,
        y1=ahead1 * rectangle.sin + left1 * rectangle.cos - 0.5 * distance1 * normal_y,
        distance1=distance1,
        x2=ahead2 * rectangle.cos - left2 * rectangle.sin - 0.5 * distance2 * normal_x,
        y2=ahead2 * rectangle.sin + left2 * rectangle.cos - 0.5 * distance2 * normal_y,
        distance2=distance2,
    )
