"""Islands of contacts against SciPy's connected components."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from iswarm_mj.engines.planar.contacts import CONTACT
from iswarm_mj.engines.planar.islands import find_islands


@pytest.mark.parametrize("n_contacts", [0, 1, 20, 40, 80])
def test_islands_are_connected_components(n_contacts):
    n_robots, rng = 50, np.random.default_rng(n_contacts)
    contacts = np.zeros(n_contacts, CONTACT)
    contacts["second"] = rng.integers(1, n_robots, n_contacts)
    is_wall = rng.random(n_contacts) < 0.3
    contacts["first"] = np.where(is_wall, n_robots, rng.integers(contacts["second"]) if n_contacts else 0)
    order, first = find_islands(contacts, n_robots)
    assert sorted(order.tolist()) == list(range(n_contacts))
    pairs = contacts[~is_wall]
    edges = coo_array((np.ones(len(pairs)), (pairs["first"], pairs["second"])), shape=(n_robots, n_robots))
    component = connected_components(edges, directed=False)[1][contacts["second"]]
    islands = [order[a:b] for a, b in pairwise(first)]
    assert len(islands) == len(set(component))
    for members in islands:
        assert len(set(component[members])) == 1
        assert (np.diff(members) > 0).all()
