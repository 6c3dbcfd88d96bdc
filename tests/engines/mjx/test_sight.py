"""Order in which MJX looks at senders."""

import jax.numpy as jnp
import numpy as np

from iswarm_mj.engines.mjx.sight import Search, next_candidate


def test_of_equally_far_candidates_each_comes_once_by_index():
    """Robot 0 has three at one distance and a farther one on its only side; others have nobody."""
    nobody = jnp.full((5, 5), jnp.inf)
    distance = nobody.at[0].set(jnp.array([jnp.inf, 5.0, 5.0, 7.0, 5.0]))
    side = jnp.full((5, 5), -1).at[0].set(0)
    search = Search(
        distance=jnp.zeros((5, 1)),
        sender=jnp.full((5, 1), -1),
        is_found=jnp.zeros((5, 1), bool),
        is_searching=jnp.zeros((5, 1), bool),
    )

    candidates = []
    for _ in range(5):
        next_distance, sender = next_candidate(search, distance, side)
        assert np.isinf(np.asarray(next_distance)[1:]).all()
        candidates.append((int(sender[0, 0]), float(next_distance[0, 0])))
        search = search._replace(distance=next_distance, sender=sender)

    assert candidates[:4] == [(1, 5.0), (2, 5.0), (4, 5.0), (3, 7.0)]
    _, distance_of_fifth = candidates[4]
    assert distance_of_fifth == np.inf
