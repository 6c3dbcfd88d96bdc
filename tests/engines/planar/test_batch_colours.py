"""Colours of contacts, by a kernel on a CPU, where a block has one thread."""

from itertools import combinations
from typing import NamedTuple

import numpy as np
import pytest
import warp as wp

from iswarm_mj.engines.planar.gpu.colours import MAX_COLOURS, colour_contacts
from iswarm_mj.engines.planar.gpu.records import RECORD_BYTES
from iswarm_mj.engines.planar.gpu.world import COLOUR, FAILURE, N_COLOURS, NO_COLOUR, World
from iswarm_mj.utils.errors import FaultKind

N_ROBOTS = 40
FIRST_WALL = N_ROBOTS
"""Walls are numbered after the robots."""


class Coloured(NamedTuple):
    """Outcome of colouring a list of pairs."""

    colours: np.ndarray
    """Colour of each pair."""
    sorted_pairs: np.ndarray
    """The pairs, sorted by colour."""
    ends: np.ndarray
    """Number of pairs of each colour and those before."""
    n_colours: int
    """Number of colours."""
    failure: int
    """Bits of `FaultKind`."""


@wp.kernel(enable_backward=False)
def colour_kernel(w: World):
    colour_contacts(w, 0)


def colour(pairs):
    """Colour pairs of robots, or of a wall and a robot."""
    n_pairs = len(pairs)
    contacts = [(*pair, int(NO_COLOUR)) for pair in pairs]
    records = wp.zeros((n_pairs, RECORD_BYTES // 4), dtype=int, device="cpu")
    w = World()
    w.places = wp.zeros(N_ROBOTS, dtype=wp.vec4, device="cpu")
    w.contacts = wp.array(contacts, dtype=wp.vec3i, device="cpu")
    w.n_shared_records = n_pairs
    w.shared_records = records.ptr
    w.least_keys = wp.zeros(N_ROBOTS, dtype=wp.int64, device="cpu")
    w.counts = wp.array([0, n_pairs, 0, 0], dtype=int, device="cpu")

    # Remains of the step before, which do not matter.
    w.used_colours = wp.full(N_ROBOTS, -1, dtype=int, device="cpu")
    w.colour_ends = wp.full(MAX_COLOURS + 1, 7, dtype=int, device="cpu")

    wp.launch(colour_kernel, 1, [w], device="cpu", block_dim=1)
    counts = w.counts.numpy()
    return Coloured(
        colours=w.contacts.numpy()[:, int(COLOUR)],
        sorted_pairs=records.numpy()[:, -2:],
        ends=w.colour_ends.numpy(),
        n_colours=counts[int(N_COLOURS)],
        failure=counts[int(FAILURE)],
    )


def heap(seed, n_pairs=90):
    """Return distinct pairs of robots, and some robots at walls, of which one is at two."""
    rng = np.random.default_rng(seed)
    all_pairs = list(combinations(range(N_ROBOTS), 2))
    robots = [all_pairs[k] for k in rng.permutation(len(all_pairs))[:n_pairs]]
    at_walls = [(0, 3), (0, 5), (1, 5), (2, 9), (3, 9), (3, 11)]
    return robots + [(FIRST_WALL + wall, robot) for wall, robot in at_walls]


def star(n_robots):
    """Return pairs of robot 0 with others."""
    return [(0, robot) for robot in range(1, n_robots + 1)]


@pytest.mark.parametrize("seed", range(5))
def test_contacts_of_one_colour_share_no_robot(seed):
    pairs = heap(seed)
    coloured = colour(pairs)
    assert coloured.failure == 0
    assert (coloured.colours >= 0).all()
    assert coloured.n_colours == coloured.colours.max() + 1
    for number in range(coloured.n_colours):
        members = [pairs[k] for k in np.flatnonzero(coloured.colours == number)]
        robots = [body for pair in members for body in pair if body < N_ROBOTS]
        assert len(robots) == len(set(robots)) > 0


def test_a_contact_takes_the_least_colour_that_is_free_at_both_ends():
    assert sorted(colour(star(11)).colours) == list(range(11))
    separate_pairs = [(2 * k, 2 * k + 1) for k in range(20)]
    assert (colour(separate_pairs).colours == 0).all()


def test_walls_are_shared():
    robots_at_one_wall = [(FIRST_WALL, robot) for robot in range(20)]
    assert (colour(robots_at_one_wall).colours == 0).all()


def test_the_order_of_the_list_does_not_matter():
    rng = np.random.default_rng(2)
    pairs = heap(seed=1)
    colour_of = dict(zip(pairs, colour(pairs).colours, strict=True))
    for _ in range(3):
        shuffled = [pairs[k] for k in rng.permutation(len(pairs))]
        assert dict(zip(shuffled, colour(shuffled).colours, strict=True)) == colour_of


def test_the_list_is_sorted_by_colour():
    pairs = heap(seed=3)
    coloured = colour(pairs)
    n_colours = coloured.n_colours
    colour_of = dict(zip(pairs, coloured.colours, strict=True))
    sorted_colours = [colour_of[tuple(pair)] for pair in coloured.sorted_pairs.tolist()]
    np.testing.assert_array_equal(sorted_colours, np.sort(coloured.colours))

    n_of_colour = np.bincount(coloured.colours, minlength=n_colours)
    np.testing.assert_array_equal(coloured.ends[:n_colours], np.cumsum(n_of_colour))
    np.testing.assert_array_equal(coloured.ends[n_colours:], len(pairs))


def test_more_contacts_of_a_robot_than_colours_are_a_fault():
    assert colour(star(MAX_COLOURS)).failure == 0
    assert colour(star(MAX_COLOURS + 1)).failure == int(FaultKind.TOO_MANY_CONTACTS)
