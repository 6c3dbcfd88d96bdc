"""Who hears whom: the nearest sender in sight of each photodiode sector.

"Communication was restricted to the nearest neighbor" on each photodiode (section 4.3 of the paper). Light goes
in straight lines, so a robot between two others cuts their link: rays of the physics engine decide, cast from
the receiving side to the sending LED, for the nearest candidates first.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial import KDTree

from iswarm_mj.config import OpticsConfig
from iswarm_mj.sensors.optics import N_SIDES, Reception, receive, side_centre
from iswarm_mj.units import mm_from_rd

LedHit = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""(world, origin, target, receiver, sender) of P rays -> (P,) bool: does the ray reach the sender first?"""


class Links(NamedTuple):
    """What each of the S = 4 sides of N robots receives in B worlds."""

    sender: np.ndarray
    """(B, N, S) int32; meaningless where not `valid`."""
    valid: np.ndarray
    """(B, N, S) bool."""
    led: np.ndarray
    """(B, N, S) int32, the sender's LED."""
    bearing: np.ndarray
    """(B, N, S) float32, in the receiver's frame [rad]."""
    distance: np.ndarray
    """(B, N, S) float32, true distance between the centres [mm]."""


class Candidates(NamedTuple):
    """Pairs (P,) whose light would arrive if nothing stood between, nearest first for each side."""

    world: np.ndarray
    receiver: np.ndarray
    sender: np.ndarray
    distance: np.ndarray
    reception: Reception


def find_candidates(poses: np.ndarray, optics: OpticsConfig) -> Candidates:
    """Pairs of robots within reach of each other's light, sorted by world, receiver, side and distance.

    Args:
        poses: (B, N, 3) x, y [mm] and yaw [rad].
        optics: range, cones and mode.
    """
    radius = mm_from_rd(optics.communication_radius)
    pairs = [
        np.column_stack([np.full(len(found), world), found])
        for world, xy in enumerate(poses[:, :, :2])
        if len(found := KDTree(xy, balanced_tree=False, compact_nodes=False).query_pairs(radius, output_type="ndarray"))
    ]
    both = np.concatenate(pairs) if pairs else np.zeros((0, 3), dtype=np.int64)
    world = np.concatenate([both[:, 0], both[:, 0]])
    receiver = np.concatenate([both[:, 1], both[:, 2]])
    sender = np.concatenate([both[:, 2], both[:, 1]])
    at, of = poses[world, receiver], poses[world, sender]
    dx, dy = of[:, 0] - at[:, 0], of[:, 1] - at[:, 1]
    reception = receive(dx, dy, at[:, 2], of[:, 2], optics)
    arrives = np.flatnonzero(np.isfinite(reception.effective_distance))
    slot = (world * poses.shape[1] + receiver) * N_SIDES + reception.side
    order = arrives[np.lexsort((reception.effective_distance[arrives], slot[arrives]))]
    return Candidates(
        world[order],
        receiver[order],
        sender[order],
        np.hypot(dx, dy)[order],
        Reception(*(np.asarray(values)[order] for values in reception)),
    )


def find_links(poses: np.ndarray, optics: OpticsConfig, reaches: LedHit) -> Links:
    """Links of all robots: for each side the nearest sender in sight.

    Args:
        poses: (B, N, 3) x, y [mm] and yaw [rad].
        optics: range, cones and mode.
        reaches: casts rays; not called if `optics.line_of_sight` is off.
    """
    n_worlds, n_robots = poses.shape[:2]
    found = find_candidates(poses, optics)
    slot = (found.world * n_robots + found.receiver) * N_SIDES + found.reception.side
    chosen = np.zeros(len(slot), dtype=bool)
    trial = np.flatnonzero(np.diff(slot, prepend=-1))
    while len(trial):
        clear = _in_sight(poses, found, trial, reaches) if optics.line_of_sight else np.ones(len(trial), bool)
        chosen[trial[clear]] = True
        after = trial[~clear] + 1
        after = after[after < len(slot)]
        trial = after[slot[after] == slot[after - 1]]
    picks = np.flatnonzero(chosen)
    shape = (n_worlds, n_robots, N_SIDES)

    def scatter(values: np.ndarray, dtype: type) -> np.ndarray:
        out = np.zeros(n_worlds * n_robots * N_SIDES, dtype)
        out[slot[picks]] = values[picks]
        return out.reshape(shape)

    return Links(
        sender=scatter(found.sender, np.int32),
        valid=scatter(chosen, np.bool_),
        led=scatter(found.reception.led, np.int32),
        bearing=scatter(found.reception.bearing, np.float32),
        distance=scatter(found.distance, np.float32),
    )


def _in_sight(poses: np.ndarray, found: Candidates, trial: np.ndarray, reaches: LedHit) -> np.ndarray:
    """Cast the rays of the candidates `trial` (P,) from the receiving side to the sending LED."""
    world, receiver, sender = found.world[trial], found.receiver[trial], found.sender[trial]
    origin = np.column_stack(side_centre(*poses[world, receiver].T, found.reception.side[trial]))
    target = np.column_stack(side_centre(*poses[world, sender].T, found.reception.led[trial]))
    return reaches(world, origin, target, receiver, sender)
