"""Which robots MJX reports as touching, against the separating axis theorem in numbers."""

import jax.numpy as jnp
import numpy as np
from helpers_robots import HALF

from iswarm_mj.engines.planar.contact_geometry import separation
from iswarm_mj.utils.obstacles import overlap, with_poses


def test_long_robots_touch_along_their_length():
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.uniform(-4, 4, (2, 40)).T, rng.uniform(-3, 3, 40)]).astype(np.float32)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    gap = np.full((40, 40), np.inf)
    for i, j in zip(*np.triu_indices(40, 1), strict=True):
        gap[i, j], _ = separation(*(poses[j] - poses[i])[:2], c[i], s[i], c[j], s[j], *HALF, *HALF)
    hulls = with_poses(jnp.zeros((0, 6)), jnp.asarray(poses), np.array(HALF))
    found, clear = np.triu(overlap(hulls[:, None], hulls), 1), np.abs(gap) > 1e-4
    np.testing.assert_array_equal(found[clear], gap[clear] <= 0)
    assert 100 < (gap <= 0).sum() < 400
