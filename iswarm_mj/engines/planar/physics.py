"""Physics steps of worlds: contacts, impulses, Euler integration."""

import math
from typing import Any

import numpy as np

from iswarm_mj.engines.contact_geometry import TOUCHING
from iswarm_mj.engines.planar.compiled import cached, uncounted
from iswarm_mj.engines.planar.contacts import CONTACT, find_contacts
from iswarm_mj.engines.planar.near_pairs import near_pairs, set_places
from iswarm_mj.engines.planar.plane import Plane
from iswarm_mj.engines.planar.solver import apply_friction, solve, warm_start
from iswarm_mj.utils.errors import FaultKind

SKIN = 1.5
"""Distance beyond the margin of contacts, of two circumcircles, below which robots are a near pair
[mm].

Near pairs are searched again once others may have come within the margin."""

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
        n_substeps: number of time steps.
        bodies: `FreeBodies` (B, N + M, ...) of N robots and M boxes, changed.
        targets: (B, N + M, 3) set points of the drives [mm/s, mm/s, rad/s].
        touching: (B, K, N) see `Motion.touching`; the pairs that touch in the last step are added.
        failure: (B,) output, bits of `FaultKind`; if the contact solver fails, the world's steps
            end there.
        solids: (W + O, 6) walls and obstacles, see `plane.solids_of`.
        kinds: (N + M + 1,) see `plane.table_of`.
        plane: arena.
    """
    n_robots = touching.shape[2]
    n_bodies = bodies.poses.shape[1]
    n_boxes = n_bodies - n_robots
    velocities = np.empty((n_bodies + 1, 3))  # the last row is that of what is fixed
    friction = np.empty((n_bodies, 3))
    places = np.empty((n_bodies, 4))
    radius = 2.0 * plane.largest_radius + plane.law_of_bodies.margin + SKIN

    for world in worlds:
        poses = bodies.poses[world]
        is_present = bodies.is_present[world]
        overlap = bodies.overlap[world : world + 1]
        failure[world] = 0
        _clear(velocities)
        _copy(bodies.velocity[world], velocities)
        set_places(poses, places)

        pairs = np.empty((0, 2), np.int64)
        contacts = np.empty(0, CONTACT)
        solved = contacts  # contacts of the step before
        moved = np.inf  # distance that robots may have moved since the near pairs were searched
        for _ in range(n_substeps):
            if 2.0 * moved > SKIN:
                pairs = near_pairs(places[:n_robots], is_present, radius, plane.half_extent)
                contacts = np.empty(len(pairs) + (len(solids) + n_boxes) * n_bodies, CONTACT)
                moved = 0.0

            # Contacts at the places and velocities before the step.
            n_contacts = find_contacts(
                pairs,
                n_robots,
                places,
                velocities,
                is_present,
                kinds,
                plane,
                solids,
                contacts,
            )
            in_contact = contacts[:n_contacts]
            _note_overlap(in_contact, overlap)

            # Velocities without contacts, then the impulses of contacts and friction.
            _drive(velocities, targets[world], kinds)
            _clear(friction)
            for box in range(n_robots, n_bodies):
                apply_friction(box, velocities, friction, kinds)
            warm_start(solved, in_contact, velocities, friction, kinds)
            if not solve(in_contact, velocities, friction, kinds, plane):
                failure[world] = _FAILED
                break

            solved = in_contact.copy()
            moved += _integrate(poses, is_present, places, velocities, plane.timestep)

        if failure[world] == 0:
            _copy(velocities, bodies.velocity[world])
            _note_touching(solved, touching[world])


@uncounted
def _clear(values: np.ndarray) -> None:
    """Set all of an array (N, M) to zero.

    An assignment to all would also compile NumPy's rules of broadcasting.
    """
    for i in range(len(values)):
        for k in range(values.shape[1]):
            values[i, k] = 0.0


@uncounted
def _note_overlap(contacts: np.ndarray, overlap: np.ndarray) -> None:
    """Raise the deepest overlap (1,) to that of contacts."""
    for k in range(len(contacts)):
        overlap[0] = max(overlap[0], -contacts[k].gap)


@uncounted
def _note_touching(contacts: np.ndarray, touching: np.ndarray) -> None:
    """Add the pairs of robots that touch to (K, N)."""
    n_robots = touching.shape[1]
    for k in range(len(contacts)):
        contact: Any = contacts[k]
        is_pushing = contact.impulse1 + contact.impulse2 > 0.0
        if contact.first < n_robots and is_pushing and contact.nearest <= TOUCHING:
            _add_partner(touching, contact.first, contact.second)


@uncounted
def _copy(source: np.ndarray, target: np.ndarray) -> None:
    """Copy rows as far as both have them.

    An assignment of slices would also compile NumPy's message on shapes.
    """
    for i in range(min(len(source), len(target))):
        for k in range(source.shape[1]):
            target[i, k] = source[i, k]


@uncounted
def _drive(velocities: np.ndarray, targets: np.ndarray, kinds: np.ndarray) -> None:
    """Move the velocities of all bodies towards the set points of their drives."""
    for body in range(len(targets)):
        kind = kinds[body]
        velocities[body, 0] += kind.drive_x * (targets[body, 0] - velocities[body, 0])
        velocities[body, 1] += kind.drive_y * (targets[body, 1] - velocities[body, 1])
        velocities[body, 2] += kind.drive_yaw * (targets[body, 2] - velocities[body, 2])


@uncounted
def _add_partner(touching: np.ndarray, robot: int, partner: int) -> None:
    """Add a partner to those of a robot in (K, N), highest first, unless it is there."""
    for k in range(len(touching)):
        listed = touching[k, robot]
        touching[k, robot] = max(listed, partner)

        # The lesser of the two moves on to the next place.
        partner = 0 if listed == partner else min(listed, partner)
        if partner == 0:
            break


@uncounted
def _integrate(
    poses: np.ndarray,
    is_present: np.ndarray,
    places: np.ndarray,
    velocities: np.ndarray,
    timestep: float,
) -> float:
    """Move bodies with their new velocities; return how far the fastest one went [mm]."""
    farthest = 0.0  # squared
    for body in range(len(poses)):
        if is_present[body]:
            dx = timestep * velocities[body, 0]
            dy = timestep * velocities[body, 1]
            turn = timestep * velocities[body, 2]
            poses[body, 0] += dx
            poses[body, 1] += dy
            places[body, 0] = poses[body, 0]
            places[body, 1] = poses[body, 1]
            if turn != 0.0:
                poses[body, 2] += turn
                places[body, 2] = math.cos(poses[body, 2])
                places[body, 3] = math.sin(poses[body, 2])
            farthest = max(farthest, dx * dx + dy * dy)
    return math.sqrt(farthest)
