"""What robots remember: learning, forgetting, disappointment, and random draws."""

import math
from dataclasses import replace

import jax
import numpy as np
import pytest
from scipy import stats
from support.controller import CONFIG, MANY, PROBE, ROBOT, RULES, STEP, act_here, draws, genes_read, memories
from support.sensing import remember, senses_nothing, turned

from iswarm_mj.geometry.robot import SIDES, Sides
from iswarm_mj.strategy.controller import draw
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.rules import rules_of
from iswarm_mj.strategy.vector_strategy import VectorStrategy

# What to remember


@pytest.mark.parametrize("quarters", [0, 1])
def test_robots_forget_then_listen_then_feel_where_they_are(quarters):
    """Robots 0 and 1 hear the same, and 0 forgets first; of the others, who hear nothing, 3 forgets and 4 is at dust.

    To dust, sides 1 and 3 offer the least hops, to the dump 2 and 3, of which draws take 3 and 2; what side 0 hears has
    no vectors. The LEDs look so many quarter turns to the left of the sides.
    """
    angle, distance, led = np.arange(4) * np.pi / 2 + 0.2, np.arange(4) + 3.0, np.array([3, 0, 1, 2])
    vectors, n = np.array([[9.0, 9], [3, -4], [5, 6], [-7, 8]]), 5

    def each(values):
        return np.stack([values] * n)

    seen = senses_nothing(n)._replace(
        is_heard=np.arange(4 * n).reshape(n, 4) < 8,
        at_dust=np.arange(n) == 4,
        **{name: each(values) for name, values in (("bearing", angle), ("distance", distance), ("led", led))},
    )
    dust, dump = (
        remember(each(sent), np.array(hop), np.arange(4) > 0)
        for sent, hop in ((vectors, [0, 2, 4, 2]), (-vectors, [0, 5, 1, 1]))
    )
    seen = seen._replace(payload=seen.payload | {"dust": dust, "dump": dump})
    own = memories(n, dust=[1.0, 1.0], dump=[2.0, -3.0])  # with no hop: what is heard is older
    ties = {"dust_tie": each([0, 0.6, 0.7, 0.5]), "dump_tie": each([0, 0.2, 0.3, 0.4])}
    numbers = draws(n, forget=[0.0, 1.0, 1.0, 0.0, 1.0])._replace(**ties)
    robot = replace(ROBOT, sides=Sides(SIDES[quarters:] + SIDES[:quarters], SIDES))
    memory = jax.jit(VectorStrategy(RULES, 0, CONFIG, robot).update_vectors)(own, seen, numbers)
    for found, vector, side, hop, kept in (
        (memory.dust, vectors[3], 3, 3, [[1, 1]] * 2 + [[0, 0]] * 2),
        (memory.dump, -vectors[2], 2, 2, [[2, -3]] * 2 + [[0, 0], [2, -3]]),
    ):
        to_sender = turned(np.array([distance[side], 0.0]), angle[side])
        heard = to_sender + turned(vector, angle[side] + np.pi - (led[side] + quarters) * np.pi / 2)
        np.testing.assert_allclose(found.vector, [heard, *kept], atol=1e-5)
        assert found.hop.tolist() == [hop, 0, 0, 0, 0] and found.known.tolist() == [True, True, True, False, True]


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
