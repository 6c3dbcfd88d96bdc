"""Collision avoidance: the distances that robots keep, and how hard they push away."""

from dataclasses import replace
from functools import partial

import jax
import numpy as np
import pytest
from support.sensing import RADIUS, senses_nothing

from iswarm_mj.config.swarm import StrategyConfig, SwarmConfig
from iswarm_mj.strategy.avoidance import KeptDistances, kept_distances, repulsion
from iswarm_mj.strategy.controller import avoidance_push
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.rules import rules_of

CONFIG = SwarmConfig().static
avoidance_push_jit = jax.jit(partial(avoidance_push, CONFIG))
repulsion_jit = jax.jit(repulsion)

TYPE1 = PRESETS["type1"]
GAIN = 8
"""`strategy.avoidance_gain`."""


@pytest.mark.parametrize(
    ("preset", "from_ordinary", "from_flagged", "of_loaded"),
    [
        ("type1", 0.65, 0.40, 0.25),
        ("type2", 0.77, 0.41, 0.27),
    ],
)
def test_distances_of_table_2(preset, from_ordinary, from_flagged, of_loaded):
    is_loaded = np.array([False, True])
    priority = np.array([[False, True], [False, True]])
    kept = kept_distances(rules_of(PRESETS[preset]), is_loaded, priority)
    expected = [[from_ordinary, from_flagged], [of_loaded, of_loaded]]
    np.testing.assert_allclose(kept.threshold, expected, rtol=1e-6)


def test_push_is_straight_away_and_falls_linearly_to_zero_at_the_distance_to_keep():
    keep = 0.65
    bearings = np.radians([0, 90, 180, 270, 33])
    distances_in_keep = [0.0, 0.25, 0.9, 1.0, 1.5, 40.0]
    grid = np.meshgrid(bearings, distances_in_keep)
    bearing, distance_in_keep = (values.reshape(-1, 1) for values in grid)

    everywhere = np.full_like(bearing, keep)
    push = repulsion_jit(
        bearing,
        keep * distance_in_keep,
        KeptDistances(threshold=everywhere, reach=everywhere),
        weight=np.ones_like(bearing),
    )

    away = -np.column_stack([np.cos(bearing), np.sin(bearing)])
    np.testing.assert_allclose(push, np.maximum(1 - distance_in_keep, 0) * away, atol=1e-6)


def test_pushes_add_up():
    kept = KeptDistances(threshold=np.ones((1, 3)), reach=np.ones((1, 3)))
    push = repulsion_jit(
        np.array([[0.0, np.pi / 2, np.pi]]),
        np.array([[0.5, 0.5, 0.75]]),
        kept,
        weight=np.array([[1.0, 2.0, 1.0]]),
    )
    np.testing.assert_allclose(push, [[-0.5 + 0.25, -1.0]], atol=1e-6)


def test_no_distance_to_keep_is_no_push():
    zero = np.zeros((1, 1))
    push = repulsion_jit(zero, np.full((1, 1), 0.1), KeptDistances(zero, zero), np.ones((1, 1)))
    np.testing.assert_allclose(push, 0, atol=1e-6)


INITIAL = StrategyConfig(avoidance_sides="all", priority_repulsion="scaled")


def push_on(distance, heard=True, priority=False, loaded=False, side=0, led=0, strategy=INITIAL):
    """Return the push (2,) on a robot with one neighbour.

    Args:
        distance: distance of the neighbour [mm].
        heard: the neighbour's message arrives.
        priority: the neighbour sends the priority flag.
        loaded: the robot holds a ball.
        side: side of the robot on which the neighbour is.
        led: LED of the neighbour that the robot sees.
        strategy: interpretations of the paper.
    """
    is_side = np.arange(4)[None] == side
    nothing = senses_nothing(1)
    observation = nothing._replace(
        is_heard=is_side & heard,
        distance=np.where(is_side, np.float32(distance), nothing.distance),
        payload=nothing.payload | {"priority": is_side & priority},
        led=np.where(is_side, np.int32(led), nothing.led),
        is_loaded=np.array([loaded]),
    )
    follows = np.array([False])
    return np.asarray(avoidance_push_jit(rules_of(TYPE1, strategy), observation, follows))[0]


def test_priority_doubles_the_push_on_a_loaded_robot():
    near = 0.1 * RADIUS
    ordinary = push_on(near, loaded=True)
    flagged = push_on(near, loaded=True, priority=True)
    np.testing.assert_allclose(ordinary, [-GAIN * (1 - 0.1 / 0.25), 0], rtol=1e-5)
    np.testing.assert_allclose(flagged, 2 * ordinary, rtol=1e-6)

    five_times = replace(INITIAL, priority_factor=5.0)
    flagged = push_on(near, loaded=True, priority=True, strategy=five_times)
    np.testing.assert_allclose(flagged, 5 * ordinary)


def test_an_empty_robot_lets_priority_come_closer_but_then_gives_way_more():
    assert not push_on(0.5 * RADIUS, priority=True).any()
    np.testing.assert_allclose(push_on(0.5 * RADIUS), [-GAIN * (1 - 0.5 / 0.65), 0], rtol=1e-5)

    closer = push_on(0.2 * RADIUS, priority=True)
    np.testing.assert_allclose(closer, [-GAIN * 2 * (1 - 0.2 / 0.4), 0], rtol=1e-5)


def test_a_neighbour_that_is_not_heard_does_not_push():
    assert not push_on(0.1, heard=False, priority=True).any()


def test_only_the_front_counts_as_the_paper_says():
    """Section 4.1: all photodiodes are off but those on the front."""
    for side in range(4):
        is_front = side == 0
        assert push_on(0.3 * RADIUS, side=side, strategy=StrategyConfig()).any() == is_front
        assert push_on(0.3 * RADIUS, side=side, strategy=INITIAL).any()


@pytest.mark.parametrize(
    ("sides", "counts"),
    [
        ("front", [True, False, False, False]),
        ("all", [True, True, True, True]),
    ],
)
def test_walls_push_robots_that_follow_no_vector(sides, counts):
    """Robot k has a wall on side k."""
    rules = rules_of(TYPE1, StrategyConfig(avoidance_sides=sides))
    observation = senses_nothing(4)._replace(sees_wall=np.eye(4, dtype=bool))
    push = np.asarray(avoidance_push_jit(rules, observation, np.zeros(4, bool)))

    away_from_wall = [[-2, 0], [0, -2], [2, 0], [0, 2]]
    expected = np.array(counts)[:, None] * away_from_wall
    np.testing.assert_allclose(push, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("course", "avoided_leds"),
    [
        ("any", {0, 1, 2, 3}),
        ("crossing", {0, 1, 3}),
        ("oncoming", {0}),
    ],
)
def test_the_led_that_is_seen_tells_the_course_of_a_neighbour(course, avoided_leds):
    strategy = StrategyConfig(avoidance_course=course)
    for led in range(4):
        is_avoided = push_on(0.3 * RADIUS, led=led, strategy=strategy).any()
        assert is_avoided == (led in avoided_leds)


def test_repulsion_by_priority_is_higher_at_every_distance():
    """Section 4.1: "higher repellent forces"; the distance to keep stays that of Table 2."""
    higher = []
    scaled = []
    for distance in np.linspace(0.05, 0.39, 8) * RADIUS:
        ordinary = push_on(distance)[0]
        higher.append(push_on(distance, priority=True, strategy=StrategyConfig())[0] / ordinary)
        scaled.append(push_on(distance, priority=True, strategy=INITIAL)[0] / ordinary)

    np.testing.assert_allclose(higher, 2.0, rtol=1e-5)
    assert min(scaled) < 1.0 < max(scaled)
    assert not push_on(0.41 * RADIUS, priority=True, strategy=StrategyConfig()).any()


def test_the_potential_never_ends_before_the_distance_to_keep():
    """It does not even for robots that keep more distance from priority than from others."""
    genome = replace(TYPE1, priority_coll_avoid_dist=0.9)
    is_loaded = np.array([False, True])
    priority = np.array([[False, True], [False, True]])
    for word in ("scaled", "higher"):
        rules = rules_of(genome, StrategyConfig(priority_repulsion=word))
        kept = kept_distances(rules, is_loaded, priority)
        np.testing.assert_allclose(kept.reach, [[0.65, 0.9], [0.25, 0.25]], rtol=1e-6)


def test_robots_that_follow_a_vector_ignore_walls():
    observation = senses_nothing(1)._replace(sees_wall=np.ones((1, 4), bool))
    follows = np.array([True])
    assert not np.asarray(avoidance_push_jit(rules_of(TYPE1, INITIAL), observation, follows)).any()
