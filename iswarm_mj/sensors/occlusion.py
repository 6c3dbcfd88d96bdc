"""Robots in the way of light: what circles tell before a ray is cast."""

import numpy as np
from numba import njit

from iswarm_mj.sensors.optics import HALF_WIDTH

CIRCUMRADIUS = HALF_WIDTH * 2**0.5 * (1 + 1e-6)
"""Nothing of a robot is farther from its centre, so it does not touch a path that passes at more [mm]."""

INRADIUS = HALF_WIDTH * (1 - 1e-6)
"""Everything nearer to a robot's centre is robot, so it cuts a path that passes at less [mm]."""

CUT, CLEAR, OPEN = 0, 1, 2
"""Verdicts: a robot stands between; none does; only a ray can tell."""


@njit(cache=True)
def judge(
    slot: np.ndarray, receiver: np.ndarray, sender: np.ndarray, distance: np.ndarray, origin: np.ndarray,
    target: np.ndarray, poses: np.ndarray, first: np.ndarray, other: np.ndarray, other_distance: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Verdicts (P,) on the straight paths of light of P candidates; after a clear one of its slot, the rest is cut.

    Args:
        slot: (P,) sorted; candidates of one slot stand one behind the other, the nearest first.
        receiver: (P,) index of the receiving robot.
        sender: (P,) index of the sending robot.
        distance: (P,) between their centres [mm].
        origin: (P, 2) where the path begins, at the receiver [mm].
        target: (P, 2) where it ends, at the sender [mm].
        poses: (N, 3) of all robots [mm, mm, rad].
        first: (N + 1,) where each robot's neighbours begin in the next two.
        other: (Q,) index of the neighbour; complete as far as light reaches and a circumradius more.
        other_distance: (Q,) its distance [mm].
    """
    verdict = np.zeros(len(slot), np.int8)
    settled = -1
    for k in range(len(slot)):
        if slot[k] == settled:
            continue
        x, y = target[k, 0] - origin[k, 0], target[k, 1] - origin[k, 1]
        length = max(np.sqrt(x * x + y * y), 1e-9)
        x, y = x / length, y / length
        nearest = np.inf
        for q in range(first[receiver[k]], first[receiver[k] + 1]):
            if other[q] != sender[k] and other_distance[q] <= distance[k] + CIRCUMRADIUS:
                dx, dy = poses[other[q], 0] - origin[k, 0], poses[other[q], 1] - origin[k, 1]
                ahead = dx * x + dy * y
                beyond = ahead - min(max(ahead, 0.0), length)
                nearest = min(nearest, beyond**2 + (dy * x - dx * y) ** 2)
        if nearest > CIRCUMRADIUS**2:
            verdict[k] = CLEAR
            settled = slot[k]
        elif nearest > INRADIUS**2:
            verdict[k] = OPEN
    return verdict
