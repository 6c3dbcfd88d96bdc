"""What robots remember: learning, forgetting, disappointment, and random draws."""

import math
from dataclasses import replace

import jax
import numpy as np
import pytest
from helpers_controller import CONFIG, MANY, PROBE, ROBOT, RULES, STEP, act_here, draws, genes_read, memories
from helpers_sensing import remember, senses_nothing, turned
from scipy import stats

from iswarm_mj.strategy.controller import draw, learn
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.utils.robot import SIDES, Sides

learn_here = jax.jit(learn)


# What to remember


def hears(n, side, vector, hop):
    """Each robot hears a neighbour 5 mm away on `side`, by its front LED, that knows a way to dust."""
    seen = senses_nothing(n)
    return seen._replace(
        is_heard=np.tile(np.arange(4) == side, (n, 1)),
        payload=seen.payload | {"dust": remember(np.broadcast_to(vector, (n, 4, 2)), hop)},
    )


def test_learning_is_forgetting_then_listening_then_feeling():
    seen = hears(3, 0, [0.0, 2.0], hop=3)._replace(at_dust=np.array([False, False, True]))
    before = memories(3, dust=[1.0, 1.0])  # hop count 0: what is heard is older
    memory = learn_here(RULES, before, seen, draws(3, forget=[1.0, 0.0, 0.0]))
    np.testing.assert_allclose(memory.dust.vector, [[1, 1], [5, -2], [0, 0]], atol=1e-5)
    np.testing.assert_array_equal(memory.dust.hop, [0, 4, 0])
    assert memory.dust.known.all() and not memory.dump.known.any()


@pytest.mark.parametrize("quarters", [0, 1])
def test_of_the_best_offers_a_draw_decides_and_each_is_read_by_its_side(quarters):
    """To dust, sides 1 and 3 offer the least hops, to the dump 2 and 3; what side 0 hears has no vectors.

    The LEDs look so many quarter turns to the left of the sides. The second robot hears nothing and learns nothing.
    """
    angle, distance, led = np.arange(4) * np.pi / 2 + 0.2, np.arange(4) + 3.0, np.array([3, 0, 1, 2])
    vectors = np.array([[9.0, 9], [3, -4], [5, 6], [-7, 8]])

    def sent(vectors, *hop):
        return remember(np.stack([vectors] * 2), np.array(hop), np.arange(4) > 0)

    seen = senses_nothing(2)._replace(
        is_heard=np.array([4 * [True], 4 * [False]]),
        **{name: np.stack([a] * 2) for name, a in (("bearing", angle), ("distance", distance), ("led", led))},
    )
    seen = seen._replace(payload=seen.payload | {"dust": sent(vectors, 0, 2, 4, 2), "dump": sent(-vectors, 0, 5, 1, 1)})
    known = [remember([[0.0, 0.0], own], [0, 6], np.array([False, True])) for own in ([1.0, 1.0], [2.0, -3.0])]
    ties = {"dust_tie": np.array([[0, 0.6, 0.7, 0.5]] * 2), "dump_tie": np.array([[0, 0.2, 0.3, 0.4]] * 2)}
    before, numbers = memories(2)._replace(dust=known[0], dump=known[1]), draws(2, forget=1.0)._replace(**ties)
    robot = replace(ROBOT, sides=Sides(SIDES[quarters:] + SIDES[:quarters], SIDES))
    memory = jax.jit(VectorStrategy(RULES, 0, CONFIG, robot)._remember)(before, seen, numbers)
    for found, own, vector, side, hop in (
        (memory.dust, known[0], vectors[3], 3, 3),
        (memory.dump, known[1], -vectors[2], 2, 2),
    ):
        to_sender = turned(np.array([distance[side], 0.0]), angle[side])
        expected = to_sender + turned(vector, angle[side] + np.pi - (led[side] + quarters) * np.pi / 2)
        np.testing.assert_allclose(found.vector, [expected, own.vector[1]], atol=1e-5)
        assert found.hop.tolist() == [hop, 6]


def test_the_draws_of_a_step_are_independent():
    """What decides on dust says nothing on the dump, nor on where a robot wanders; each is uniform from 0 to 1."""
    numbers = np.concatenate([np.asarray(d).reshape(MANY, -1) for d in draw(MANY, 4, jax.random.key(6))], axis=1)
    assert numbers.shape == (MANY, 14)
    assert abs(np.corrcoef(numbers.T) - np.eye(14)).max() < 0.04
    numbers[:, 12:] = stats.norm.cdf(numbers[:, 12:])  # the errors of odometry are normal
    np.testing.assert_allclose(np.quantile(numbers, [0.25, 0.5, 0.75], axis=0).T, [[0.25, 0.5, 0.75]] * 14, atol=0.02)


def test_robots_forget_both_vectors_at_the_evolved_rate():
    n = MANY
    memory, _ = act_here(
        CONFIG, PROBE, RULES, memories(n, dust=[60, 0], dump=[0, 60]), senses_nothing(n), jax.random.key(1)
    )
    np.testing.assert_array_equal(memory.dust.known, memory.dump.known)
    share = 1 - np.asarray(memory.dust.known).mean()
    assert abs(share - 0.29) < 4.5 * math.sqrt(0.29 * 0.71 / n)


def remembers(rules, vector, **senses):
    """Whether robots still know their ways to dust and to the dump after a step."""
    seen = senses_nothing(MANY)._replace(**{name: np.full(MANY, value) for name, value in senses.items()})
    memory, _ = act_here(CONFIG, PROBE, rules, memories(MANY, dust=vector, dump=vector), seen, jax.random.key(1))
    for part in (memory.dust, memory.dump):
        assert not np.asarray(part.vector)[~np.asarray(part.known)].any()
    dust, dump = (set(np.asarray(memory.known).tolist()) for memory in (memory.dust, memory.dump))
    return dust, dump


def test_a_vector_that_led_to_nothing_is_forgotten():
    never = Genome(p_vector_forget=0.0)
    usual, patient = rules_of(never), genes_read(never, forget_on_arrival=False)
    near, far, yes, no = [0.4 * STEP, 0.0], [0.6 * STEP, 0.0], {True}, {False}
    assert remembers(usual, near) == (no, no)
    assert remembers(usual, far) == (yes, yes)
    assert remembers(patient, near) == (yes, yes)
    assert remembers(usual, near, at_dust=True) == (yes, no)
    assert remembers(usual, near, on_dump=True) == (no, yes)
