"""What robots of a world decide: symmetries, what they sense and carry, errors of their actuators."""

import jax
import jax.numpy as jnp
import numpy as np
from helpers_controller import CONFIG, MANY, PROBE, RULES, act_here, approach_with, strategy
from helpers_sensing import remember, senses_nothing

from iswarm_mj.strategy.controller import (
    RobotMemory,
    approaching,
    avoid,
    choose,
    draw,
    learn,
    steer,
)

# Nobody knows more than it senses


def crowded(n, rng):
    """Random memories and observations of n robots."""

    def some(share, *shape):
        return jnp.asarray(rng.random((n, *shape)) < share)

    def memory(*shape):
        return remember(rng.uniform(-30, 30, (n, *shape, 2)), rng.integers(0, 12, (n, *shape)), some(0.7, *shape))

    seen = senses_nothing(n)._replace(
        is_heard=some(0.7, 4),
        distance=jnp.asarray(rng.uniform(2, 9.9, (n, 4)), jnp.float32),
        led=jnp.asarray(rng.integers(0, 4, (n, 4))),
        payload={"priority": some(0.3, 4), "dust": memory(4), "dump": memory(4)},
        sees_wall=some(0.2, 4),
        at_dust=some(0.3),
        ball_vector=jnp.asarray(rng.uniform(-1.5, 1.5, (n, 2)), jnp.float32),
        on_dump=some(0.2),
        is_loaded=some(0.4),
        grasp_failed=some(0.2),
    )
    return RobotMemory(memory(), memory(), some(0.2)), seen


def test_relabelled_robots_do_the_same():
    n, rng = 64, np.random.default_rng(2)
    memory, seen = crowded(n, rng)
    numbers = draw(n, 4, jax.random.key(6))

    @jax.jit
    def step(memory, seen, numbers):
        memory = learn(RULES, memory, seen, numbers)
        wanted, limit, follows = choose(CONFIG, RULES, memory, seen, numbers)
        command = steer(CONFIG, wanted + avoid(CONFIG, RULES, seen, follows), limit, numbers.side < 0.5)
        comes = approaching(strategy().picks(memory), seen)
        return (
            memory,
            follows,
            command,
            approach_with(CONFIG, PROBE, comes, seen.ball_vector, command),
        )

    new = rng.permutation(n)
    after = step(*jax.tree.map(lambda a: np.asarray(a)[new], (memory, seen, numbers)))
    expected = jax.tree.map(lambda a: np.asarray(a)[new], step(memory, seen, numbers))
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-6), after, expected)
    assert 5 < np.asarray(expected[1]).sum() < n - 5


def test_a_robot_does_not_know_what_others_sense():
    rng = np.random.default_rng(3)
    one, other = crowded(MANY, rng), crowded(MANY, rng)
    mixed = jax.tree.map(lambda a, b: np.concatenate([a[:1], b[1:]]), *jax.tree.map(np.asarray, (one, other)))
    alone, among = (act_here(CONFIG, PROBE, RULES, *who, jax.random.key(0)) for who in (one, mixed))
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(np.asarray(a)[0], np.asarray(b)[0]), alone, among)
    assert (np.asarray(alone[1].turn)[1:] != np.asarray(among[1].turn)[1:]).any()
