"""Contact of one pair of bodies: what the solver needs of it, and one step of the solver.

A contact has one or two rows, one for each contact point. At a point the surfaces separate with
velocity

    J v = n (v2 - v1) + lever w2 - arm w1

where n is the normal from the first body to the second, v and w are their velocities and yaw
rates, and arm and lever are the vector products of the point's position, seen from the first and
the second centre, with the normal. The matrix of the rows is H = J M^-1 J^T + R. Units: mm, mg,
s, rad.
"""

import math
from typing import NamedTuple

from iswarm_mj.engines.contact_geometry import (
    APART,
    ContactPoints,
    Rectangle,
    rectangle_contact,
    separation,
    wall_contact,
)
from iswarm_mj.engines.planar.contact_law import (
    ContactLaw,
    impedance,
    offset,
    regularisation,
    two_impulses,
)
from iswarm_mj.engines.planar.kinds import Place, Velocity, Wall, shared
from iswarm_mj.engines.planar.plane import Kind


class Touch(NamedTuple):
    """Two points where bodies may touch; the arms of a first body that does not move are 0."""

    normal_x: float
    """x of the normal, from the first to the second body."""
    normal_y: float
    """y of the normal."""
    arm1: float
    """Arm of the first point."""
    arm2: float
    """Arm of the second point."""
    lever1: float
    """Lever of the first point."""
    lever2: float
    """Lever of the second point."""
    distance1: float
    """Distance of the surfaces at the first point, negative where they overlap."""
    distance2: float
    """Distance of the surfaces at the second point."""


class Row(NamedTuple):
    """Condition p >= 0, J v' + R p + offset >= 0 of one contact point, see `contact_law`."""

    arm: float
    """Arm at the first body [mm]."""
    lever: float
    """Lever at the second body [mm]."""
    offset: float
    """Offset of the condition [mm/s]."""
    softness: float
    """Regularisation R [1/mg]."""


class Rows(NamedTuple):
    """Rows of a contact, those of points within the margin first; zero for others."""

    n_rows: int
    """Number of points within the margin."""
    normal_x: float
    """x of the normal, from the first to the second body."""
    normal_y: float
    """y of the normal."""
    arm1: float
    """Arm of the first row."""
    arm2: float
    """Arm of the second row."""
    lever1: float
    """Lever of the first row."""
    lever2: float
    """Lever of the second row."""
    offset1: float
    """Offset of the first row."""
    offset2: float
    """Offset of the second row."""
    softness1: float
    """R of the first row."""
    softness2: float
    """R of the second row."""


class Friction(NamedTuple):
    """Impulses of the floor's friction on a body in a step."""

    x: float
    """Impulse along the world's x axis [mg mm/s]."""
    y: float
    """Impulse along the world's y axis [mg mm/s]."""
    yaw: float
    """Angular impulse about the vertical axis [mg mm^2/s]."""


@shared
def rectangle_of(place: Place, kind: Kind) -> Rectangle:
    """Return the hull of a body at a place."""
    return Rectangle(
        x=place.x,
        y=place.y,
        cos=place.cos,
        sin=place.sin,
        half_x=kind.half_x,
        half_y=kind.half_y,
    )


@shared
def gap_to_wall(wall: Wall, x: float, y: float) -> float:
    """Return the distance of a point from a wall, negative beyond it."""
    return wall.distance - wall.normal_x * x - wall.normal_y * y


@shared
def wall_gap(place: Place, kind: Kind, wall: Wall, margin: float) -> float:
    """Return the gap between a body and a wall, negative where the body reaches beyond it.

    If it is no less than the margin, any number that is not either will do.
    """
    gap = gap_to_wall(wall, place.x, place.y)
    if gap >= kind.radius + margin:
        return margin
    ahead = abs(place.cos * wall.normal_x + place.sin * wall.normal_y)
    left = abs(place.cos * wall.normal_y - place.sin * wall.normal_x)
    return gap - kind.half_x * ahead - kind.half_y * left


@shared
def body_gap(
    first: Rectangle,
    first_radius: float,
    second: Rectangle,
    second_radius: float,
    margin: float,
) -> float:
    """Return the gap between two rectangles, see `separation`, negative where they overlap.

    If it is no less than the margin, any number that is not either will do.

    Args:
        first: first rectangle.
        first_radius: radius of its circumcircle.
        second: second rectangle.
        second_radius: radius of its circumcircle.
        margin: margin of their contact.
    """
    dx = second.x - first.x
    dy = second.y - first.y
    reach = first_radius + second_radius + margin
    if dx * dx + dy * dy >= reach * reach:
        return margin
    gap, _ = separation(first, second)
    return gap


@shared
def touch_wall(place: Place, kind: Kind, wall: Wall) -> Touch:
    """Return how a body touches a wall."""
    inward_x = -wall.normal_x
    inward_y = -wall.normal_y
    gap = gap_to_wall(wall, place.x, place.y)
    points = wall_contact(gap, inward_x, inward_y, rectangle_of(place, kind))
    return Touch(
        normal_x=inward_x,
        normal_y=inward_y,
        arm1=0.0,
        arm2=0.0,
        lever1=points.x1 * inward_y - points.y1 * inward_x,
        lever2=points.x2 * inward_y - points.y2 * inward_x,
        distance1=points.distance1,
        distance2=points.distance2,
    )


@shared
def touch_obstacle(obstacle: Rectangle, body: Rectangle) -> Touch:
    """Return how a body touches an obstacle, which does not move."""
    points = rectangle_contact(obstacle, body)
    return touch_at(points, 0.0, 0.0, body.x - obstacle.x, body.y - obstacle.y)


@shared
def touch_body(first: Rectangle, second: Rectangle) -> Touch:
    """Return how two bodies touch that both move."""
    points = rectangle_contact(first, second)
    arm1 = points.x1 * points.normal_y - points.y1 * points.normal_x
    arm2 = points.x2 * points.normal_y - points.y2 * points.normal_x
    return touch_at(points, arm1, arm2, second.x - first.x, second.y - first.y)


@shared
def is_between_corners(touch: Touch) -> bool:
    """Return whether the nearest features of two bodies are corners; see `rectangle_contact`."""
    return touch.distance2 == APART


@shared
def touch_at(points: ContactPoints, arm1: float, arm2: float, dx: float, dy: float) -> Touch:
    """Return contact points with their arms and levers.

    Args:
        points: seen from the centre of the first body.
        arm1: arm of the first point.
        arm2: arm of the second point.
        dx: x of the vector from the first centre to the second.
        dy: y of that vector.
    """
    return Touch(
        normal_x=points.normal_x,
        normal_y=points.normal_y,
        arm1=arm1,
        arm2=arm2,
        lever1=(points.x1 - dx) * points.normal_y - (points.y1 - dy) * points.normal_x,
        lever2=(points.x2 - dx) * points.normal_y - (points.y2 - dy) * points.normal_x,
        distance1=points.distance1,
        distance2=points.distance2,
    )


@shared
def rows_of(
    touch: Touch,
    first_velocity: Velocity,
    second_velocity: Velocity,
    law: ContactLaw,
    inverse_weight: float,
    timestep: float,
) -> Rows:
    """Return the rows of a contact.

    Args:
        touch: points at which the bodies touch.
        first_velocity: velocity of the first body before the step.
        second_velocity: velocity of the second body before the step.
        law: the contact's law.
        inverse_weight: sum of both bodies' inverse weights, see `regularisation` [1/mg].
        timestep: time step [s].
    """
    normal_velocity = separation_rate(
        touch.normal_x,
        touch.normal_y,
        first_velocity,
        second_velocity,
    )
    n_rows = int(0)
    first = Row(0.0, 0.0, 0.0, 0.0)
    second = Row(0.0, 0.0, 0.0, 0.0)
    n_points = int(2)  # a variable, so that Warp loops: unrolled, it would be most of a GPU program
    for point in range(n_points):
        arm = float(touch.arm1)
        lever = float(touch.lever1)
        distance = float(touch.distance1)
        if point == 1:
            arm = float(touch.arm2)
            lever = float(touch.lever2)
            distance = float(touch.distance2)

        if distance < law.margin:
            d = impedance(distance, law)
            velocity = normal_velocity + lever * second_velocity.yaw - arm * first_velocity.yaw
            row = Row(
                arm=arm,
                lever=lever,
                offset=offset(d, distance, velocity, law, timestep),
                softness=regularisation(d, inverse_weight),
            )
            if n_rows == 0:
                first = row
            else:
                second = row
            n_rows += 1
    return Rows(
        n_rows=n_rows,
        normal_x=touch.normal_x,
        normal_y=touch.normal_y,
        arm1=first.arm,
        arm2=second.arm,
        lever1=first.lever,
        lever2=second.lever,
        offset1=first.offset,
        offset2=second.offset,
        softness1=first.softness,
        softness2=second.softness,
    )


@shared
def separation_rate(normal_x: float, normal_y: float, first: Velocity, second: Velocity) -> float:
    """Return n (v2 - v1), at which the centres of two bodies separate along a normal."""
    return normal_x * (second.x - first.x) + normal_y * (second.y - first.y)


_DIAGONAL = math.sqrt(0.5)
_EDGE_RATIO = math.sqrt(2.0) - 1.0
"""Half the edge of a regular octagon by the radius of its incircle."""
CREEP = 1e-4
"""Share of its free velocity with which a body creeps that MuJoCo's friction of a joint holds.

It is (1 - d) / d of the largest impedance d. In the plane four such rows share the load, which
halves it."""


@shared
def nearest_in_octagon(x: float, y: float, inradius: float) -> tuple[float, float]:
    """Return the point of a regular octagon around the origin that is nearest to (x, y).

    The octagon has sides across both axes and both diagonals, at the distance `inradius`.
    """
    a = abs(x)
    b = abs(y)
    half_edge = _EDGE_RATIO * inradius
    diagonal = _DIAGONAL * (a + b)
    if max(a, b) <= diagonal and diagonal > inradius:
        # Beyond the oblique side.
        aside = min(max(_DIAGONAL * (b - a), -half_edge), half_edge)
        a = _DIAGONAL * (inradius - aside)
        b = _DIAGONAL * (inradius + aside)
    elif a > inradius and a > diagonal:
        # Beyond the side across x.
        a = inradius
        b = min(b, half_edge)
    elif b > inradius and b > diagonal:
        # Beyond the side across y.
        a = min(a, half_edge)
        b = inradius
    if x < 0.0:
        a = -a
    if y < 0.0:
        b = -b
    return a, b


@shared
def floor_friction(kind: Kind, velocity: Velocity, friction: Friction) -> Friction:
    """Return the impulses of the floor's friction that stop a body, as far as friction can.

    Those in the plane lie in a regular octagon (see `engines.arena`): if more would be needed,
    they are the octagon's nearest point.

    Args:
        kind: the body's kind.
        velocity: velocity of the body, with the impulses so far.
        friction: the impulses so far.
    """
    yields = 1.0 + 0.5 * CREEP
    needed_x = (friction.x - velocity.x / kind.inverse_mass) / yields
    needed_y = (friction.y - velocity.y / kind.inverse_mass) / yields
    needed_yaw = (friction.yaw - velocity.yaw / kind.inverse_inertia) / (1.0 + CREEP)
    x, y = nearest_in_octagon(needed_x, needed_y, float(kind.friction_impulse))
    largest_yaw = kind.friction_angular_impulse
    return Friction(x, y, min(max(needed_yaw, -largest_yaw), largest_yaw))


@shared
def matrix(
    rows: Rows,
    mass1: float,
    inertia1: float,
    mass2: float,
    inertia2: float,
) -> tuple[float, float, float]:
    """Return the first, the mixed and the last element of H [1/mg].

    Args:
        rows: the contact's rows.
        mass1: inverse mass of the first body, 0 if it does not move [1/mg].
        inertia1: inverse inertia of the first body, 0 if it does not move [1/(mg mm^2)].
        mass2: inverse mass of the second body.
        inertia2: inverse inertia of the second body.
    """
    arm1 = rows.arm1
    arm2 = rows.arm2
    lever1 = rows.lever1
    lever2 = rows.lever2
    return (
        mass1 + mass2 + inertia1 * arm1 * arm1 + inertia2 * lever1 * lever1 + rows.softness1,
        mass1 + mass2 + inertia1 * arm1 * arm2 + inertia2 * lever1 * lever2,
        mass1 + mass2 + inertia1 * arm2 * arm2 + inertia2 * lever2 * lever2 + rows.softness2,
    )


@shared
def relaxed(
    rows: Rows,
    h11: float,
    h12: float,
    h22: float,
    p1: float,
    p2: float,
    first_velocity: Velocity,
    second_velocity: Velocity,
) -> tuple[float, float]:
    """Return the impulses of a contact that solve its own rows while all others stay [mg mm/s].

    Args:
        rows: the contact's rows.
        h11: first element of H, see `matrix`.
        h12: mixed element of H.
        h22: last element of H.
        p1: impulse of the first row so far.
        p2: impulse of the second row so far.
        first_velocity: velocity of the first body with the impulses so far.
        second_velocity: velocity of the second body with the impulses so far.
    """
    along = separation_rate(rows.normal_x, rows.normal_y, first_velocity, second_velocity)
    yaw1 = first_velocity.yaw
    yaw2 = second_velocity.yaw
    w1 = along + rows.lever1 * yaw2 - rows.arm1 * yaw1 + rows.offset1 + rows.softness1 * p1
    w2 = along + rows.lever2 * yaw2 - rows.arm2 * yaw1 + rows.offset2 + rows.softness2 * p2
    return two_impulses(p1, p2, w1, w2, h11, h12, h22, rows.n_rows == 2)
