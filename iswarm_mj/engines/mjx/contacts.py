"""Contacts of upright boxes of one height with each other and with vertical walls, for MJX's JAX implementation.

MJX's own functions differ from MuJoCo's in C: for two boxes they measure some depths along the normal of the wrong
box, up to a fifth too deep, and against a plane they keep corners only that are within 1e-3 of the deepest. These
here find the same points and depths as MuJoCo's, in two dimensions, which is faster too. They hold where boxes
stand upright at one height, so they are put in place while a program of the arena is traced, and not longer. Boxes at
heights so different that one is above the other, as robots are that a world does not have, do not touch.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from typing import Any

import jax
import jax.numpy as jnp

from iswarm_mj.engines import contact_geometry
from iswarm_mj.engines.mjx.api import collision_driver, mjx, replaced
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.scalar_backends import in_arrays

Box = tuple[Array, Array, Array]
"""Centre, rotation and half edges of a geom."""

_PLANE, _BOX = mjx.GeomType.PLANE, mjx.GeomType.BOX
_NO_CONTACT = 1.0  # distance of a point that does not touch [mm]


def planar_contacts() -> AbstractContextManager[None]:
    """Let MJX-JAX use the functions of this module in what is traced inside the block."""
    own = {(_BOX, _BOX): _per_pair(box_box), (_PLANE, _BOX): _per_pair(plane_box)}
    return replaced(collision_driver._COLLISION_FUNC, own)


_geometry = in_arrays(contact_geometry, jnp)


def box_box(first: Box, second: Box) -> tuple[Array, Array, Array]:
    """Contact points of two boxes, at the upper and the lower rim alike.

    Args:
        first: centre (3,) [mm], rotation (3, 3) and half edges (3,) [mm].
        second: likewise.

    Returns:
        Distances (4,), negative where boxes overlap [mm]; points (4, 3) [mm]; normal (3,) from first to second.
    """
    apart, edges = second[0] - first[0], (*first[2][:2], *second[2][:2])
    headings = *first[1][:2, 0], *second[1][:2, 0]
    nx, ny, *points = _geometry.rectangle_contact(apart[0], apart[1], *headings, *edges)
    is_level = jnp.abs(apart[2]) < first[2][2] + second[2][2]
    return *_at_both_rims(points, is_level, first), jnp.array([nx, ny, 0.0])


def plane_box(plane: Box, box: Box) -> tuple[Array, Array, Array]:
    """Contact points of a vertical wall and a box: the two corners nearest to the wall, at both rims.

    Args:
        plane: point (3,) [mm], rotation (3, 3) whose last column is the normal, and anything.
        box: centre (3,) [mm], rotation (3, 3) and half edges (3,) [mm].

    Returns:
        Distances (4,) [mm]; points (4, 3) [mm]; normal (3,) from plane to box.
    """
    normal = plane[1][:2, 2]
    gap = (box[0][:2] - plane[0][:2]) @ normal
    points = _geometry.wall_contact(gap, *normal, *box[1][:2, 0], *box[2][:2])
    return *_at_both_rims(points, True, box), jnp.append(normal, 0.0)


def _at_both_rims(points: Sequence[Array], touches: Array | bool, box: Box) -> tuple[Array, Array]:
    """Distances (4,) and points (4, 3) at the lower and the upper rim of a box.

    Args:
        points: x, y, seen from the box's centre, and distance of one point, and likewise of another one.
        touches: otherwise, as where the distance is positive, they are out of reach.
        box: of which they are.
    """
    x1, y1, d1, x2, y2, d2 = points
    distance, half_height = jnp.stack([d1, d2]), box[2][2]
    each = box[0][:2] + jnp.array([[x1, y1], [x2, y2]])
    height = box[0][2] + jnp.repeat(jnp.array([-1.0, 1.0]), 2) * half_height
    reached = jnp.where(touches & (distance < 0), distance, _NO_CONTACT)
    return jnp.tile(reached, 2), jnp.column_stack([jnp.tile(each, (2, 1)), height])


def _per_pair(contact: Callable[[Box, Box], tuple[Array, Array, Array]]) -> Any:
    """Contact function as MJX's table wants it: (model, data, key, geom pairs) -> distances, points, frames.

    Its attribute is the number of contact points of a pair.
    """

    def collide(model: mjx.Model, data: mjx.Data, _: Any, geom: Array) -> tuple[Array, Array, Array]:
        def bodies(which: Array) -> Box:
            return data.geom_xpos[which], data.geom_xmat[which], model.geom_size[which]

        distance, point, normal = jax.vmap(contact)(bodies(geom[:, 0]), bodies(geom[:, 1]))
        left = jnp.stack([-normal[:, 1], normal[:, 0], jnp.zeros(len(normal))], axis=-1)
        up = jnp.broadcast_to(jnp.array([0.0, 0.0, 1.0]), normal.shape)
        frame = jnp.repeat(jnp.stack([normal, left, up], axis=1), 4, axis=0)
        return distance.ravel(), point.reshape(-1, 3), frame

    collide.ncon = 4  # pyright: ignore[reportFunctionMemberAccess]
    return collide
