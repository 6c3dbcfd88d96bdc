"""What robots remember: learning, forgetting, disappointment, and random draws."""

import math

import jax
import numpy as np
from helpers_controller import CONFIG, MANY, PROBE, RULES, STEP, act_here, draws, genes_read, memories
from helpers_sensing import remember, senses_nothing
from scipy import stats

from iswarm_mj.strategy.controller import draw, learn
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.rules import rules_of

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


def test_the_draws_of_a_step_are_independent():
    """What decides on dust says nothing on the dump, nor on where a robot wanders; each is uniform from 0 to 1."""
    numbers = np.concatenate([np.asarray(d).reshape(MANY, -1) for d in draw(MANY, 4, jax.random.key(6))], axis=1)
    assert numbers.shape == (MANY, 14)
    assert abs(np.corrcoef(numbers.T) - np.eye(14)).max() < 0.04
    numbers[:, 12:] = stats.norm.cdf(numbers[:, 12:])  # the errors of odometry are normal
    np.testing.assert_allclose(np.quantile(numbers, [0.25, 0.5, 0.75], axis=0).T, [[0.25, 0.5, 0.75]] * 14, atol=0.02)


def test_silent_sides_teach_nothing():
    seen = hears(3, 0, [0.0, 2.0], hop=3)._replace(is_heard=np.zeros((3, 4), bool))
    memory = learn_here(RULES, memories(3), seen, draws(3, forget=1.0))
    assert not memory.dust.known.any()


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
