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
from iswarm_mj.strategy.vectors import (
    adopt,
    after_motion,
    mark_arrival,
    side_of_best_offer,
    to_receiver_frame,
)

to_receiver_frame_jit = jax.jit(to_receiver_frame)
after_motion_jit = jax.jit(after_motion)
angles = st.floats(-np.pi, np.pi)
lengths = st.floats(-100, 100)


@jax.jit
def adopt_best(memory, offers, use_hop_count, tie):
    """Return the memories after each robot adopted or rejected the best of its offers (N, S)."""
    side = side_of_best_offer(offers.hop, offers.known, tie, use_hop_count=use_hop_count)
    robots = jnp.arange(len(side))
    best = jax.tree.map(lambda values: values[robots, side], offers)
    return adopt(memory, best, use_hop_count=use_hop_count)


def in_frame(pose, point):
    """Return the vector to a point of the world in the frame of a robot at `pose`."""
    return turned(np.asarray(point) - pose[..., :2], -pose[..., 2])


def neighbour(pose, side, led, distance):
    """Return the pose of a robot straight in front of a side, whose `led` looks straight back."""
    direction = pose[2] + side * np.pi / 2
    xy = pose[:2] + distance * np.array([np.cos(direction), np.sin(direction)])
    yaw = direction + np.pi - led * np.pi / 2
    return np.array([*xy, yaw])


def listen(receiver, sender, sent):
    """Return the vector that a robot hears from another by light, and the light that it receives.

    Args:
        receiver: pose of the robot that hears.
        sender: pose of the robot that speaks.
        sent: vector in the sender's frame.
    """
    dx, dy = sender[:2] - receiver[:2]
    axis_of_receiver = np.cos(receiver[2:]), np.sin(receiver[2:])
    axis_of_sender = np.cos(sender[2:]), np.sin(sender[2:])
    light = receive(
        dx=np.array([dx]),
        dy=np.array([dy]),
        receiver=axis_of_receiver,
        sender=axis_of_sender,
        robot=read_robot(),
        optics=OpticsConfig(),
    )
    assert np.isfinite(light.effective_distance).all()
    heard = to_receiver_frame_jit(sent, light.bearing, light.effective_distance, light.led)
    return heard, light


@pytest.mark.parametrize("side", range(4))
@pytest.mark.parametrize("led", range(4))
def test_vector_sum_of_fig_13a_is_exact_where_the_bearings_are(side, led):
    rng = np.random.default_rng([side, led])
    receiver = np.array([*rng.uniform(-60, 60, 2), rng.uniform(-3, 3)])
    sender = neighbour(receiver, side, led, rng.uniform(2.5, 9.8))
    target = rng.uniform(-60, 60, 2)

    sent = remember(in_frame(sender, target)[None], hop=3)
    heard, light = listen(receiver, sender, sent)

    assert (light.side[0], light.led[0]) == (side, led)
    np.testing.assert_allclose(heard.vector[0], in_frame(receiver, target), atol=1e-4)
    assert heard.known[0]
    assert heard.hop[0] == 4


def test_an_unknown_vector_stays_unknown():
    sent = remember([[5.0, 5.0]], known=False)
    heard = to_receiver_frame_jit(sent, np.zeros(1), np.ones(1), np.zeros(1, int))
    assert not heard.known[0]
    assert heard.hop[0] == 0
    assert not heard.vector.any()


@settings(max_examples=60, deadline=None)
@given(lengths, lengths, angles, lengths, lengths, angles, st.floats(-3, 3))
def test_a_vector_points_to_the_same_place_after_a_turn_and_a_walk(
    x,
    y,
    yaw,
    point_x,
    point_y,
    turn,
    forward,
):
    pose = np.array([x, y, yaw])
    point = np.array([point_x, point_y])
    before = remember(in_frame(pose, point)[None], hop=2)
    after = after_motion_jit(before, np.array([turn]), np.array([forward]))

    new_yaw = yaw + turn
    new_xy = pose[:2] + forward * np.array([np.cos(new_yaw), np.sin(new_yaw)])
    remembered_point = turned(np.asarray(after.vector[0], float), new_yaw) + new_xy
    np.testing.assert_allclose(remembered_point, point, atol=1e-3)
    assert after.hop[0] == 2


def test_robots_without_a_vector_have_none_after_a_motion():
    memory = after_motion_jit(VectorMemory.empty(1), np.ones(1), np.ones(1))
    assert not memory.known[0]
    assert not memory.vector.any()


def test_standing_on_the_target_is_the_zero_vector_with_hop_0():
    knows = np.array([True, True, False, False])
    is_there = np.array([True, False, True, False])
    before = remember(np.array([[3.0, 4.0], [3.0, 4.0], [0, 0], [0, 0]]), hop=6, known=knows)
    after = mark_arrival(before, is_there)
    np.testing.assert_array_equal(after.vector, [[0, 0], [3, 4], [0, 0], [0, 0]])
    np.testing.assert_array_equal(after.hop, [0, 6, 0, 0])
    np.testing.assert_array_equal(after.known, [True, True, True, False])


def test_forgetting_leaves_nothing():
    before = remember(np.array([[3.0, 4.0], [1.0, 2.0]]), hop=6)
    after = before.where(np.array([False, True]))
    np.testing.assert_array_equal(after.vector, [[0, 0], [1, 2]])
    np.testing.assert_array_equal(after.hop, [0, 6])
    np.testing.assert_array_equal(after.known, [False, True])


OWN = -9
"""x of the vector that robots know before an offer."""


def take(own_hop, offered, use_hop_count, n_robots=1, seed=0):
    """Return x of the vectors, hop counts and `known` of robots after offers from four sides.

    Side s offers the vector (s + 1, 0), so that x tells which one a robot adopted.

    Args:
        own_hop: hop count of the robots' own vector; None if they know none.
        offered: hop counts of the vectors from the first sides; None where no vector comes.
        use_hop_count: the genome's flag.
        n_robots: number of robots, which are all offered the same.
        seed: seed of the draws between equal offers.
    """
    offered = [*offered, None, None, None][:4]
    hops = [hop or 0 for hop in offered]
    is_offered = np.array([hop is not None for hop in offered])
    vectors = np.array([[side + 1.0, 0.0] for side in range(4)])
    offers = remember(np.tile(vectors, (n_robots, 1, 1)), hops, is_offered)
    own_vectors = np.tile([float(OWN), 0.0], (n_robots, 1))
    before = remember(own_vectors, hop=own_hop or 0, known=own_hop is not None)

    ties = jax.random.uniform(jax.random.key(seed), (n_robots, 4))
    memory = adopt_best(before, offers, use_hop_count, ties)
    return np.asarray(memory.vector[:, 0]), np.asarray(memory.hop), np.asarray(memory.known)


@pytest.mark.parametrize(
    ("own_hop", "offered", "taken", "hop"),
    [
        (5, [4, None], 1, 4),
        (5, [5, None], OWN, 5),  # an equal hop count is not smaller
        (5, [6, None], OWN, 5),
        (5, [None, None], OWN, 5),
        (5, [4, 2, 3], 2, 2),  # the smallest of several
        (5, [None, 9, 3], 3, 3),
        (0, [1, 1, 1], OWN, 0),
        (None, [14, 9, None], 2, 9),  # a robot that knows nothing takes any
        (None, [None, 15, None], 2, 15),
    ],
)
def test_with_hop_counts_only_smaller_ones_are_taken(own_hop, offered, taken, hop):
    assert take(own_hop, offered, use_hop_count=True) == (taken, hop, True)


def test_nothing_from_nothing():
    for use_hop_count in (True, False):
        assert take(None, [None, None], use_hop_count) == (0, 0, False)


def test_without_hop_counts_every_vector_is_taken_and_nothing_is_counted():
    assert take(0, [None, 12], use_hop_count=False) == (2, 0, True)
    assert take(None, [None, 12], use_hop_count=False) == (2, 0, True)
    assert take(0, [None, None], use_hop_count=False) == (OWN, 0, True)


@pytest.mark.parametrize(
    ("own_hop", "offered", "use_hop_count", "eligible"),
    [
        (9, [3, 3, None, 3], True, [1, 2, 4]),
        (9, [3, 2, 2, 8], True, [2, 3]),
        (0, [3, 1, 14, None], False, [1, 2, 3]),
    ],
)
def test_equal_offers_are_taken_equally_often(own_hop, offered, use_hop_count, eligible):
    n_robots = 20_000
    taken, _, _ = take(own_hop, offered, use_hop_count, n_robots, seed=7)

    assert set(taken) == set(eligible)
    expected = n_robots / len(eligible)
    for option in eligible:
        count = (taken == option).sum()
        assert abs(count - expected) < 4.5 * np.sqrt(expected)  # 4.5 standard deviations
