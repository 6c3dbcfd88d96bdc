"""Islands of contacts against SciPy's connected components."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from support.compiled import for_python

from iswarm_mj.engines.planar import islands
from iswarm_mj.engines.planar.contacts import CONTACT

find_islands = for_python(islands.find_islands)
N_ROBOTS = 50


def random_contacts(n_contacts):
    """Return contacts of robots, 30 % of them with a wall, whose number is that of the robots."""
    rng = np.random.default_rng(n_contacts)
    contacts = np.zeros(n_contacts, CONTACT)
    contacts["second"] = rng.integers(1, N_ROBOTS, n_contacts)
    is_wall = rng.random(n_contacts) < 0.3
    lower_robots = rng.integers(contacts["second"]) if n_contacts else 0
    contacts["first"] = np.where(is_wall, N_ROBOTS, lower_robots)
    return contacts


@pytest.mark.parametrize("n_contacts", [0, 1, 20, 40, 80])
def test_islands_are_connected_components(n_contacts):
    contacts = random_contacts(n_contacts)
    order, begins = find_islands(contacts, N_ROBOTS)
    assert sorted(order.tolist()) == list(range(n_contacts))

    # Walls connect nothing.
    pairs = contacts[contacts["first"] < N_ROBOTS]
    edges = (np.ones(len(pairs)), (pairs["first"], pairs["second"]))
    graph = coo_array(edges, shape=(N_ROBOTS, N_ROBOTS))
    component_of_robot = connected_components(graph, directed=False)[1]
    component = component_of_robot[contacts["second"]]

    islands = [order[begin:end] for begin, end in pairwise(begins)]
    assert len(islands) == len(set(component))
    for members in islands:
        assert len(set(component[members])) == 1
        assert (np.diff(members) > 0).all()  # in the order in which they were
