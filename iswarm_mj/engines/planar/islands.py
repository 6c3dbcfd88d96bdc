"""Islands: contacts that robots or boxes connect; each island is solved by itself."""

from typing import Any

import numpy as np

from iswarm_mj.engines.planar.compiled import compiled, inlined, missing_indices, uncounted


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
    parent = np.empty(n_bodies, np.int64)
    for body in range(n_bodies):
        parent[body] = body
    _unite(contacts, parent)
    island_of_root = missing_indices(n_bodies)
    begins = np.empty(len(contacts) + 1, np.int64)
    n_islands = _number(contacts, parent, island_of_root, begins)

    # Sum up the contacts of the islands before each.
    next_place = np.empty(n_islands, np.int64)
    for island in range(n_islands):
        next_place[island] = begins[island]
        begins[island + 1] += begins[island]
    order = np.empty(len(contacts), np.int64)
    _sort(contacts, parent, island_of_root, next_place, order)
    return order, begins[: n_islands + 1]


@uncounted
def _unite(contacts: np.ndarray, parent: np.ndarray) -> None:
    """Write the parents (N,) of a forest in which connected bodies have the same root."""
    for k in range(len(contacts)):
        contact: Any = contacts[k]
        if contact.first < len(parent):
            first_root = _find_root(parent, contact.first)
            second_root = _find_root(parent, contact.second)
            parent[max(first_root, second_root)] = min(first_root, second_root)


@uncounted
def _number(
    contacts: np.ndarray,
    parent: np.ndarray,
    island_of_root: np.ndarray,
    n_contacts: np.ndarray,
) -> int:
    """Number the islands in the order in which they come, and count their contacts.

    Args:
        contacts: (C,) of type CONTACT.
        parent: (N,) see `_unite`.
        island_of_root: (N,) -1, output for the roots.
        n_contacts: (C + 1,) output: contacts of the island before, from the second on.

    Returns:
        Number of islands.
    """
    for k in range(len(n_contacts)):
        n_contacts[k] = 0
    n_islands = 0
    for k in range(len(contacts)):
        root = _find_root(parent, contacts[k].second)
        if island_of_root[root] < 0:
            island_of_root[root] = n_islands
            n_islands += 1
        n_contacts[island_of_root[root] + 1] += 1
    return n_islands


@uncounted
def _sort(
    contacts: np.ndarray,
    parent: np.ndarray,
    island_of_root: np.ndarray,
    next_place: np.ndarray,
    order: np.ndarray,
) -> None:
    """Put the index of each contact at the next free place of its island in `order` (C,)."""
    for k in range(len(contacts)):
        island = island_of_root[_find_root(parent, contacts[k].second)]
        order[next_place[island]] = k
        next_place[island] += 1


@inlined
def _find_root(parent: np.ndarray, body: int) -> int:
    """Return the root of a body's tree, and halve the path to it for the next time."""
    while parent[body] != body:
        parent[body] = parent[parent[body]]
        body = parent[body]
    return body
