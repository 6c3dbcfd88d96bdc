"""In which order MJX looks at senders."""

import jax.numpy as jnp
import numpy as np

from iswarm_mj.engines.mjx.sight import Search, next_candidate


def test_of_equally_far_candidates_each_comes_once_by_number():
    """Robot 0 has three at one distance and a farther one on its only side; the other robots have nobody."""
    reach = jnp.full((5, 5), jnp.inf).at[0].set(jnp.array([jnp.inf, 5.0, 5.0, 7.0, 5.0]))
    side = jnp.full((5, 5), -1).at[0].set(0)
    nobody = jnp.zeros((5, 1), bool)
    search, found = Search(jnp.zeros((5, 1)), jnp.full((5, 1), -1), nobody, nobody), []
    for _ in range(5):
        distance, sender = next_candidate(search, reach, side)
        assert np.isinf(np.asarray(distance)[1:]).all()
        found.append((int(sender[0, 0]), float(distance[0, 0])))
        search = search._replace(distance=distance, sender=sender)
    assert found[:4] == [(1, 5.0), (2, 5.0), (4, 5.0), (3, 7.0)] and found[4][1] == np.inf
