"""Physics steps of worlds: contacts, impulses, Euler integration."""

import math
from typing import Any

import numpy as np

from iswarm_mj.engines.base import FreeBodies
from iswarm_mj.engines.planar.compiled import cached, compiled, uncounted
from iswarm_mj.engines.planar.contacts import CONTACT, find_contacts
from iswarm_mj.engines.planar.near_pairs import near_pairs, set_places
from iswarm_mj.engines.planar.plane import Plane
from iswarm_mj.engines.planar.solver import begin_as, rub, solve
from iswarm_mj.utils.errors import FaultKind

SKIN = 1.5
"""Near pairs are those whose circumcircles are closer than this; they are found anew where others may have become so
[mm]."""

_FAILED = int(FaultKind.SOLVER_FAILED)


@cached
def take_steps(
    worlds: np.ndarray,
    n_substeps: int,
    bodies: Any,
    targets: np.ndarray,
    touching: np.ndarray,
    failure: np.ndarray,
    solids: np.ndarray,
    kinds: np.ndarray,
    plane: Plane,
) -> None:
    """Take physics steps of some of B worlds in place.

    Args:
        worlds: indices of these worlds.
        n_substeps: number of physics steps.
        bodies: `FreeBodies` (B, N + M, ...) of N robots and M boxes, changed.
        targets: (B, N + M, 3) set points of the servos [mm/s, mm/s, rad/s].
        touching: (B, K, N) see `Motion.touching`; the pairs in contact in the last step are added.
        failure: (B,) output, bits of `FaultKind`; where the contact solver fails, that ends the steps of the world.
        solids: (W + O, 6) walls and obstacles, see `plane.solids_of`.
        kinds: (N + M + 1,) see `plane.table_of`.
        plane: the arena.
    """
    for world in worlds:
        failure[world] = _take_steps(
            n_substeps,
            FreeBodies(
                bodies.poses[world],
                bodies.velocity[world],
                bodies.is_present[world],
                bodies.overlap[world : world + 1],
                None,
            ),
            targets[world],
            touching[world],
            solids,
            kinds,
            plane,
        )


@compiled
def _take_steps(
    n_substeps: int,
    bodies: Any,
    targets: np.ndarray,
    touching: np.ndarray,
    solids: np.ndarray,
    kinds: np.ndarray,
    plane: Plane,
) -> int:
    """As `take_steps`, of one world, without an axis of worlds; return bits of `FaultKind`."""
    n_bodies, n_robots = len(bodies.poses), touching.shape[1]
    velocities = np.zeros((n_bodies + 1, 3))  # the last row is that of the walls
    _copy(bodies.velocity, velocities)
    rubs, places = np.zeros((n_bodies, 3)), np.empty((n_bodies, 4))
    set_places(bodies.poses, places)
    pairs, contacts, solved = np.empty((0, 2), np.int64), np.empty(0, CONTACT), np.empty(0, CONTACT)
    moved = np.inf
    for _ in range(n_substeps):
        if 2.0 * moved > SKIN:
            pairs, moved = near_pairs(places[:n_robots], bodies.is_present, 2.0 * plane.radius + SKIN, plane.edge), 0.0
            contacts = np.empty(len(pairs) + (len(solids) + n_bodies - n_robots) * n_bodies, CONTACT)
        n_contacts = find_contacts(
            pairs, n_robots, places, velocities, bodies.is_present, kinds, plane, solids, contacts
        )
        found = contacts[:n_contacts]
        for contact in found:
            bodies.overlap[0] = max(bodies.overlap[0], contact.depth)
        for i in range(n_bodies):
            kind = kinds[i]
            velocities[i, 0] += kind.drive_x * (targets[i, 0] - velocities[i, 0])
            velocities[i, 1] += kind.drive_y * (targets[i, 1] - velocities[i, 1])
            velocities[i, 2] += kind.drive_yaw * (targets[i, 2] - velocities[i, 2])
        rubs[:] = 0.0
        for box in range(n_robots, n_bodies):
            rub(box, velocities, rubs, kinds)
        begin_as(solved, found, velocities, rubs, kinds)
        if not solve(found, velocities, rubs, kinds, plane):
            return _FAILED
        solved = found.copy()
        moved += _integrate(bodies, places, velocities, plane.timestep)
    _copy(velocities, bodies.velocity)
    for contact in solved:
        if contact.first < n_robots:
            _add(touching, contact.first, contact.second)
    return 0


@uncounted
def _copy(source: np.ndarray, target: np.ndarray) -> None:
    """Copy rows as far as both have them. An assignment of slices would compile NumPy's message of shapes, too."""
    for i in range(min(len(source), len(target))):
        for k in range(source.shape[1]):
            target[i, k] = source[i, k]


@uncounted
def _add(touching: np.ndarray, robot: int, partner: int) -> None:
    """Add a partner to those of a robot in (K, N), unless it is there: the lesser of two moves on."""
    for k in range(len(touching)):
        found = touching[k, robot]
        touching[k, robot] = max(found, partner)
        partner = 0 if found == partner else min(found, partner)
        if partner == 0:
            break


@uncounted
def _integrate(bodies: Any, places: np.ndarray, velocities: np.ndarray, timestep: float) -> float:
    """Move the robots of a world with their new velocities; return how far the fastest one went [mm]."""
    poses, farthest = bodies.poses, 0.0
    for i in range(len(poses)):
        if bodies.is_present[i]:
            dx, dy, turn = timestep * velocities[i, 0], timestep * velocities[i, 1], timestep * velocities[i, 2]
            poses[i, 0] += dx
            poses[i, 1] += dy
            places[i, 0], places[i, 1] = poses[i, 0], poses[i, 1]
            if turn != 0.0:
                poses[i, 2] += turn
                places[i, 2], places[i, 3] = math.cos(poses[i, 2]), math.sin(poses[i, 2])
            farthest = max(farthest, dx * dx + dy * dy)
    return math.sqrt(farthest)
