"""The search of weights: its worlds, its curve, and which weights are kept."""

import json
from dataclasses import replace
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow.csv
import pytest
from helpers_robots import robot_file, two_kinds
from helpers_search import contents
from helpers_training import GOAL, SMALL, TRAINING, Three, pretend, trained

from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.robot_file import read_robots
from iswarm_mj.experiments.runner import training
from iswarm_mj.experiments.runner.training import CHECKPOINT, CURVE, WEIGHTS, policy, train
from iswarm_mj.strategy.network import load_weights
from iswarm_mj.strategy.neural import Neural
from iswarm_mj.tasks.cleaning import CLEANING, Cleaning
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.workflows.rollout import Rollout

pytestmark = pytest.mark.usefixtures("few_pixels")


class TestSearch:
    def test_it_comes_near_the_goal(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        found = trained(tmp_path / "out", replace(TRAINING, generations=60, population=8, spread=0.3))
        assert np.abs(found - GOAL).max() < 0.05

    def test_candidates_of_a_generation_meet_the_same_worlds_and_those_of_others_do_not(self, monkeypatch, tmp_path):
        asked, keys = pretend(monkeypatch), []
        pretended = training.rollout
        monkeypatch.setattr(training, "rollout", lambda c, s, k, **o: (keys.append(k), pretended(c, s, k, **o))[1])
        trained(tmp_path / "out")
        data = np.array([jax.random.key_data(k) for k in keys]).reshape(5, 4, 2, 2)
        assert (data == data[:, :1]).all() and len(np.unique(data[:, 0].reshape(-1, 2), axis=0)) == 10
        weights = np.array(asked).reshape(5, 4, 2, 3)
        assert (weights == weights[:, :, :1]).all() and len(np.unique(weights.reshape(-1, 3), axis=0)) == 20

    def test_worlds_of_their_own_choose_the_weights(self, monkeypatch, tmp_path):
        """After each tenth generation; here the mean of generation 20 did better there than that of 30."""
        pretend(monkeypatch)
        pretended, tried = training.rollout, {}

        def rollout(config, strategy, keys, **options):
            found = pretended(config, strategy, keys, **options)
            if len(keys) != 7:
                return found
            tried[tuple(np.asarray(strategy.weights)[0])] = np.array(jax.random.key_data(keys))
            return found._replace(picked=np.full(7, {1: 100, 2: 90_000, 3: 500}[len(tried)]))

        monkeypatch.setattr(training, "rollout", rollout)
        wanted = replace(TRAINING, generations=33, validation=7)
        found = trained(tmp_path / "out", wanted)
        means, worlds = list(tried), list(tried.values())
        np.testing.assert_array_equal(found, means[1])
        assert all((keys == worlds[0]).all() for keys in worlds) and len(np.unique(worlds[0], axis=0)) == 7
        rows = pyarrow.csv.read_csv(tmp_path / "out" / CURVE).to_pylist()
        validated = [row["generation"] for row in rows if row["validation"] is not None]
        assert validated == [10, 20, 30] and rows[19]["validation"] > rows[29]["validation"]
        np.testing.assert_array_equal(trained(tmp_path / "out", wanted), found)

    def test_worlds_of_a_candidate_have_the_numbers_of_robots_and_the_arenas_in_turn(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        pretended, given = training.rollout, []

        def rollout(config, strategy, keys, *, n_robots, **options):
            given.append((config.arena.size, n_robots, np.array(jax.random.key_data(keys)).tolist()))
            return pretended(config, strategy, keys, **options)

        monkeypatch.setattr(training, "rollout", rollout)
        trained(tmp_path / "out", replace(TRAINING, robots=(4, 9), sizes=(15.0, 30.0), worlds=3, generations=1))
        (one, few, keys), (other, many, same) = given
        assert (one, other) == (15, 30) and few == 4 * [4, 9, 4] and many == 4 * [16, 36, 16] and keys == same

    def test_before_a_validation_the_last_mean_is_kept(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        found = [trained(tmp_path / str(n), replace(TRAINING, generations=n)) for n in (1, 2, 9, 10)]
        assert all((one != other).any() for one, other in pairwise([np.zeros(3, np.float32), *found]))

    def test_of_equal_validations_the_last_is_kept(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        pretended, tried = training.rollout, []

        def rollout(config, strategy, keys, **options):
            found = pretended(config, strategy, keys, **options)
            if len(keys) != 7:
                return found
            tried.append(np.asarray(strategy.weights)[0])
            return found._replace(picked=np.full(7, 5), delivered_after=np.zeros((7, 1)), delivered=np.zeros(7))

        monkeypatch.setattr(training, "rollout", rollout)
        found = trained(tmp_path / "out", replace(TRAINING, generations=20, validation=7))
        np.testing.assert_array_equal(found, tried[1])

    def test_the_curve_by_hand(self, monkeypatch, tmp_path):
        """One generation of 4 candidates with 2 worlds in 2 arenas; points are 20 for what was picked up, 20 for what
        was delivered and 40 for the mean progress; the last world of the second arena is at fault."""
        fault, asked = SimulationFault(world=7), []

        def rollout(config, strategy, keys, *, n_robots, **_):
            asked.append(np.asarray(strategy.weights)[::2])
            first = config.arena.size == 15
            picked = np.array([1, 4, 6, 0, 2, 2, 5, 3]) + (0 if first else 4)
            delivered = picked // 2
            progress = np.stack([0 * delivered, delivered], axis=1)
            none = np.zeros(8)
            collisions = np.arange(8) * (1 if first else 3)
            faults = [] if first else [fault]
            return Rollout(delivered, picked, collisions, none, none > 1, none, none, progress, None, faults, {})

        monkeypatch.setattr(training, "rollout", rollout)
        trained(tmp_path / "out", replace(TRAINING, sizes=(15.0, 30.0), generations=1))
        (row,) = pyarrow.csv.read_csv(tmp_path / "out" / CURVE).to_pylist()
        picked = np.array([[1, 4, 6, 0, 2, 2, 5, 3], [5, 8, 10, 4, 6, 6, 9, 7]])
        collisions, robots = np.array([np.arange(8), 3 * np.arange(8)]), np.array([[4], [16]])
        worth = 20 * picked + 40 * (picked // 2) - 0.05 * collisions / robots
        worth = worth.reshape(2, 4, 2).mean(axis=(0, 2))
        expected = {
            "generation": 1,
            "best": worth.max(),
            "mean": worth.mean(),
            "worst": worth.min(),
            "picked": picked.mean(),
            "delivered": (picked // 2).mean(),
            "collisions": collisions.mean(),
            "faults": 1 / 16,
            "validation": None,
            "spread": asked[0].astype(float).std(axis=0).mean(),
        }
        assert list(row) == list(expected) and row.pop("validation") is expected.pop("validation")
        assert row == pytest.approx(expected, rel=1e-5)

    def test_tasks_judge_what_was_run(self, monkeypatch, tmp_path):
        """Each world by its own arena, robots and measures; what was not finished has no step in which it was."""
        judged = []

        class Judging(Cleaning):
            def fitness(self, measures, config, n_robots, steps):
                judged.append((config.arena.size, n_robots, steps, measures.finished_at))
                return 0.0

        pretend(monkeypatch)
        pretended = training.rollout

        def rollout(*args, **options):
            return pretended(*args, **options)._replace(finished_at=np.tile([0, 7], 4))

        monkeypatch.setattr(training, "rollout", rollout)
        wanted = replace(TRAINING, robots=(4, 9), sizes=(15.0, 30.0), steps=60, generations=1)
        train(wanted, Three(jnp.zeros(3)), tmp_path / "out", PlanarSettings(1), task=Judging())
        assert judged == 4 * [(15, 4, 60, None), (15, 9, 60, 7)] + 4 * [(30, 16, 60, None), (30, 36, 60, 7)]

    def test_other_seeds_have_other_worlds_and_candidates(self, monkeypatch, tmp_path):
        found = {}
        for seed in (3, 4):
            asked, keys = pretend(monkeypatch), []
            pretended = training.rollout
            monkeypatch.setattr(
                training, "rollout", lambda c, s, k, keys=keys, to=pretended, **o: (keys.append(k), to(c, s, k, **o))[1]
            )
            trained(tmp_path / str(seed), replace(TRAINING, seed=seed, generations=10, validation=7))
            found[seed] = (
                np.array(asked[:10]),
                {tuple(key) for one in keys for key in np.array(jax.random.key_data(one))},
            )
        assert (found[3][0] != found[4][0]).all() and not found[3][1] & found[4][1]
        assert len(found[3][1]) == 10 * TRAINING.worlds + 7

    def test_the_robot_is_that_of_the_file(self, monkeypatch, tmp_path):
        """In the worlds, in the strategy, and as a setting that a training is resumed with."""
        path, given = robot_file(tmp_path, "five"), []
        pretend(monkeypatch)
        pretended = training.rollout

        def rollout(*args, robot_file, **options):
            given.append(robot_file)
            return pretended(*args, **options)

        monkeypatch.setattr(training, "rollout", rollout)
        trained(tmp_path / "out", robot_file=path)
        assert given == 5 * [path] and policy(Neural(), SMALL, 4, path).robot == read_robot(path)
        with pytest.raises(UserError, match=r"different settings \(.*robot"):
            trained(tmp_path / "out", robot_file=None)

    def test_robots_may_be_of_two_kinds(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        kinds, other = two_kinds(tmp_path, 4), two_kinds(tmp_path, 5)
        trained(tmp_path / "out", robot_file=kinds)
        assert policy(Neural(), SMALL, 4, kinds).robot == read_robots(kinds)
        with pytest.raises(UserError, match=r"n_robots must be as many as the kinds .* have together, 5 \(got 4\)"):
            trained(tmp_path / "out", robot_file=other, again=True)

    def test_the_strategy_is_made_for_the_most_robots(self, monkeypatch, tmp_path):
        class Counted:
            def for_world(self, config, robot, n_robots):
                asked.append(n_robots)
                return Three(jnp.zeros(3))

        pretend(monkeypatch)
        asked = []
        wanted = replace(TRAINING, robots=(4, 9))
        train(wanted, Counted(), tmp_path / "out", PlanarSettings(1), task=CLEANING)
        assert asked == [9]

    def test_a_tree_of_weights(self, monkeypatch, tmp_path):
        """Comes back as a tree, and from the file."""
        pretend(monkeypatch)
        pretended = training.rollout

        def rollout(config, strategy, keys, **options):
            flat = jnp.concatenate([strategy.weights["a"], strategy.weights["b"][:, 0]], axis=1)
            return pretended(config, replace(strategy, weights=flat), keys, **options)

        monkeypatch.setattr(training, "rollout", rollout)
        begins = {"a": jnp.zeros(1), "b": jnp.zeros((1, 2))}
        found = train(TRAINING, Three(begins), tmp_path / "out", PlanarSettings(1), task=CLEANING)
        assert jax.tree.map(jnp.shape, found) == jax.tree.map(jnp.shape, begins)
        loaded = load_weights(tmp_path / "out" / WEIGHTS, begins)
        jax.tree.map(np.testing.assert_array_equal, loaded, found)
        with pytest.raises(UserError, match="has 3 weights, but 4 are wanted"):
            load_weights(tmp_path / "out" / WEIGHTS, jnp.zeros((2, 2)))

    def test_files(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        found = trained(tmp_path / "out")
        names = [CHECKPOINT, CURVE, WEIGHTS, "learning.png", "learning.svg"]
        assert sorted(contents(tmp_path / "out")) == sorted(names)
        np.testing.assert_array_equal(load_weights(tmp_path / "out" / WEIGHTS), found)
        rows = pyarrow.csv.read_csv(tmp_path / "out" / CURVE).to_pylist()
        assert [row["generation"] for row in rows] == [1, 2, 3, 4, 5]
        assert all(row["worst"] <= row["mean"] <= row["best"] for row in rows)
        settings = json.loads(contents(tmp_path / "out")[CHECKPOINT][-1][1])["settings"]
        assert settings["engine"] == "planar" and settings["population"] == 4
        assert settings["strategy"]["class"] == "Three"
