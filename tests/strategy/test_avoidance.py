"""Collision avoidance: which distance is kept from whom, and how hard."""

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
avoid_here, repulsion_here = jax.jit(partial(avoidance_push, CONFIG)), jax.jit(repulsion)


@pytest.mark.parametrize(
    "preset, to_empty, to_flagged, of_loaded", [("type1", 0.65, 0.40, 0.25), ("type2", 0.77, 0.41, 0.27)]
)
def test_distances_of_table_2(preset, to_empty, to_flagged, of_loaded):
    kept = kept_distances(rules_of(PRESETS[preset]), np.array([False, True]), np.array([[False, True]] * 2))
    np.testing.assert_allclose(kept.threshold, [[to_empty, to_flagged], [of_loaded, of_loaded]], rtol=1e-6)


def test_push_is_straight_away_and_linear():
    bearing, shares = (
        a.ravel() for a in np.meshgrid(np.radians([0, 90, 180, 270, 33]), [0.0, 0.25, 0.9, 1.0, 1.5, 40.0])
    )
    away = -np.column_stack([np.cos(bearing), np.sin(bearing)])
    edge, one = np.full((30, 1), 0.65), np.ones((30, 1))
    push = repulsion_here(bearing[:, None], 0.65 * shares[:, None], KeptDistances(edge, edge), one)
    np.testing.assert_allclose(push, np.maximum(1 - shares, 0)[:, None] * away, atol=1e-6)


def test_pushes_add_up():
    bearing, near = np.array([[0.0, np.pi / 2, np.pi]]), np.array([[0.5, 0.5, 0.75]])
    push = repulsion_here(bearing, near, KeptDistances(*np.ones((2, 1, 3))), np.array([[1.0, 2.0, 1.0]]))
    np.testing.assert_allclose(push, [[-0.5 + 0.25, -1.0]], atol=1e-6)


def test_no_distance_to_keep_is_no_push():
    push = repulsion_here(np.zeros((1, 1)), np.full((1, 1), 0.1), KeptDistances(*np.zeros((2, 1, 1))), np.ones((1, 1)))
    np.testing.assert_allclose(push, 0, atol=1e-6)


INITIAL = StrategyConfig(avoidance_sides="all", priority_repulsion="scaled")


def pushed(distance, heard=True, priority=False, loaded=False, side=0, led=0, strategy=INITIAL):
    """Push on a robot by one neighbour on `side` at `distance` [mm], of which it sees `led`."""
    at, nothing = np.arange(4)[None] == side, senses_nothing(1)
    seen = nothing._replace(
        is_heard=at & heard,
        distance=np.where(at, np.float32(distance), nothing.distance),
        payload=nothing.payload | {"priority": at & priority},
        led=np.where(at, np.int32(led), nothing.led),
        is_loaded=np.array([loaded]),
    )
    return np.asarray(avoid_here(rules_of(PRESETS["type1"], strategy), seen, np.array([False])))[0]


def test_priority_doubles_the_push_on_a_loaded_robot():
    plain, flagged = (pushed(0.1 * RADIUS, priority=p, loaded=True) for p in (False, True))
    np.testing.assert_allclose(plain, [-8 * (1 - 0.1 / 0.25), 0], rtol=1e-5)
    np.testing.assert_allclose(flagged, 2 * plain, rtol=1e-6)
    configured = replace(INITIAL, priority_factor=5.0)
    np.testing.assert_allclose(pushed(0.1 * RADIUS, priority=True, loaded=True, strategy=configured), 5 * plain)


def test_an_empty_robot_lets_priority_come_closer_but_then_gives_way_more():
    assert not pushed(0.5 * RADIUS, priority=True).any()
    np.testing.assert_allclose(pushed(0.5 * RADIUS), [-8 * (1 - 0.5 / 0.65), 0], rtol=1e-5)
    np.testing.assert_allclose(pushed(0.2 * RADIUS, priority=True), [-8 * 2 * 0.5, 0], rtol=1e-5)


def test_who_is_not_heard_does_not_push():
    assert not pushed(0.1, heard=False, priority=True).any()


def test_only_the_front_counts_as_the_paper_says():
    """Section 4.1: all photodiodes are off but those on the front."""
    for side in range(4):
        assert pushed(0.3 * RADIUS, side=side, strategy=StrategyConfig()).any() == (side == 0)
        assert pushed(0.3 * RADIUS, side=side).any()


@pytest.mark.parametrize("sides, seen", [("front", [True, False, False, False]), ("all", [True] * 4)])
def test_walls_are_obstacles_too(sides, seen):
    """On a robot that follows no vector; [4, S] a wall on one side after the other."""
    rules = rules_of(PRESETS["type1"], StrategyConfig(avoidance_sides=sides))
    walls = senses_nothing(4)._replace(sees_wall=np.eye(4, dtype=bool))
    push = np.asarray(avoid_here(rules, walls, np.zeros(4, bool)))
    np.testing.assert_allclose(push, np.array(seen)[:, None] * [[-2, 0], [0, -2], [2, 0], [0, 2]], atol=1e-6)


@pytest.mark.parametrize(
    "course, leds", [("any", [1, 1, 1, 1]), ("crossing", [1, 1, 0, 1]), ("oncoming", [1, 0, 0, 0])]
)
def test_the_course_is_read_from_the_led_that_is_seen(course, leds):
    strategy = StrategyConfig(avoidance_course=course)
    assert [pushed(0.3 * RADIUS, led=led, strategy=strategy).any() for led in range(4)] == [bool(led) for led in leds]


def test_repulsion_by_priority_is_higher_at_every_distance():
    """Section 4.1: "higher repellent forces"; the distance to keep from them stays that of Table 2."""
    scaled, higher = [], []
    for share in np.linspace(0.05, 0.39, 8):
        plain = pushed(share * RADIUS)[0]
        higher.append(pushed(share * RADIUS, priority=True, strategy=StrategyConfig())[0] / plain)
        scaled.append(pushed(share * RADIUS, priority=True)[0] / plain)
    np.testing.assert_allclose(higher, 2.0, rtol=1e-5)
    assert min(scaled) < 1.0 < max(scaled)
    assert not pushed(0.41 * RADIUS, priority=True, strategy=StrategyConfig()).any()


def test_the_potential_never_ends_before_the_distance_to_keep():
    """Also of robots that keep more distance from priority than from others."""
    genome = replace(PRESETS["type1"], priority_coll_avoid_dist=0.9)
    loaded, flags = np.array([False, True]), np.array([[False, True]] * 2)
    for word in ("scaled", "higher"):
        reach = kept_distances(rules_of(genome, StrategyConfig(priority_repulsion=word)), loaded, flags).reach
        np.testing.assert_allclose(reach, [[0.65, 0.9], [0.25, 0.25]], rtol=1e-6)


def test_following_a_vector_walls_are_ignored():
    walls = senses_nothing(1)._replace(sees_wall=np.ones((1, 4), bool))
    assert not np.asarray(avoid_here(rules_of(PRESETS["type1"], INITIAL), walls, np.ones(1, bool))).any()
