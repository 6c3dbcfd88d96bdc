"""Tasks that add up their rewards."""

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.training import TRAINING, Three

from iswarm_mj.config.arena import ArenaConfig
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.search.training import train
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.base import overrides
from iswarm_mj.tasks.base import Quantity, Task, without_balls
from iswarm_mj.tasks.layout import place_robots
from iswarm_mj.tasks.rewarded import REWARD, RewardState, rewarded
from iswarm_mj.utils.errors import UserError
from iswarm_mj.workflows.rollout import rollout

N, STEPS = 5, 12


class Seen(NamedTuple):
    x: np.ndarray
    step: np.ndarray


@dataclass(frozen=True)
class Eastwards(Task):
    """Robots earn what they go to the right, the second one twice and so on; the third fails after five steps."""

    gain: float = 1.0

    def lay_out(self, config, n_robots, rng, shared, cell):
        poses = place_robots(config.arena, n_robots, rng, cell)
        return poses, Seen(poses[:, 0].astype(np.float32), np.zeros((), np.int32))

    def goal(self, config, n_robots):
        return None

    def advance(self, state, inputs, key):
        return Seen(inputs.poses[:, 0], state.step + 1), without_balls(len(inputs.poses))

    def survives(self, state):
        return (jnp.arange(len(state.x)) != 2) | (state.step < 5)

    def progress(self, state):
        return state.step

    def reward(self, before, after, inputs):
        return self.gain * (after.x - before.x) * (1 + jnp.arange(len(after.x)))

    def metrics(self, state):
        return {}


@pytest.fixture(scope="module")
def both():
    keys = jax.random.split(jax.random.key(3), 2)
    config = SwarmConfig(ArenaConfig(size=14, dust_area_offset=4, dust_area_size=3, n_dust=4))
    scenario = Scenario(config, robots=N, engine=PlanarSettings(1), worlds=keys, steps=STEPS)
    return [rollout(replace(scenario, task=task), poses_of=(0, 1)) for task in tasks()]


def tasks():
    plain = Eastwards(gain=0.5)
    return plain, rewarded(plain)


def test_the_rewards_of_all_robots_and_steps_are_added_up(both):
    x = both[1].poses[..., 0]
    expected = 0.5 * ((x[:, STEPS - 1] - x[:, 0]) * np.arange(1, N + 1)).sum(axis=1)
    assert np.abs(expected).min() > 0.5
    np.testing.assert_allclose(both[1].metrics[REWARD], expected, rtol=1e-4)


def test_robots_do_what_they_did(both):
    """The third robot stands still after it has failed."""
    np.testing.assert_array_equal(both[0].poses, both[1].poses)
    np.testing.assert_array_equal(both[0].delivered_after, both[1].delivered_after)
    moved = np.abs(np.diff(both[1].poses, axis=1)).sum(axis=(0, 3))
    assert (moved[5:, 2] == 0).all() and (moved[5:, 1] > 0).any()


class Everything(Eastwards):
    """Has all that a task may have."""

    measured: ClassVar = {"taken": Quantity("steps")}

    def metrics(self, state):
        return {"taken": state.step}

    def balls(self, state):
        return state.x[:2]

    def conditions(self, state, conditions):
        return conditions + state.step


def test_all_else_is_as_it_was():
    plain = Everything()
    wrapped = rewarded(plain)
    x = jnp.arange(4.0)
    before = Seen(x, jnp.int32(2))
    after = Seen(x**2, jnp.int32(7))
    earned = RewardState(after, jnp.float32(-3.5))
    for method in ("conditions", "survives", "balls"):
        assert overrides(wrapped, Task, method) and (method == "survives") == overrides(
            rewarded(Eastwards()), Task, method
        )
    assert wrapped.conditions(earned, 10) == plain.conditions(after, 10) == 17
    assert wrapped.progress(earned) == 7 and wrapped.balls(earned).tolist() == [0, 1]
    assert wrapped.survives(earned).tolist() == [True, True, False, True]
    rewards = wrapped.reward(RewardState(before, jnp.float32(1.0)), earned, None)
    np.testing.assert_array_equal(rewards, plain.reward(before, after, None))
    assert rewards[3] == 4 * 6
    assert wrapped.metrics(earned) == {"taken": 7, REWARD: -3.5}
    assert list(wrapped.measured) == ["taken", REWARD] and wrapped.measured[REWARD].low == -np.inf


class Wrong(Eastwards):
    """Loses a robot on the way."""

    def survives(self, state):
        return super().survives(state)[1:]


def test_errors_of_a_training_name_the_class_of_the_task(tmp_path):
    with pytest.raises(UserError, match=r"^Wrong\.survives must return bool\["):
        train(TRAINING, Three(jnp.zeros(3)), tmp_path, PlanarSettings(1), task=Wrong())
