"""Contacts of upright boxes of one height with each other and with vertical walls, for MJX-JAX.

MJX's own functions differ from MuJoCo's in C: for two boxes they measure some depths along the
normal of the wrong box, up to a fifth too deep, and against a plane they keep only corners that
are within 1e-3 of the deepest. The functions of this module find the same points and depths as
MuJoCo's, in two dimensions, which is faster too.

They hold only where boxes stand upright at one height. So `planar_contacts` puts them into MJX's
table while JAX traces a program of the arena, which keeps them, and restores the table afterwards.
Boxes one above the other never touch: absent robots wait below those on the floor.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Float

from iswarm_mj.engines import contact_geometry
from iswarm_mj.engines.mjx.api import collision_driver, mjx, replaced
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.scalar_backends import in_arrays

_PLANE = mjx.GeomType.PLANE
_BOX = mjx.GeomType.BOX

_POINTS_PER_PAIR = 4
"""Contact points of a pair: two, each at the lower and the upper rim."""

_geometry = in_arrays(contact_geometry, jnp)
"""Functions of `contact_geometry` for arrays of JAX."""


class Geom(NamedTuple):
    """Pose and size of a geom, or of P geoms."""

    centre: Float[Array, "*P 3"]
    """[mm]"""
    rotation: Float[Array, "*P 3 3"]
    """Rotation matrix; its columns are the geom's axes, of which a plane's normal is the last."""
    half_edges: Float[Array, "*P 3"]
    """[mm]; undefined for a plane."""


def planar_contacts() -> AbstractContextManager[None]:
    """Let MJX-JAX use the functions of this module in what is traced inside the block."""
    functions = {
        (_BOX, _BOX): _contact_function(box_box),
        (_PLANE, _BOX): _contact_function(plane_box),
    }
    return replaced(collision_driver._COLLISION_FUNC, functions)


def box_box(first: Geom, second: Geom) -> tuple[Array, Array, Array]:
    """Return the contact points of two boxes, the same at the lower and the upper rim.

    Returns:
        Distances (4,), negative where boxes overlap and `APART` at points that do not exist [mm];
        points (4, 3) [mm]; normal (3,) from first to second.
    """
    offset = second.centre - first.centre
    first_hull = _hull(first, 0.0, 0.0)
    second_hull = _hull(second, offset[0], offset[1])

    # After the normal come x, y and distance of both points (`ContactPoints`).
    normal_x, normal_y, *points = _geometry.rectangle_contact(first_hull, second_hull)
    is_level = jnp.abs(offset[2]) < first.half_edges[2] + second.half_edges[2]
    between_corners = points[-1] == contact_geometry.APART
    distances, positions = _at_both_rims(points, first, may_touch=is_level & ~between_corners)
    return distances, positions, jnp.array([normal_x, normal_y, 0.0])


def plane_box(plane: Geom, box: Geom) -> tuple[Array, Array, Array]:
    """Return the contact points of a vertical wall and a box.

    They are the two corners nearest to the wall, at the lower and the upper rim. Walls are endless
    upwards and downwards, so that the height of the box does not matter.

    Returns:
        Distances (4,) [mm]; points (4, 3) [mm]; normal (3,) from plane to box.
    """
    normal = plane.rotation[:2, 2]
    gap = (box.centre[:2] - plane.centre[:2]) @ normal
    _, _, *points = _geometry.wall_contact(gap, *normal, _hull(box, 0.0, 0.0))
    distances, positions = _at_both_rims(points, box)
    return distances, positions, jnp.append(normal, 0.0)


def nearest_points(first: Float[Array, "*P 6"], second: Float[Array, "*P 6"]) -> Float[Array, "*P"]:
    """Return the lesser distance of the surfaces at the contact points of each pair of boxes [mm].

    Args:
        first: boxes, see `geometry.obstacles.numbers` [mm].
        second: boxes.
    """
    hulls = [contact_geometry.Rectangle(*jnp.moveaxis(boxes, -1, 0)) for boxes in (first, second)]
    points = _geometry.rectangle_contact(*hulls)
    nearest = jnp.minimum(points.distance1, points.distance2)
    return jnp.where(points.distance2 == contact_geometry.APART, contact_geometry.APART, nearest)


def _hull(box: Geom, x: Any, y: Any) -> contact_geometry.Rectangle:
    """Return an upright box, seen from above, with its centre at (x, y)."""
    return contact_geometry.Rectangle(x, y, *box.rotation[:2, 0], *box.half_edges[:2])


def _at_both_rims(
    points: Sequence[Array],
    box: Geom,
    *,
    may_touch: Array | bool = True,
) -> tuple[Array, Array]:
    """Return distances (4,) and positions (4, 3) of two points, at the rims of a box [mm].

    Args:
        points: x, y, seen from the box's centre, and distance of one point; then of the other.
        box: the points are on it.
        may_touch: otherwise the points are out of reach.
    """
    x1, y1, distance1, x2, y2, distance2 = points
    distance = jnp.stack([distance1, distance2])
    xy = box.centre[:2] + jnp.array([[x1, y1], [x2, y2]])
    lower_and_upper = jnp.repeat(jnp.array([-1.0, 1.0]), 2)  # the rims of both points in turn
    height = box.centre[2] + lower_and_upper * box.half_edges[2]
    distance = jnp.where(may_touch, distance, contact_geometry.APART)
    return jnp.tile(distance, 2), jnp.column_stack([jnp.tile(xy, (2, 1)), height])


def _contact_function(contact: Callable[[Geom, Geom], tuple[Array, Array, Array]]) -> Any:
    """Return a contact function for MJX's table.

    It takes model, data, key and pairs of geoms, and returns distances, points and frames. Its
    attribute `ncon` is the number of contact points of a pair.
    """

    def collide(
        model: mjx.Model,
        data: mjx.Data,
        _: Any,
        pairs: Array,
    ) -> tuple[Array, Array, Array]:
        def geoms(index: Array) -> Geom:
            return Geom(data.geom_xpos[index], data.geom_xmat[index], model.geom_size[index])

        distance, point, normal = jax.vmap(contact)(geoms(pairs[:, 0]), geoms(pairs[:, 1]))
        left = jnp.stack([-normal[:, 1], normal[:, 0], jnp.zeros(len(normal))], axis=-1)
        up = jnp.broadcast_to(jnp.array([0.0, 0.0, 1.0]), normal.shape)
        frame = jnp.repeat(jnp.stack([normal, left, up], axis=1), _POINTS_PER_PAIR, axis=0)
        return distance.ravel(), point.reshape(-1, 3), frame

    collide.ncon = _POINTS_PER_PAIR  # pyright: ignore[reportFunctionMemberAccess]
    return collide
