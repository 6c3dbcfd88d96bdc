"""Colours of contacts: one kernel that colours a list of them, on a CPU, where a block has a single thread."""

import numpy as np
import pytest
import warp as wp

from iswarm_mj.engines.planar.gpu.colours import MAX_COLOURS, colour_contacts
from iswarm_mj.engines.planar.gpu.records import RECORD_BYTES
from iswarm_mj.engines.planar.gpu.world import World
from iswarm_mj.utils.errors import FaultKind

N_ROBOTS = 40


@wp.kernel(enable_backward=False)
def colour(w: World):
    colour_contacts(w, 0)


def coloured(pairs, n_robots=N_ROBOTS):
    """Colour of each pair, the pairs sorted by colour, the ends of the colours, and the counts."""
    w, n = World(), len(pairs)
    w.place = wp.zeros(n_robots, dtype=wp.vec4, device="cpu")
    w.found = wp.array([(*pair, -1) for pair in pairs], dtype=wp.vec3i, device="cpu")
    records = wp.zeros((n, RECORD_BYTES // 4), dtype=int, device="cpu")
    w.n_first, w.first = n, records.ptr
    w.used = wp.full(n_robots, -1, dtype=int, device="cpu")  # of the step before
    w.claim = wp.zeros(n_robots, dtype=wp.int64, device="cpu")
    w.end = wp.full(MAX_COLOURS + 1, 7, dtype=int, device="cpu")
    w.count = wp.array([0, n, 0, 0], dtype=int, device="cpu")
    wp.launch(colour, 1, [w], device="cpu", block_dim=1)
    return w.found.numpy()[:, 2], records.numpy()[:, -2:], w.end.numpy(), w.count.numpy()


def heap(rng, n_pairs=90):
    """Distinct pairs of robots, and some robots at walls, of which one is at two."""
    every = [(i, j) for i in range(N_ROBOTS) for j in range(i + 1, N_ROBOTS)]
    chosen = [every[k] for k in rng.permutation(len(every))[:n_pairs]]
    walls = [(N_ROBOTS + wall, robot) for wall, robot in ((0, 3), (0, 5), (1, 5), (2, 9), (3, 9), (3, 11))]
    return chosen + walls


@pytest.mark.parametrize("seed", range(5))
def test_contacts_of_one_colour_share_no_robot(seed):
    pairs = heap(np.random.default_rng(seed))
    found, _, _, counts = coloured(pairs)
    assert (found >= 0).all() and counts[2] == found.max() + 1 and counts[3] == 0
    for one in range(found.max() + 1):
        robots = [i for pair, own in zip(pairs, found, strict=True) if own == one for i in pair if i < N_ROBOTS]
        assert len(robots) == len(set(robots)) > 0


def test_few_colours_are_taken():
    """A contact takes the least that is free at both ends; walls are shared."""
    star = [(0, robot) for robot in range(1, 12)]
    assert sorted(coloured(star)[0]) == list(range(11))
    assert (coloured([(2 * k, 2 * k + 1) for k in range(20)])[0] == 0).all()
    assert (coloured([(N_ROBOTS, robot) for robot in range(20)])[0] == 0).all()


def test_the_order_of_the_list_does_not_matter():
    pairs, rng = heap(np.random.default_rng(1)), np.random.default_rng(2)
    first = dict(zip(pairs, coloured(pairs)[0], strict=True))
    for _ in range(3):
        other = [pairs[k] for k in rng.permutation(len(pairs))]
        assert dict(zip(other, coloured(other)[0], strict=True)) == first


def test_the_list_is_sorted_by_colour():
    pairs = heap(np.random.default_rng(3))
    found, placed, end, counts = coloured(pairs)
    own = dict(zip(pairs, found, strict=True))
    np.testing.assert_array_equal([own[tuple(pair)] for pair in placed.tolist()], np.sort(found))
    n_colours = counts[2]
    np.testing.assert_array_equal(end[:n_colours], np.cumsum(np.bincount(found, minlength=n_colours)))
    np.testing.assert_array_equal(end[n_colours:], len(pairs))


def test_more_colours_than_there_are_is_a_fault():
    """A robot with as many contacts as there are colours is solved, one with more is told of."""
    star = [(0, robot) for robot in range(1, MAX_COLOURS + 2)]
    assert coloured(star[:-1])[3][3] == 0
    assert coloured(star)[3][3] == int(FaultKind.TOO_MANY_CONTACTS)
