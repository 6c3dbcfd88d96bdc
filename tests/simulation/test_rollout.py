"""Rollouts of one's own strategy: what the arrays say, which worlds meet, and what is refused."""

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.sensors.messages import Message
from iswarm_mj.simulation import initial as layout
from iswarm_mj.simulation import run_mjx as batched
from iswarm_mj.simulation.rollout import paper_strategy, rollout
from iswarm_mj.strategy.controller import Command
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.errors import UserError

KEYS = jax.random.split(jax.random.key(7), 3)


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Straight:
    """Ahead by `stride` [mm] in each step, in silence; remembers the number of steps."""

    stride: jax.Array

    def init(self, n_robots, key):
        return jnp.zeros(n_robots, jnp.int32)

    def say(self, memory, is_loaded):
        empty = VectorMemory.empty(len(memory))
        return Message(jnp.zeros_like(memory), jnp.zeros_like(is_loaded), empty, empty)

    def picks(self, memory):
        return memory < 0

    def act(self, memory, seen, key):
        return memory + 1, Command(jnp.zeros(len(memory)), jnp.broadcast_to(self.stride, memory.shape))


@pytest.fixture(scope="module")
def alone(small):
    strides = Straight(jnp.array([0.0, 0.2, -0.4]))
    return rollout(small, strides, KEYS, n_robots=1, steps=7, every=5, strategy_per_world=True, poses_of=(2, 0, 1))


class TestOneRobot:
    """A single robot that goes straight ahead, where all is known."""

    def test_each_world_has_its_strategy(self, alone):
        poses = alone.poses
        assert poses.shape == (3, 8, 1, 3)
        for row, stride in enumerate((-0.4, 0.0, 0.2)):
            start = poses[row, 0, 0]
            ahead = np.array([np.cos(start[2]), np.sin(start[2])])
            expected = start[:2] + np.outer(np.arange(8) * stride, ahead)
            np.testing.assert_allclose(poses[row, :, 0, :2], expected, atol=2e-5)

    def test_worlds_begin_as_their_keys_say(self, alone, small):
        for row, world in enumerate((2, 0, 1)):
            rng = np.random.default_rng(np.asarray(jax.random.key_data(KEYS[world])))
            layout.draw_radii(small.arena, rng)
            start = layout.place_robots(small.arena, 1, rng)
            np.testing.assert_array_equal(alone.poses[row, 0], start.astype(np.float32))

    def test_other_values_need_no_compilation(self, alone, small):
        before = batched._chunk._cache_size()
        strides = Straight(jnp.full(3, 0.1))
        rollout(small, strides, KEYS, n_robots=1, steps=4, every=5, strategy_per_world=True, poses_of=(0, 1, 2))
        rollout(small, Straight(jnp.float32(0.3)), KEYS, n_robots=1, steps=4, every=5, poses_of=(0, 1, 2))
        assert batched._chunk._cache_size() == before

    def test_nothing_is_picked_or_hit(self, alone):
        assert alone.steps.tolist() == [5, 7]
        for counts in (alone.delivered, alone.picked, alone.collisions, alone.finished_at):
            assert counts.tolist() == [0, 0, 0]
        assert alone.delivered_after.tolist() == [[0, 0]] * 3
        assert np.isnan(alone.mean_carriage_steps).all() and not alone.is_finished.any()


def papers(small, keys):
    strategy = paper_strategy(small, PRESETS["type1"], 30)
    return rollout(small, strategy, keys, n_robots=30, steps=40, every=10, stop_at=3)


@pytest.fixture(scope="module")
def swarm(small):
    return papers(small, KEYS)


class TestSwarm:
    """The paper's strategy in three worlds."""

    def test_counts_fit_together(self, swarm):
        assert swarm.poses is None and swarm.delivered_after.shape == (3, 4)
        assert (np.diff(swarm.delivered_after, axis=1) >= 0).all()
        np.testing.assert_array_equal(swarm.delivered_after[:, -1], swarm.delivered)
        assert (swarm.delivered <= swarm.picked).all() and swarm.picked.min() > 0 and swarm.collisions.min() > 0
        np.testing.assert_array_equal(swarm.is_finished, swarm.delivered >= 3)
        assert swarm.is_finished.any()
        for world in np.flatnonzero(swarm.is_finished):
            late = swarm.steps >= swarm.finished_at[world]
            np.testing.assert_array_equal(swarm.delivered_after[world] >= 3, late)
        np.testing.assert_array_equal(np.isnan(swarm.mean_carriage_steps), swarm.delivered == 0)

    def test_a_world_is_its_key(self, small, swarm):
        again = papers(small, KEYS[::-1])
        for mine, its in zip(swarm, again, strict=True):
            if mine is not None and len(mine) == 3:
                np.testing.assert_array_equal(mine, its[::-1])
        assert len(set(map(tuple, swarm.delivered_after.tolist()))) > 1 or len(set(swarm.collisions)) > 1


def broken(**methods):
    """A `Straight` of which some methods are others."""
    return type("Broken", (Straight,), methods)(jnp.float32(0.1))


@pytest.mark.parametrize(
    "strategy, words",
    [
        (broken(), "Broken where JAX expects an array"),
        (Straight(jnp.zeros(2)), "first axis is that of the 3 worlds"),
    ],
)
def test_strategies_that_are_no_arrays_of_worlds(small, strategy, words):
    with pytest.raises(UserError, match=words):
        rollout(small, strategy, KEYS, n_robots=2, steps=1, strategy_per_world=True)


@pytest.mark.parametrize(
    "methods, words",
    [
        ({"act": lambda s, m, seen, key: (m * 1.0, Command(m * 0.1, m * 0.1))}, r"its memory .*got float32\[2"),
        ({"act": lambda s, m, seen, key: (m[:, None], Command(m * 0.1, m * 0.1))}, r"memory .*got int32\[2, 1\]"),
        ({"act": lambda s, m, seen, key: ((m, m), Command(m * 0.1, m * 0.1))}, "got tuple of 2 arrays"),
        ({"act": lambda s, m, seen, key: (m, Command(m, m * 0.1))}, r"turn of its command \(got int32"),
        ({"act": lambda s, m, seen, key: (m, Command(m * 0.1, jnp.zeros(())))}, r"forward of its .*got float32\[\]"),
        ({"act": lambda s, m, seen, key: Command(m * 0.1, m * 0.1)._asdict()}, "act must .*got a dict"),
        ({"picks": lambda s, m: m}, r"picks must return bool\[2\] as its result \(got int32"),
        ({"say": lambda s, m, is_loaded: m}, "say must return Message .*got an array"),
    ],
)
def test_what_methods_return_is_checked(small, methods, words):
    cls = jax.tree_util.register_dataclass(dataclass(frozen=True)(type("Own", (Straight,), methods)))
    with pytest.raises(UserError, match=words):
        rollout(small, cls(jnp.float32(0.1)), KEYS, n_robots=2, steps=1)


@pytest.mark.parametrize(
    "keys, words",
    [
        (jax.random.key(0), r"was key<fry>\[\]"),
        (KEYS.reshape(3, 1), r"was key<fry>\[3, 1\]"),
        (KEYS[:0], r"was key<fry>\[0\]"),
        (jax.random.key_data(KEYS), r"was uint32\[3, 2\]"),
        ([1, 2], "was a list"),
    ],
)
def test_keys_are_one_for_each_world(small, keys, words):
    with pytest.raises(UserError, match=words):
        rollout(small, Straight(jnp.float32(0.1)), keys, n_robots=2, steps=1)


@pytest.mark.parametrize("more", [{"n_robots": 1000}, {"steps": 0}, {"every": 0}, {"impl": "c"}, {"poses_of": (3,)}])
def test_numbers_that_do_not_fit(small, more):
    settings = {"n_robots": 2, "steps": 1} | more
    with pytest.raises(UserError, match=r"^[a-z_]+ must be .* \(got "):
        rollout(small, Straight(jnp.float32(0.1)), KEYS, **settings)
