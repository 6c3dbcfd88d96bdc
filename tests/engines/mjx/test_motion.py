"""Which robots MJX reports as touching, against the separating axis theorem in numbers."""

import jax.numpy as jnp
import numpy as np
from helpers_robots import HALF, robot_file

from iswarm_mj.engines.mjx.motion import overlapping
from iswarm_mj.engines.planar.contact_geometry import separation
from iswarm_mj.engines.robot_file import read_robot


def test_long_robots_touch_along_their_length(tmp_path):
    robot = read_robot(robot_file(tmp_path, "six"))
    assert robot.half_edges[:2] == HALF
    lying = jnp.array([(0, 0, 0), (2.3, 0, 0), (0, 1.7, 0)], jnp.float32)
    assert np.argwhere(overlapping(lying, robot)).tolist() == [[0, 1]]
    rng = np.random.default_rng(0)
    poses = np.column_stack([rng.uniform(-4, 4, (2, 40)).T, rng.uniform(-3, 3, 40)]).astype(np.float32)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    gap = np.full((40, 40), np.inf)
    for i, j in zip(*np.triu_indices(40, 1), strict=True):
        gap[i, j], _ = separation(*(poses[j] - poses[i])[:2], c[i], s[i], c[j], s[j], *HALF, *HALF)
    clear = np.abs(gap) > 1e-4
    np.testing.assert_array_equal(np.asarray(overlapping(jnp.asarray(poses), robot))[clear], gap[clear] <= 0)
    assert 100 < (gap <= 0).sum() < 400
