"""Contacts of upright boxes of one height with each other and with vertical walls, for MJX's JAX implementation.

MJX's own functions differ from MuJoCo's in C: for two boxes they measure some depths along the normal of the wrong
box, up to a fifth too deep, and against a plane they keep corners only that are within 1e-3 of the deepest. These
here find the same points and depths as MuJoCo's, in two dimensions, which is faster too. They hold where boxes
stand upright at one height, so they are put in place while a program of the arena is traced, and not longer. Boxes at
heights so different that one is above the other, as robots are that a world does not have, do not touch.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Any

import jax
import jax.numpy as jnp

from iswarm_mj.engines.mjx.api import collision_driver, mjx, replaced
from iswarm_mj.utils.arrays import Array

Box = tuple[Array, Array, Array]
"""Centre, rotation and half edges of a geom."""

_PLANE, _BOX = mjx.GeomType.PLANE, mjx.GeomType.BOX
_NO_CONTACT = 1.0  # distance of a point that does not touch [mm]


def planar_contacts() -> AbstractContextManager[None]:
    """Let MJX-JAX use the functions of this module in what is traced inside the block."""
    own = {(_BOX, _BOX): _per_pair(box_box), (_PLANE, _BOX): _per_pair(plane_box)}
    return replaced(collision_driver._COLLISION_FUNC, own)


def box_box(first: Box, second: Box) -> tuple[Array, Array, Array]:
    """Contact points of two boxes: the nearer face of one, cut by the face of the other that reaches deepest.

    The normal is that of the four side directions along which the boxes overlap least; see Gottschalk, Lin and
    Manocha (1996), separating axis theorem. The face with this normal is the reference; the other box's face that
    looks most against it is clipped to the reference's width, and both its ends are contact points where they are
    behind it, at the upper and the lower rim alike.

    Args:
        first: centre (3,) [mm], rotation (3, 3) and half edges (3,) [mm].
        second: likewise.

    Returns:
        Distances (4,), negative where boxes overlap [mm]; points (4, 3) [mm]; normal (3,) from first to second.
    """
    apart = second[0][:2] - first[0][:2]

    def overlap(one: Box, other: Box) -> tuple[Array, Array]:
        """Of the side directions of `one`, (2,) overlaps and (2, 2) normals towards the other box."""
        axes, sides = one[1][:2, :2].T, other[1][:2, :2].T
        reach = one[2][:2] + jnp.abs(axes @ sides.T) @ other[2][:2]
        offset = axes @ apart
        return reach - jnp.abs(offset), jnp.where(offset < 0, -1.0, 1.0)[:, None] * axes

    depth1, normal1 = overlap(first, second)
    depth2, normal2 = overlap(second, first)
    depth, normals = jnp.concatenate([depth1, depth2]), jnp.concatenate([normal1, normal2])
    best = jnp.argmin(depth)
    normal = normals[best]
    is_first = best < 2
    reference, incident = (
        jax.tree.map(lambda a, b: jnp.where(is_first, a, b), *boxes) for boxes in ((first, second), (second, first))
    )
    outward = jnp.where(is_first, normal, -normal)
    along = jnp.stack([-outward[1], outward[0]])
    ends = _facing_edge(incident, -outward) - reference[0][:2]
    thickness, width = jnp.where(best % 2 == 0, reference[2][:2], reference[2][1::-1])
    place, height = ends @ along, ends @ outward - thickness
    slope = (height[1] - height[0]) / jnp.where(place[1] == place[0], 1.0, place[1] - place[0])
    cut = jnp.clip(place, -width, width)
    height = height + slope * (cut - place)
    is_level = jnp.abs(second[0][2] - first[0][2]) < first[2][2] + second[2][2]
    point = reference[0][:2] + cut[:, None] * along + (thickness + height / 2)[:, None] * outward
    return _at_both_rims(jnp.where(is_level, height, _NO_CONTACT)), _rims(point, first), jnp.append(normal, 0.0)


def plane_box(plane: Box, box: Box) -> tuple[Array, Array, Array]:
    """Contact points of a vertical wall and a box: the two corners nearest to the wall, at both rims.

    Args:
        plane: point (3,) [mm], rotation (3, 3) whose last column is the normal, and anything.
        box: centre (3,) [mm], rotation (3, 3) and half edges (3,) [mm].

    Returns:
        Distances (4,) [mm]; points (4, 3) [mm]; normal (3,) from plane to box.
    """
    normal = plane[1][:2, 2]
    corners = _facing_edge(box, -normal)
    distance = (corners - plane[0][:2]) @ normal
    point = corners - distance[:, None] / 2 * normal
    return _at_both_rims(distance), _rims(point, box), jnp.append(normal, 0.0)


def _facing_edge(box: Box, direction: Array) -> Array:
    """Corners (2, 2), seen from above, of the side of a box that looks most along a direction (2,)."""
    axes = box[1][:2, :2].T
    aligned = axes @ direction
    side = jnp.argmax(jnp.abs(aligned))
    outward = jnp.where(aligned[side] < 0, -1.0, 1.0) * axes[side]
    half, width = jnp.where(side == 0, box[2][:2], box[2][1::-1])
    return box[0][:2] + half * outward + jnp.array([[-1.0], [1.0]]) * width * axes[1 - side]


def _at_both_rims(distance: Array) -> Array:
    """Distances (4,) from those of two points; what does not touch is out of reach."""
    return jnp.tile(jnp.where(distance < 0, distance, _NO_CONTACT), 2)


def _rims(point: Array, box: Box) -> Array:
    """Points (4, 3) at the lower and the upper rim, from points (2, 2) seen from above."""
    height = box[0][2] + jnp.repeat(jnp.array([-1.0, 1.0]), 2) * box[2][2]
    return jnp.column_stack([jnp.tile(point, (2, 1)), height])


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
