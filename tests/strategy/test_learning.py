"""Memories of robots in a step: forgetting, listening, sensing the floor, and random draws."""

import math
from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy import stats
from support.controller import (
    CONFIG,
    MANY,
    PROBE,
    ROBOT,
    RULES,
    STEP,
    act_here,
    draws,
    genes_read,
    memories,
)
from support.sensing import remember, senses_nothing, turned

from iswarm_mj.geometry.robot import SIDES, Sides
from iswarm_mj.strategy.controller import draw
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.vector_strategy import VectorStrategy

# What to remember


@pytest.mark.parametrize("quarters", [0, 1])
def test_robots_forget_then_listen_then_feel_where_they_are(quarters):
    """A step by hand, for five robots that know a vector to dust and one to the dump.

    Robots 0 and 1 hear the same, and 0 forgets first. The others hear nothing; 3 forgets, and 4 is
    at dust. Side 0 hears no vectors. To dust, sides 1 and 3 offer the fewest hops, of which the
    draws take 3; to the dump, sides 2 and 3 do, of which the draws take 2.

    The LEDs look `quarters` quarter turns to the left of the sides.
    """
    n_robots = 5

    def for_each(values):
        """Return the same values for all robots."""
        return np.stack([values] * n_robots)

    # What each side hears.
    bearing = np.arange(4) * np.pi / 2 + 0.2
    distance = np.arange(4) + 3.0
    led = np.array([3, 0, 1, 2])
    sends_vector = np.array([False, True, True, True])
    to_dust = np.array([[9.0, 9], [3, -4], [5, 6], [-7, 8]])
    to_dump = -to_dust
    dust_hops = np.array([0, 2, 4, 2])
    dump_hops = np.array([0, 5, 1, 1])

    robots = np.arange(n_robots)
    observation = senses_nothing(n_robots)
    observation = observation._replace(
        is_heard=np.tile(robots[:, None] < 2, 4),
        bearing=for_each(bearing),
        distance=for_each(distance),
        led=for_each(led),
        at_dust=robots == 4,
        payload=observation.payload
        | {
            "dust": remember(for_each(to_dust), dust_hops, sends_vector),
            "dump": remember(for_each(to_dump), dump_hops, sends_vector),
        },
    )
    numbers = draws(n_robots, forget=[0.0, 1.0, 1.0, 0.0, 1.0])._replace(
        dust_tie=for_each([0, 0.6, 0.7, 0.5]),
        dump_tie=for_each([0, 0.2, 0.3, 0.4]),
    )
    # Their own vectors have no hops, fewer than those that robot 1 hears.
    known = memories(n_robots, dust=[1.0, 1.0], dump=[2.0, -3.0])

    leds = SIDES[quarters:] + SIDES[:quarters]
    robot = replace(ROBOT, sides=Sides(leds, SIDES))
    update_vectors = jax.jit(VectorStrategy(RULES, 0, CONFIG, robot).update_vectors)
    memory = update_vectors(known, observation, numbers)

    def heard(vector, side):
        """Return the vector that a side heard, in the receiver's frame."""
        to_sender = turned(np.array([distance[side], 0.0]), bearing[side])
        psi = bearing[side] + np.pi - (led[side] + quarters) * np.pi / 2
        return to_sender + turned(vector, psi)

    dust = [heard(to_dust[3], side=3), [1, 1], [1, 1], [0, 0], [0, 0]]
    np.testing.assert_allclose(memory.dust.vector, dust, atol=1e-5)
    assert memory.dust.hop.tolist() == [3, 0, 0, 0, 0]
    assert memory.dust.known.tolist() == [True, True, True, False, True]

    dump = [heard(to_dump[2], side=2), [2, -3], [2, -3], [0, 0], [2, -3]]
    np.testing.assert_allclose(memory.dump.vector, dump, atol=1e-5)
    assert memory.dump.hop.tolist() == [2, 0, 0, 0, 0]
    assert memory.dump.known.tolist() == [True, True, True, False, True]


def test_the_draws_of_a_step_are_independent():
    """Each is uniform from 0 to 1, or standard normal, and says nothing about the others."""
    step_draws = draw(MANY, 4, jax.random.key(6))
    numbers = np.concatenate([np.asarray(part).reshape(MANY, -1) for part in step_draws], axis=1)
    n_draws = 14
    assert numbers.shape == (MANY, n_draws)
    assert abs(np.corrcoef(numbers.T) - np.eye(n_draws)).max() < 0.04

    numbers[:, 12:] = stats.norm.cdf(numbers[:, 12:])  # the errors of odometry are normal
    quartiles = np.quantile(numbers, [0.25, 0.5, 0.75], axis=0).T
    np.testing.assert_allclose(quartiles, [[0.25, 0.5, 0.75]] * n_draws, atol=0.02)


def test_robots_forget_both_vectors_at_the_evolved_rate():
    known = memories(MANY, dust=[60, 0], dump=[0, 60])
    key = jax.random.key(1)
    memory, _ = act_here(CONFIG, PROBE, RULES, known, senses_nothing(MANY), key)

    np.testing.assert_array_equal(memory.dust.known, memory.dump.known)
    rate = 0.29
    forgotten = 1 - np.asarray(memory.dust.known).mean()
    assert abs(forgotten - rate) < 4.5 * math.sqrt(rate * (1 - rate) / MANY)


def known_after_step(rules, vector, **senses):
    """Return which robots still know their ways to dust and to the dump after a step.

    Args:
        rules: genome and interpretations.
        vector: vector to dust, and to the dump, before the step [mm].
        senses: what all robots sense, by names of `Observation`.
    """
    observation = senses_nothing(MANY)
    for name, value in senses.items():
        observation = observation._replace(**{name: np.full(MANY, value)})
    known = memories(MANY, dust=vector, dump=vector)
    memory, _ = act_here(CONFIG, PROBE, rules, known, observation, jax.random.key(1))

    for place in (memory.dust, memory.dump):
        is_unknown = ~np.asarray(place.known)
        assert not np.asarray(place.vector)[is_unknown].any()
    return set(memory.dust.known.tolist()), set(memory.dump.known.tolist())


def test_a_vector_that_led_to_nothing_is_forgotten():
    never_at_random = Genome(p_vector_forget=0.0)
    forgets_on_arrival = rules_of(never_at_random)
    patient = genes_read(never_at_random, forget_on_arrival=False)
    near = [0.4 * STEP, 0.0]
    far = [0.6 * STEP, 0.0]
    all_know = {True}
    none_knows = {False}

    assert known_after_step(forgets_on_arrival, near) == (none_knows, none_knows)
    assert known_after_step(forgets_on_arrival, far) == (all_know, all_know)
    assert known_after_step(patient, near) == (all_know, all_know)
    assert known_after_step(forgets_on_arrival, near, at_dust=True) == (all_know, none_knows)
    assert known_after_step(forgets_on_arrival, near, on_dump=True) == (none_knows, all_know)
