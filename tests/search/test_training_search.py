"""The search for weights: worlds of its candidates, its curve, and which weights it keeps."""

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow.csv
import pytest
from support.robots import robot_file, two_kinds
from support.training import GOAL, SMALL, TRAINING, Three, pretend, trained

from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.robot_file import read_robots
from iswarm_mj.search import training
from iswarm_mj.search.training import CURVE, WEIGHTS, policy, train
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.network import load_weights
from iswarm_mj.strategy.neural import Neural
from iswarm_mj.tasks.aggregation import Aggregation
from iswarm_mj.tasks.cleaning import CLEANING, Cleaning
from iswarm_mj.tasks.rewarded import REWARD
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.workflows.rollout import Rollout

pytestmark = pytest.mark.usefixtures("few_pixels")
PLANAR = PlanarSettings(1)


@pytest.fixture
def out(tmp_path):
    """Return a directory that does not exist yet."""
    return tmp_path / "out"


class Trial(NamedTuple):
    """A rollout that was asked for."""

    scenario: Scenario
    weights: np.ndarray
    """Weights of each world (B, 3)."""
    keys: np.ndarray
    """Data of the random key of each world (B, 2)."""


class Rollouts:
    """A stand-in for rollouts, which notes them and may change their outcomes."""

    def __init__(self, rollout):
        self.trials = []
        self.change = lambda outcomes, n_worlds: outcomes
        self._rollout = rollout

    def __call__(self, scenario, **options):
        keys = np.array([jax.random.key_data(world.key) for world in scenario.worlds])
        self.trials.append(Trial(scenario, np.asarray(scenario.strategy.weights), keys))
        return self.change(self._rollout(scenario, **options), len(keys))


@pytest.fixture
def rollouts(monkeypatch):
    """Return pretended rollouts: the nearer weights are to a goal, the more balls."""
    pretend(monkeypatch)
    stand_in = Rollouts(training.rollout)
    monkeypatch.setattr(training, "rollout", stand_in)
    return stand_in


def empty_rollout(n_worlds, **outcomes):
    """Return a rollout in which nothing happened but some outcomes."""
    zeros = np.zeros(n_worlds)
    nothing = Rollout(
        delivered=zeros,
        picked=zeros,
        collisions=zeros,
        mean_carriage_steps=zeros,
        is_finished=zeros > 1,
        finished_at=np.full(n_worlds, np.nan),
        steps=zeros,
        delivered_after=np.zeros((n_worlds, 1)),
        poses=None,
        faults=[],
        metrics={},
    )
    return nothing._replace(**outcomes)


def curve(out):
    """Return the rows of the curve of a training."""
    return pyarrow.csv.read_csv(out / CURVE).to_pylist()


def test_tasks_without_a_fitness_are_trained_by_their_rewards(monkeypatch, out):
    """Rewards grow towards a goal, and the search comes near it."""

    def rollout(scenario, **_):
        assert isinstance(scenario.task.wrapped_task, Aggregation)
        assert REWARD in scenario.task.measured
        distances = np.abs(np.asarray(scenario.strategy.weights) - GOAL).sum(axis=1)
        return empty_rollout(scenario.n_worlds, metrics={REWARD: 10 - distances})

    monkeypatch.setattr(training, "rollout", rollout)
    long = replace(TRAINING, generations=60, population=8, spread=0.3)
    weights = train(long, Three(jnp.zeros(3)), out, PLANAR, task=Aggregation())
    assert np.abs(weights - GOAL).max() < 0.05


class TestWorlds:
    def test_candidates_of_a_generation_have_the_same_and_other_generations_others(
        self, rollouts, tmp_path
    ):
        """They also differ from those of another seed."""
        keys_of_seeds = []
        weights_of_seeds = []
        for seed in (3, 4):
            rollouts.trials.clear()
            trained(tmp_path / str(seed), replace(TRAINING, seed=seed))

            # Axes: generation, candidate, world, and the data of a key or the weights.
            keys = np.array([trial.keys for trial in rollouts.trials]).reshape(5, 4, 2, 2)
            assert (keys == keys[:, :1]).all()
            weights = np.array([trial.weights for trial in rollouts.trials]).reshape(5, 4, 2, 3)
            assert (weights == weights[:, :, :1]).all()
            assert len(np.unique(weights.reshape(-1, 3), axis=0)) == 20
            keys_of_seeds.append(keys[:, 0].reshape(-1, 2))
            weights_of_seeds.append(weights)
        assert len(np.unique(np.concatenate(keys_of_seeds), axis=0)) == 20
        assert (weights_of_seeds[0] != weights_of_seeds[1]).all()

    def test_they_have_the_numbers_of_robots_and_the_arenas_in_turn(self, rollouts, out):
        """Each is judged by its own; an unfinished one has no step in which it was finished."""
        judged = []

        class Judging(Cleaning):
            def fitness(self, measures, config, n_robots, steps):
                judged.append((config.arena.size, n_robots, steps, measures.finished_at))
                return 0.0

        def finish_every_second(outcomes, _):
            return outcomes._replace(
                is_finished=np.tile([False, True], 4), finished_at=np.tile([np.nan, 7.0], 4)
            )

        rollouts.change = finish_every_second
        wanted = replace(TRAINING, robots=(4, 9), sizes=(15.0, 30.0), steps=60, generations=1)
        train(wanted, Three(jnp.zeros(3)), out, PLANAR, task=Judging())

        small, large = rollouts.trials
        assert small.scenario.config.arena.size == 15
        assert large.scenario.config.arena.size == 30
        assert [world.n_robots for world in small.scenario.worlds] == 4 * [4, 9]
        assert [world.n_robots for world in large.scenario.worlds] == 4 * [16, 36]
        assert (small.keys == large.keys).all()
        in_small = [(15, 4, 60, None), (15, 9, 60, 7)]
        in_large = [(30, 16, 60, None), (30, 36, 60, 7)]
        assert judged == 4 * in_small + 4 * in_large


def test_validations_choose_the_weights(rollouts, out):
    """Here the mean of generation 20 does better in its worlds than that of generation 30."""
    validations = []

    def change(outcomes, n_worlds):
        if n_worlds != 7:
            return outcomes
        validations.append(rollouts.trials[-1])
        balls = (100, 90_000, 500)[len(validations) - 1]
        return outcomes._replace(picked=np.full(7, balls))

    rollouts.change = change
    wanted = replace(TRAINING, generations=33, validation=7)
    weights = trained(out, wanted)
    first, second, third = validations
    np.testing.assert_array_equal(weights, second.weights[0])

    # All have the same worlds, which differ from each other.
    assert len(np.unique(first.keys, axis=0)) == 7
    assert (second.keys == first.keys).all()
    assert (third.keys == first.keys).all()

    rows = curve(out)
    validated = [row["generation"] for row in rows if row["validation"] is not None]
    assert validated == [10, 20, 30]
    assert rows[19]["validation"] > rows[29]["validation"]
    np.testing.assert_array_equal(trained(out, wanted), weights)


def test_points_that_are_no_numbers_are_refused(rollouts, out):
    rollouts.change = lambda outcomes, n: outcomes._replace(picked=np.full(n, np.nan))
    with pytest.raises(UserError, match="rewards of Cleaning are nan in a world"):
        trained(out)


def test_the_curve_by_hand(monkeypatch, out):
    """One generation of 4 candidates with 2 worlds in each of 2 arenas.

    Points are 20 for each ball picked up, 20 for each delivered and 40 for the mean progress, less
    0.05 for each collision a robot. The last world of the second arena is at fault.
    """
    candidates = []
    picked_in_first = np.array([1, 4, 6, 0, 2, 2, 5, 3])
    picked = np.stack([picked_in_first, picked_in_first + 4])
    delivered = picked // 2
    collisions = np.stack([np.arange(8), 3 * np.arange(8)])
    faults = ([], [SimulationFault(world=7)])

    def rollout(scenario, **_):
        candidates.append(np.asarray(scenario.strategy.weights)[::2])
        arena = 0 if scenario.config.arena.size == 15 else 1
        progress = np.stack([np.zeros(8), delivered[arena]], axis=1)
        return empty_rollout(
            8,
            delivered=delivered[arena],
            picked=picked[arena],
            collisions=collisions[arena],
            delivered_after=progress,
            faults=faults[arena],
        )

    monkeypatch.setattr(training, "rollout", rollout)
    trained(out, replace(TRAINING, sizes=(15.0, 30.0), generations=1))

    n_robots = np.array([[4], [16]])
    points = 20 * picked + 40 * delivered - 0.05 * collisions / n_robots
    fitness = points.reshape(2, 4, 2).mean(axis=(0, 2))
    expected = {
        "generation": 1,
        "best": fitness.max(),
        "mean": fitness.mean(),
        "worst": fitness.min(),
        "picked": picked.mean(),
        "delivered": delivered.mean(),
        "collisions": collisions.mean(),
        "faults": 1 / 16,
        "validation": None,
        "spread": candidates[0].astype(float).std(axis=0).mean(),
    }
    (row,) = curve(out)
    assert list(row) == list(expected)
    assert row.pop("validation") is expected.pop("validation")
    assert row == pytest.approx(expected, rel=1e-5)


class TestStrategies:
    def test_the_robot_is_that_of_the_file_or_files(self, rollouts, tmp_path, out):
        """It counts in the worlds, in the strategy, and as a setting of the training."""
        path = robot_file(tmp_path, "five")
        trained(out, robot_file=path)
        assert [trial.scenario.robot_file for trial in rollouts.trials] == 5 * [path]
        assert policy(Neural(), SMALL, 4, path).robot == read_robot(path)
        with pytest.raises(UserError, match=r"different settings \(.*robot"):
            trained(out, robot_file=None)

        kinds = two_kinds(tmp_path, 4)
        assert policy(Neural(), SMALL, 4, kinds).robot == read_robots(kinds)
        message = r"n_robots must be as many as the kinds .* have together, 5 \(got 4\)"
        with pytest.raises(UserError, match=message):
            trained(out, robot_file=two_kinds(tmp_path, 5), again=True)

    def test_they_are_made_for_the_most_robots(self, rollouts, out):
        """Weights of many worlds do not pass through `__init__`, which may refuse their shape."""
        numbers = []

        @dataclass
        class Counting(Three):
            weights: object = field(init=False)

            def __post_init__(self):
                self.weights = jnp.zeros(3)

            def for_world(self, config, robot, n_robots):
                numbers.append(n_robots)
                return self

        wanted = replace(TRAINING, robots=(4, 9), generations=1)
        train(wanted, Counting(), out, PLANAR, task=CLEANING)
        assert numbers == [9]
        assert rollouts.trials[0].weights.shape == (8, 3)

    def test_weights_may_be_a_tree(self, monkeypatch, out):
        """They come back as a tree, and from the file."""
        pretend(monkeypatch)
        pretended = training.rollout

        def rollout(scenario, **options):
            weights = scenario.strategy.weights
            flat = jnp.concatenate([weights["a"], weights["b"][:, 0]], axis=1)
            strategy = replace(scenario.strategy, weights=flat)
            return pretended(replace(scenario, strategy=strategy), **options)

        monkeypatch.setattr(training, "rollout", rollout)
        start = {"a": jnp.zeros(1), "b": jnp.zeros((1, 2))}
        weights = train(TRAINING, Three(start), out, PLANAR, task=CLEANING)
        assert jax.tree.map(jnp.shape, weights) == jax.tree.map(jnp.shape, start)
        jax.tree.map(np.testing.assert_array_equal, load_weights(out / WEIGHTS, start), weights)
        with pytest.raises(UserError, match="has 3 weights, but 4 are wanted"):
            load_weights(out / WEIGHTS, jnp.zeros((2, 2)))
