"""Policies, tasks and files with which nothing can be trained: one sentence, and nothing that stays behind."""

from dataclasses import dataclass, field, replace

import jax.numpy as jnp
import numpy as np
import pytest
from helpers_training import SMALL, TRAINING, Three, pretend

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.experiments.runner.training import CURVE, WEIGHTS, Training, points, policy, train
from iswarm_mj.tasks.aggregation import Aggregation
from iswarm_mj.tasks.cleaning import CLEANING, Cleaning
from iswarm_mj.tasks.rewarded import REWARD, rewarded
from iswarm_mj.utils.errors import UserError
from iswarm_mj.workflows.rollout import Rollout

NONE = np.zeros(2)
FOUND = Rollout(
    NONE, NONE, NONE, NONE, NONE > 1, NONE, NONE[:1], NONE[:, None], None, [], {REWARD: np.array([1.0, np.nan])}
)


@pytest.fixture
def out(monkeypatch, tmp_path):
    """Where a training of five generations has ended."""
    pretend(monkeypatch)
    train(TRAINING, Three(jnp.zeros(3)), tmp_path / "out", PlanarSettings(1), task=CLEANING)
    return tmp_path / "out"


def test_fewer_generations_than_there_are_leave_all_as_it_is(out):
    before = {name: (out / name).read_bytes() for name in (WEIGHTS, CURVE)}
    with pytest.raises(UserError, match="generations must be at least 5, which the training has"):
        fewer = replace(TRAINING, generations=4)
        train(fewer, Three(jnp.zeros(3)), out, PlanarSettings(1), task=CLEANING)
    assert before == {name: (out / name).read_bytes() for name in before}


def test_other_weights_at_the_start_are_another_training(out):
    with pytest.raises(UserError, match="different settings"):
        train(TRAINING, Three(jnp.array([0.0, 1.0, 0.0])), out, PlanarSettings(1), task=CLEANING)


@pytest.mark.parametrize("first", [[0.5], [0.0, np.nan], [np.inf, 0.0], [2e6, 0.0]])
def test_weights_that_no_search_can_begin_with(first):
    with pytest.raises(UserError, match="weights must be"):
        policy(Three(jnp.array(first)), TRAINING.config, 4)


@dataclass
class Strict(Three):
    weights: object = field(init=False)

    def __post_init__(self):
        self.weights = jnp.zeros(3)


def test_weights_need_not_pass_through_init(monkeypatch, tmp_path):
    """Those of many worlds at once may have a shape that a class refuses."""
    asked = pretend(monkeypatch)
    train(replace(TRAINING, generations=1), Strict(), tmp_path, PlanarSettings(1), task=CLEANING)
    assert asked[0].shape == (8, 3)


class Balls:
    """A task with a fitness but no balls."""

    fitness = Cleaning.fitness


class Wrong(Cleaning):
    def fitness(self, measures, config, n_robots, steps):
        raise ValueError("no idea")


class Unequal(Aggregation):
    """Its state has a number for each robot."""

    def lay_out(self, config, n_robots, rng, shared, cell):
        poses, spots = super().lay_out(config, n_robots, rng, shared, cell)
        return poses, spots._replace(shares=np.zeros(n_robots, np.float32))

    def advance(self, state, inputs, key):
        _, sensed = super().advance(state, inputs, key)
        return state, sensed


class Heard(Aggregation):
    def reward(self, before, after, inputs):
        return inputs.command.forward


@pytest.mark.parametrize(
    ("task", "robots", "sentence"),
    [
        (Balls(), (4,), "Balls has a fitness, .* no method balls"),
        (Wrong(), (4,), r"Wrong.fitness raised ValueError: no idea"),
        (Unequal(), (4, 3), "Unequal has other shapes in worlds with other numbers of robots"),
        (Heard(), (4,), "Heard.reward, here without commands and messages, raised AttributeError"),
    ],
)
def test_tasks_that_cannot_be_scored(task, robots, sentence, tmp_path):
    """Nothing stays behind, so that the next training may have the place."""
    few = replace(TRAINING, config=SwarmConfig(), robots=robots, steps=1, generations=1, population=2)
    with pytest.raises(UserError, match=sentence):
        train(few, Three(jnp.zeros(3)), tmp_path / "out", PlanarSettings(1), task=task)
    assert not list((tmp_path / "out").glob("*.*"))


def test_rewards_that_are_no_numbers(monkeypatch, tmp_path):
    monkeypatch.setattr("iswarm_mj.experiments.runner.training.rollout", lambda *_, **__: FOUND)
    few = replace(TRAINING, population=2, worlds=1)
    with pytest.raises(UserError, match="rewards of Aggregation are nan in a world"):
        train(few, Three(jnp.zeros(3)), tmp_path, PlanarSettings(1), task=Aggregation())
    np.testing.assert_array_equal(points(FOUND, rewarded(Aggregation()), TRAINING.config, [4, 4], 10), [1, np.nan])


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"robots": ()}, "robots must be between 1 and 2 numbers"),
        ({"robots": (4, 5, 6)}, "robots must be between 1 and 2 numbers, since a candidate has 2 worlds"),
        ({"robots": (4000,)}, "robots"),
        ({"sizes": (15.0, 9.0)}, "^sizes"),
        ({"spread": 0.0}, "^spread"),
        ({"sizes": (15.0, 10.5)}, "dust_area_offset"),
    ],
)
def test_worlds_that_cannot_be_are_refused_at_once(changed, sentence):
    with pytest.raises(UserError, match=sentence):
        replace(TRAINING, **changed)


def test_a_candidate_may_have_a_world_for_each_number_of_robots():
    assert replace(TRAINING, robots=(4, 5)).robots == (4, 5) and Training().worlds >= len(Training().robots)


@pytest.mark.parametrize("weights", [None, 3.0, [1.0], {}, jnp.zeros(3, int), [jnp.zeros(3), jnp.zeros(3, int)]])
def test_strategies_without_weights_are_refused(weights):
    with pytest.raises(UserError, match="Three has no weights to train"):
        policy(Three(weights), SMALL, 4)
    with pytest.raises(UserError, match="weights must be between 2"):
        policy(Three(jnp.zeros(0)), SMALL, 4)
