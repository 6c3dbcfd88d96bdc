"""Rules of light for one side of a robot: which sender it hears, and whether it sees a wall.

Each side hears the senders of least effective distance that no third robot, obstacle or box
hides; of equal ones that of lowest index comes first. Links do not end at walls: the arena is
convex, and what little of a robot is pressed into a wall stays visible. A wall, an obstacle or a
box is in sight where it is the first thing on the axis of an LED; a robot that is pressed
slightly into it sees it too.

Rays are seen from the receiver's centre where they meet robots, and from the arena's centre where
they meet what stands still: in 32-bit floats short distances between robots keep their digits.
Both numba and Warp compile the functions here (`kinds.shared`, with the rules of Warp). Units: mm.
"""

import math
from typing import NamedTuple

from iswarm_mj.engines.contact_geometry import Rectangle
from iswarm_mj.engines.planar.contact_rows import gap_to_wall
from iswarm_mj.engines.planar.kinds import (
    Codes,
    Kinds,
    Place,
    Places,
    Table,
    obstacle_of,
    place_of,
    shared,
    wall_of,
)
from iswarm_mj.engines.planar.plane import Kind, Plane
from iswarm_mj.engines.planar.ray_geometry import Ray, is_crossed, meets_rectangle, meets_wall_at
from iswarm_mj.engines.planar.reception import (
    Light,
    Point,
    led_axis,
    led_position,
    photodiode_bearing,
    receive,
    receiver_position,
)

_SPARE = 1e-6  # of the radius within which robots are looked for, for rounding


class Scene(NamedTuple):
    """Optics and surroundings of a world: all that its light depends on, besides the robots."""

    light: Light
    """Optics."""
    points: Table
    """(K 5 S, 2) points and axes of the robots, see `reception.points_of`."""
    plane: Plane
    """Arena."""
    solids: Table
    """(W + M, 6) walls, obstacles and boxes, see `plane.solids_with`."""


class View(NamedTuple):
    """A receiver and the robots near it."""

    places: Places
    """(N, 4) places of all robots."""
    kinds: Kinds
    """(N,) kinds of all robots."""
    near: Codes
    """(K, M) link codes of the robots near a receiver, a column for each receiver.

    First come the robots whose light arrives. Of the others only the index is defined.
    """
    effective: Table
    """(K, M) effective distance of the light that arrives."""
    receiver: int
    """Index of the receiver."""
    column: int
    """Column of the receiver in `near` and `effective`."""
    n_lit: int
    """Number of robots whose light arrives."""
    n_near: int
    """Number of robots near the receiver."""


@shared
def link_code(sender: int, side: int, led: int) -> int:
    """Return the index of a sender, the receiver's side and the sender's LED in one number.

    One number a robot is what a GPU reads and sorts; robots have at most eight sides.
    """
    return 64 * sender + 8 * side + led


@shared
def sender_of(code: int) -> int:
    """Return the index of the robot in a link code."""
    return code >> 6


@shared
def side_of(code: int) -> int:
    """Return the receiver's side, which faces the sender, in a link code."""
    return (code >> 3) & 7


@shared
def led_of(code: int) -> int:
    """Return the sender's LED, which faces the receiver, in a link code."""
    return code & 7


@shared
def search_radius(light: Light, plane: Plane) -> float:
    """Return a radius around a receiver in which all robots are that send it light or hide it."""
    sends_or_hides = light.farthest + plane.largest_radius + light.optical_offset
    hides_wall = light.wall_reach + 2.0 * plane.largest_radius
    return (1.0 + _SPARE) * max(sends_or_hides, hides_wall)


@shared
def add_near(
    view: View,
    n_lit: int,
    n_near: int,
    robot: int,
    squared_distance: float,
    power: float,
    light: Light,
    points: Table,
) -> int:
    """Add a robot to those near a receiver: among the first if its light arrives, otherwise last.

    Args:
        view: the receiver, with room for another robot.
        n_lit: value of `View.n_lit` so far.
        n_near: value of `View.n_near` so far.
        robot: index of a robot within `search_radius`.
        squared_distance: square of the distance of both centres.
        power: power of the robot's LEDs, from 0 to 1.
        light: optics.
        points: see `Scene.points`.

    Returns:
        Number of robots whose light arrives, with this one.
    """
    view.near[n_near, view.column] = link_code(robot, 0, 0)
    if power > 0.0 and squared_distance <= light.farthest * light.farthest:
        reception = receive(
            place_of(view.places, view.receiver),
            place_of(view.places, robot),
            view.kinds[view.receiver].first_point,
            view.kinds[robot].first_point,
            power,
            light,
            points,
        )
        if reception.effective < math.inf:
            # The first robot without light makes room.
            view.near[n_near, view.column] = view.near[n_lit, view.column]
            view.near[n_lit, view.column] = link_code(robot, reception.side, reception.led)
            view.effective[n_lit, view.column] = reception.effective
            return n_lit + 1
    return n_lit


@shared
def next_in_sight(
    view: View,
    side: int,
    last_effective: float,
    last_code: int,
    scene: Scene,
) -> tuple[float, int]:
    """Return the nearest sender in sight of a side that comes after another one.

    Senders are ordered by effective distance, then by index.

    Args:
        view: the receiver.
        side: side of the receiver.
        last_effective: effective distance of the other sender; negative for the first search.
        last_code: link code of the other sender.
        scene: optics and arena.

    Returns:
        Effective distance and link code; a code of -1 if there is none.
    """
    effective = float(last_effective)
    code = int(last_code)
    searches = bool(True)
    while searches:
        effective, code = next_sender(view, side, effective, code)
        searches = code >= 0 and scene.light.needs_sight
        if searches:
            searches = not is_clear(view, side, code, scene)
    return effective, code


@shared
def next_sender(view: View, side: int, last_effective: float, last_code: int) -> tuple[float, int]:
    """Return what `next_in_sight` does, whether the sender is in sight or not."""
    best_effective = float(math.inf)
    best_code = int(-1)
    for k in range(view.n_lit):
        code = view.near[k, view.column]
        effective = view.effective[k, view.column]
        is_later = effective > last_effective or (effective == last_effective and code > last_code)
        is_nearer = effective < best_effective or (effective == best_effective and code < best_code)
        if side_of(code) == side and is_later and is_nearer:
            best_effective = float(effective)
            best_code = int(code)
    return best_effective, best_code


@shared
def is_clear(view: View, side: int, code: int, scene: Scene) -> bool:
    """Return whether no third robot, obstacle or box blocks the light that a side receives.

    Args:
        view: the receiver and the robots near it.
        side: side of the receiver.
        code: link code of the sender and its LED, see `link_code`.
        scene: optics and arena.
    """
    sender = sender_of(code)
    ray = link_ray(view, side, code, scene)
    if is_hidden_by_robots(view, sender, ray, scene.plane):
        return False

    receiver = place_of(view.places, view.receiver)
    world_ray = in_arena_frame(ray, receiver)

    # Obstacles and boxes are the rows after the walls, which hide nothing.
    clear = bool(True)
    for row in range(scene.plane.n_walls, scene.solids.shape[0]):
        clear = clear and not is_crossed(world_ray, obstacle_of(scene.solids, row))
    return clear


@shared
def link_ray(view: View, side: int, code: int, scene: Scene) -> Ray:
    """Return the path from a side's photodiodes to an LED, seen from the receiver's centre."""
    receiver = place_of(view.places, view.receiver)
    sender = place_of(view.places, sender_of(code))
    receiver_points = view.kinds[view.receiver].first_point
    sender_points = view.kinds[sender_of(code)].first_point
    n_sides = scene.light.n_sides
    x, y = turned(receiver, receiver_position(scene.points, receiver_points, side, n_sides))
    led_x, led_y = turned(sender, led_position(scene.points, sender_points, led_of(code)))
    return Ray(
        x=x,
        y=y,
        vector_x=(sender.x - receiver.x) + led_x - x,
        vector_y=(sender.y - receiver.y) + led_y - y,
    )


@shared
def is_hidden_by_robots(view: View, sender: int, ray: Ray, plane: Plane) -> bool:
    """Return whether a third robot crosses a ray, which is seen from the receiver's centre."""
    receiver = place_of(view.places, view.receiver)
    squared_length = ray.vector_x * ray.vector_x + ray.vector_y * ray.vector_y
    spare = plane.largest_radius * math.sqrt(squared_length)
    is_hidden = bool(False)
    k = int(0)
    while k < view.n_near and not is_hidden:
        robot = sender_of(view.near[k, view.column])
        third = place_of(view.places, robot)

        # The place of the ray's origin beside and behind the third robot, times the ray's length.
        x = ray.x - (third.x - receiver.x)
        y = ray.y - (third.y - receiver.y)
        across = x * ray.vector_y - y * ray.vector_x
        behind = x * ray.vector_x + y * ray.vector_y
        is_in_the_way = max(abs(across), max(behind, -squared_length - behind)) <= spare
        if is_in_the_way:
            is_third = robot != sender
            hull = hull_from(receiver, third, view.kinds[robot])
            is_hidden = is_third and is_crossed(ray, hull)
        k += 1
    return is_hidden


@shared
def link_to(view: View, code: int, light: Light, points: Table) -> tuple[float, float]:
    """Return the measured direction of a sender [rad], and the distance of both centres."""
    receiver = place_of(view.places, view.receiver)
    sender = place_of(view.places, sender_of(code))
    dx = sender.x - receiver.x
    dy = sender.y - receiver.y
    bearing = float(photodiode_bearing(points, side_of(code), light.n_sides))
    if light.is_power:
        reception = receive(
            receiver,
            sender,
            view.kinds[view.receiver].first_point,
            view.kinds[sender_of(code)].first_point,
            1.0,
            light,
            points,
        )
        bearing += reception.turn
    return bearing, math.sqrt(dx * dx + dy * dy)


@shared
def sees_wall(view: View, side: int, scene: Scene) -> bool:
    """Return whether a wall, obstacle or box is the first thing on the axis of a side's LED."""
    receiver = place_of(view.places, view.receiver)
    if not is_near_solid(receiver, scene):
        return False
    ray = led_ray(view, side, scene)
    share = first_solid(in_arena_frame(ray, receiver), scene)
    sees = share <= 1.0
    if share > 0.0 and share <= 1.0:
        for k in range(view.n_near):
            robot = sender_of(view.near[k, view.column])
            hull = hull_from(receiver, place_of(view.places, robot), view.kinds[robot])
            sees = sees and meets_rectangle(ray, hull) >= share
    return sees


@shared
def is_near_solid(receiver: Place, scene: Scene) -> bool:
    """Return whether a wall, obstacle or box may be within reach of any LED of a robot."""
    within = scene.light.wall_reach + scene.plane.largest_radius
    is_near = bool(False)
    for row in range(scene.plane.n_walls):
        gap = gap_to_wall(wall_of(scene.solids, row), receiver.x, receiver.y)
        is_near = is_near or gap <= within
    for row in range(scene.plane.n_walls, scene.solids.shape[0]):
        beyond_x, beyond_y = beyond_sides(receiver.x, receiver.y, obstacle_of(scene.solids, row))
        gap_x = max(beyond_x, 0.0)
        gap_y = max(beyond_y, 0.0)
        is_near = is_near or gap_x * gap_x + gap_y * gap_y < within * within
    return is_near


@shared
def led_ray(view: View, side: int, scene: Scene) -> Ray:
    """Return the path along an LED's axis to where walls no longer reflect it.

    It is seen from the receiver's centre.
    """
    receiver = place_of(view.places, view.receiver)
    first_point = view.kinds[view.receiver].first_point
    reach = scene.light.wall_reach
    x, y = turned(receiver, led_position(scene.points, first_point, side))
    axis_x, axis_y = turned(receiver, led_axis(scene.points, side, scene.light.n_sides))
    return Ray(x=x, y=y, vector_x=reach * axis_x, vector_y=reach * axis_y)


@shared
def first_solid(ray: Ray, scene: Scene) -> float:
    """Return the share of a ray's vector at which the ray meets a wall, obstacle or box.

    The share is 0 for a ray that begins in one of them, and infinite if the ray meets none.
    """
    share = float(math.inf)
    for row in range(scene.plane.n_walls):
        share = min(share, meets_wall_at(ray, wall_of(scene.solids, row)))
    for row in range(scene.plane.n_walls, scene.solids.shape[0]):
        obstacle = obstacle_of(scene.solids, row)
        beyond_x, beyond_y = beyond_sides(ray.x, ray.y, obstacle)
        if beyond_x <= 0.0 and beyond_y <= 0.0:
            share = 0.0
        share = min(share, meets_rectangle(ray, obstacle))
    return share


@shared
def beyond_sides(x: float, y: float, rectangle: Rectangle) -> tuple[float, float]:
    """Return how far a point is beyond a rectangle's sides along both its axes, negative within."""
    dx = x - rectangle.x
    dy = y - rectangle.y
    ahead = rectangle.cos * dx + rectangle.sin * dy
    left = rectangle.cos * dy - rectangle.sin * dx
    return abs(ahead) - rectangle.half_x, abs(left) - rectangle.half_y


@shared
def hull_from(receiver: Place, place: Place, kind: Kind) -> Rectangle:
    """Return the hull of a robot, seen from a receiver's centre."""
    return Rectangle(
        x=place.x - receiver.x,
        y=place.y - receiver.y,
        cos=place.cos,
        sin=place.sin,
        half_x=kind.half_x,
        half_y=kind.half_y,
    )


@shared
def in_arena_frame(ray: Ray, receiver: Place) -> Ray:
    """Return a ray seen from the arena's centre, given the same ray seen from a receiver's."""
    return Ray(
        x=receiver.x + ray.x,
        y=receiver.y + ray.y,
        vector_x=ray.vector_x,
        vector_y=ray.vector_y,
    )


@shared
def turned(place: Place, point: Point) -> tuple[float, float]:
    """Return the world components of a vector in the frame of a robot."""
    x = place.cos * point.ahead - place.sin * point.left
    y = place.sin * point.ahead + place.cos * point.left
    return x, y
