"""Vector memories: what is heard, what is kept, and how motion changes it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.sensing import remember, turned

from iswarm_mj.config.swarm import OpticsConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.sensors.optics import receive
from iswarm_mj.strategy.vectors import adopt, after_motion, mark_arrival, side_of_best_offer, to_receiver_frame

heard_here, after_motion_here = jax.jit(to_receiver_frame), jax.jit(after_motion)
angles = st.floats(-np.pi, np.pi)
lengths = st.floats(-100, 100)


@jax.jit
def adopt_here(own, offers, use_hop_count, tie):
    """Memories after the best offer (N, S) to each robot."""
    side = side_of_best_offer(offers.hop, offers.known, use_hop_count, tie)
    return adopt(own, jax.tree.map(lambda a: a[jnp.arange(len(side)), side], offers), use_hop_count)


def in_frame(pose, point):
    """World point as a robot at `pose` sees it."""
    return turned(np.asarray(point) - pose[..., :2], -pose[..., 2])


def neighbour(pose, side, led, distance):
    """Pose of a robot straight in front of this one's `side`, whose `led` looks straight back."""
    direction = pose[2] + side * np.pi / 2
    xy = pose[:2] + distance * np.array([np.cos(direction), np.sin(direction)])
    return np.array([*xy, direction + np.pi - led * np.pi / 2])


def listen(receiver, sender, sent):
    """What a robot at `receiver` makes of the vector of one at `sender`, by what the optics tell it."""
    dx, dy = sender[:2] - receiver[:2]
    views = [tuple(np.array([f(p[2])]) for f in (np.cos, np.sin)) for p in (receiver, sender)]
    got = receive(np.array([dx]), np.array([dy]), *views, read_robot(), OpticsConfig())
    assert np.isfinite(got.effective_distance).all()
    return heard_here(sent, got.bearing, got.effective_distance, got.led), got


@pytest.mark.parametrize("side", range(4))
@pytest.mark.parametrize("led", range(4))
def test_vector_sum_of_fig_13a_is_exact_where_the_bearings_are(side, led):
    rng = np.random.default_rng([side, led])
    receiver = np.array([*rng.uniform(-60, 60, 2), rng.uniform(-3, 3)])
    sender = neighbour(receiver, side, led, rng.uniform(2.5, 9.8))
    target = rng.uniform(-60, 60, 2)
    final, got = listen(receiver, sender, remember(in_frame(sender, target)[None], hop=3))
    assert (got.side[0], got.led[0]) == (side, led)
    np.testing.assert_allclose(final.vector[0], in_frame(receiver, target), atol=1e-4)
    assert final.known[0] and final.hop[0] == 4


def test_who_sends_no_vector_is_not_heard_of():
    silent = heard_here(remember([[5.0, 5.0]], known=False), np.zeros(1), np.ones(1), np.zeros(1, int))
    assert not silent.known[0] and silent.hop[0] == 0 and not silent.vector.any()


@settings(max_examples=60, deadline=None)
@given(lengths, lengths, angles, lengths, lengths, angles, st.floats(-3, 3))
def test_the_point_in_the_world_stays_while_the_robot_turns_then_walks(x, y, yaw, px, py, turn, forward):
    pose, point = np.array([x, y, yaw]), np.array([px, py])
    memory = after_motion_here(remember(in_frame(pose, point)[None], hop=2), np.array([turn]), np.array([forward]))
    new_yaw = yaw + turn
    new_xy = pose[:2] + forward * np.array([np.cos(new_yaw), np.sin(new_yaw)])
    np.testing.assert_allclose(turned(np.asarray(memory.vector[0], float), new_yaw) + new_xy, point, atol=1e-3)
    assert memory.hop[0] == 2


def test_motion_teaches_nothing_to_the_ignorant():
    memory = after_motion_here(VectorMemory.empty(1), np.ones(1), np.ones(1))
    assert not memory.known[0] and not memory.vector.any()


def test_standing_on_the_target_is_the_zero_vector_with_hop_0():
    before = remember(np.array([[3.0, 4.0], [3.0, 4.0], [0, 0], [0, 0]]), hop=6, known=np.array([1, 1, 0, 0], bool))
    after = mark_arrival(before, np.array([True, False, True, False]))
    np.testing.assert_array_equal(after.vector, [[0, 0], [3, 4], [0, 0], [0, 0]])
    np.testing.assert_array_equal(after.hop, [0, 6, 0, 0])
    np.testing.assert_array_equal(after.known, [True, True, True, False])


def test_forgetting_leaves_nothing():
    after = remember(np.array([[3.0, 4.0], [1.0, 2.0]]), hop=6).where(np.array([False, True]))
    np.testing.assert_array_equal(after.vector, [[0, 0], [1, 2]])
    np.testing.assert_array_equal(after.hop, [0, 6])
    np.testing.assert_array_equal(after.known, [False, True])


def take(own_hop, offered, use_hop_count, n=1, seed=0):
    """Memories of n robots after offers with these hop counts (None: no vector); offer s is the vector (s + 1, 0)."""
    offered = [*offered, None, None, None][:4]
    own = remember(np.tile([-9.0, 0.0], (n, 1)), hop=own_hop or 0, known=own_hop is not None)
    vectors = np.stack([np.arange(1.0, len(offered) + 1), np.zeros(len(offered))], -1)
    offers = remember(
        np.tile(vectors, (n, 1, 1)), [h or 0 for h in offered], np.array([h is not None for h in offered])
    )
    memory = adopt_here(own, offers, use_hop_count, jax.random.uniform(jax.random.key(seed), (n, len(offered))))
    return np.asarray(memory.vector[:, 0]), np.asarray(memory.hop), np.asarray(memory.known)


@pytest.mark.parametrize(
    ("own", "offered", "taken", "hop"),
    [
        (5, [4, None], 1, 4),
        (5, [5, None], -9, 5),  # equal is not younger
        (5, [6, None], -9, 5),
        (5, [None, None], -9, 5),
        (5, [4, 2, 3], 2, 2),  # smallest of several
        (5, [None, 9, 3], 3, 3),
        (0, [1, 1, 1], -9, 0),
        (None, [14, 9, None], 2, 9),  # who knows nothing takes any
        (None, [None, 15, None], 2, 15),
    ],
)
def test_with_hop_counts_only_younger_vectors_are_taken(own, offered, taken, hop):
    assert take(own, offered, True) == (taken, hop, True)


def test_nothing_from_nothing():
    for use_hop_count in (True, False):
        assert take(None, [None, None], use_hop_count) == (0, 0, False)


def test_without_hop_counts_what_comes_is_taken_and_nothing_is_counted():
    assert take(0, [None, 12], False) == (2, 0, True)
    assert take(None, [None, 12], False) == (2, 0, True)
    assert take(0, [None, None], False) == (-9, 0, True)


@pytest.mark.parametrize(
    ("own", "offered", "use_hop_count", "eligible"),
    [
        (9, [3, 3, None, 3], True, [1, 2, 4]),
        (9, [3, 2, 2, 8], True, [2, 3]),
        (0, [3, 1, 14, None], False, [1, 2, 3]),
    ],
)
def test_equal_offers_are_taken_equally_often(own, offered, use_hop_count, eligible):
    n = 20_000
    vector, _, _ = take(own, offered, use_hop_count, n, seed=7)
    assert set(vector) == set(eligible)
    expected = n / len(eligible)
    for option in eligible:
        assert abs((vector == option).sum() - expected) < 4.5 * np.sqrt(expected)
