"""Islands: contacts that are connected by robots, so that each can be solved without the others."""

import numpy as np

from iswarm_mj.engines.planar.compiled import compiled, inlined


@compiled
def find_islands(contacts: np.ndarray, n_robots: int) -> tuple[np.ndarray, np.ndarray]:
    """Contacts by island, in the order in which they were; walls connect nothing.

    Args:
        contacts: (C,) of type CONTACT, of N robots and the wall, number N.
        n_robots: N.

    Returns:
        Indices of the contacts, island after island (C,); and where each of I islands begins (I + 1,).
    """
    root = np.arange(n_robots)
    for contact in contacts:
        if contact.first < n_robots:
            one, other = _find(root, contact.first), _find(root, contact.second)
            root[max(one, other)] = min(one, other)
    island = np.full(n_robots, -1, np.int64)  # of each root, numbered as they come
    first, n_islands = np.zeros(len(contacts) + 1, np.int64), 0
    for contact in contacts:
        top = _find(root, contact.second)
        if island[top] < 0:
            island[top] = n_islands
            n_islands += 1
        first[island[top] + 1] += 1
    first = np.cumsum(first[: n_islands + 1])
    place, order = first.copy(), np.empty(len(contacts), np.int64)
    for k in range(len(contacts)):
        own = island[_find(root, contacts[k].second)]
        order[place[own]] = k
        place[own] += 1
    return order, first


@inlined
def _find(root: np.ndarray, robot: int) -> int:
    """The robot that stands for all robots of its island, with shorter ways to it for the next time."""
    while root[robot] != robot:
        root[robot] = root[root[robot]]
        robot = root[robot]
    return robot
