"""Pairs of near robots, against brute force. Units: mm."""

import numpy as np
import pytest
from scipy.spatial.distance import pdist
from support.compiled import for_python

from iswarm_mj.engines.planar import near_pairs as module

near_pairs = for_python(module.near_pairs)
RADIUS = 4.0
HALF_EXTENT = 20.0


@pytest.mark.parametrize(
    ("n_robots", "half_extent"),
    [(1, 20.0), (2, 5.0), (150, 20.0), (150, 400.0)],
)
def test_near_pairs_are_all_pairs_within_the_radius(n_robots, half_extent):
    rng = np.random.default_rng(n_robots)
    xy = rng.uniform(-22, 22, (n_robots, 2))
    pairs = near_pairs(xy, np.ones(n_robots, bool), RADIUS, half_extent)
    first, second = np.triu_indices(n_robots, 1)
    is_near = pdist(xy) < RADIUS if n_robots > 1 else np.zeros(0, bool)
    expected = np.column_stack([first[is_near], second[is_near]])
    assert sorted(pairs.tolist()) == expected.tolist()


def test_near_pairs_of_a_heap_are_all_pairs():
    """A hundred robots at one point: more pairs than the first array has places for."""
    n_robots = 100
    pairs = near_pairs(np.zeros((n_robots, 2)), np.ones(n_robots, bool), RADIUS, HALF_EXTENT)
    assert len(pairs) == n_robots * (n_robots - 1) // 2


def test_near_pairs_leave_out_robots_that_are_absent_or_not_finite():
    xy = np.zeros((4, 2))
    xy[3, 0] = np.nan
    is_present = np.array([True, False, True, True])
    assert near_pairs(xy, is_present, RADIUS, HALF_EXTENT).tolist() == [[0, 2]]
