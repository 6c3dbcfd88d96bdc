"""Islands: contacts that robots or boxes connect; each island is solved by itself."""

import numpy as np

from iswarm_mj.engines.planar.compiled import compiled, inlined


@compiled
def find_islands(contacts: np.ndarray, n_bodies: int) -> tuple[np.ndarray, np.ndarray]:
    """Sort contacts by island; within an island they keep their order. Walls connect nothing.

    Args:
        contacts: (C,) of type CONTACT, of N bodies and of body number N, which is fixed.
        n_bodies: number N of bodies that move.

    Returns:
        Indices of the contacts, island after island (C,); and where each of I islands begins,
        with the end of the last (I + 1,).
    """
    parent = _unite(contacts, n_bodies)

    # Number the islands in the order in which they come, and count their contacts.
    island_of_root = np.full(n_bodies, -1, np.int64)
    begins = np.zeros(len(contacts) + 1, np.int64)
    n_islands = 0
    for contact in contacts:
        root = _find_root(parent, contact.second)
        if island_of_root[root] < 0:
            island_of_root[root] = n_islands
            n_islands += 1
        begins[island_of_root[root] + 1] += 1
    begins = np.cumsum(begins[: n_islands + 1])

    # Put each contact at the next free place of its island.
    next_place = begins.copy()
    order = np.empty(len(contacts), np.int64)
    for k in range(len(contacts)):
        island = island_of_root[_find_root(parent, contacts[k].second)]
        order[next_place[island]] = k
        next_place[island] += 1
    return order, begins


@compiled
def _unite(contacts: np.ndarray, n_bodies: int) -> np.ndarray:
    """Return the parents (N,) of a forest in which connected bodies have the same root."""
    parent = np.arange(n_bodies)
    for contact in contacts:
        if contact.first < n_bodies:
            first_root = _find_root(parent, contact.first)
            second_root = _find_root(parent, contact.second)
            parent[max(first_root, second_root)] = min(first_root, second_root)
    return parent


@inlined
def _find_root(parent: np.ndarray, body: int) -> int:
    """Return the root of a body's tree, and halve the path to it for the next time."""
    while parent[body] != body:
        parent[body] = parent[parent[body]]
        body = parent[body]
    return body
