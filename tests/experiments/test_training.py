"""The training of policies: what it finds, its files, that no interruption changes a byte, and what is refused."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow.csv
import pytest
from helpers_search import contents

from iswarm_mj.commands import main as cli
from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.experiments.runner import training
from iswarm_mj.experiments.runner.journal import count
from iswarm_mj.experiments.runner.training import CHECKPOINT, CURVE, WEIGHTS, Training, points, policy, train
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.network import load_weights
from iswarm_mj.strategy.neural import N_WEIGHTS, Neural
from iswarm_mj.tasks.aggregation import Aggregation
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.rewarded import REWARD
from iswarm_mj.utils.errors import UserError
from iswarm_mj.workflows.rollout import Rollout

pytestmark = pytest.mark.usefixtures("few_pixels")
SMALL = SwarmConfig(ArenaConfig(size=15, dump_size=3, dust_area_size=3, dust_area_offset=5, n_dust=6))
TRAINING = Training(config=SMALL, robots=(4,), steps=10, generations=5, population=4, worlds=2, seed=3)
GOAL = np.array([0.5, -1.0, 0.25])


@dataclass
class Three:
    """A policy of three weights, which robots do not use."""

    weights: object

    def init(self, n_robots, key):
        return jnp.zeros(n_robots)

    def picks(self, memory):
        return memory < 1

    def act(self, memory, seen, key):
        return memory, Command(memory, memory)


def pretend(monkeypatch, breaks_after=None):
    """Rollouts without physics: the nearer weights are to a goal, the more balls; returns the weights of each call."""
    asked = []

    def rollout(config, strategy, keys, *, strategy_per_world, every, steps, **_):
        if breaks_after is not None and len(asked) >= breaks_after:
            raise KeyboardInterrupt
        weights = np.asarray(strategy.weights)
        assert strategy_per_world and len(keys) == len(weights)
        asked.append(weights)
        worth = np.round(1000 - 100 * np.abs(weights - GOAL).sum(axis=1))
        columns = np.tile(worth[:, None] // 2, (1, -(-steps // every)))
        none = np.zeros(len(keys))
        return Rollout(worth, worth, none, none, none > 1, none, columns[0], columns, None, [], {})

    monkeypatch.setattr(training, "rollout", rollout)
    return asked


def trained(out, wanted=TRAINING, **options):
    return train(wanted, Three(jnp.zeros(3)), out, PlanarSettings(1), task=CLEANING, **options)


def test_points_by_hand():
    """Three worlds, counted after steps 5 and 10: 3 balls picked up and 0, then 2 delivered; nothing at all; all of 6
    delivered after 8 of 10 steps, with 40 collisions of 5 robots."""
    none, delivered = np.zeros(3), np.array([2, 0, 6])
    after = np.array([[0, 2], [0, 0], [4, 6]])
    when, collisions = np.array([0, 0, 8]), np.array([0, 0, 40])
    found = Rollout(
        delivered, np.array([3, 0, 6]), collisions, none, when > 0, when, np.array([5, 10]), after, None, [], {}
    )
    expected = [20 * 3 + 20 * 2 + 40 * 1, 0, 40 * 6 + 10 * 2 - 0.05 / 5 * 40 + 40 * 5]
    np.testing.assert_allclose(points(found, CLEANING, SMALL, [4, 4, 5], 10), expected)


def test_tasks_without_a_fitness_are_trained_by_their_rewards(monkeypatch, tmp_path):
    asked = []

    def rollout(config, strategy, keys, *, task, **_):
        asked.append(task)
        earned = 10 - np.abs(np.asarray(strategy.weights) - GOAL).sum(axis=1)
        none = np.zeros(len(keys))
        return Rollout(
            none, none, none, none, none > 1, none, none, np.zeros((len(keys), 1)), None, [], {REWARD: earned}
        )

    monkeypatch.setattr(training, "rollout", rollout)
    wanted = replace(TRAINING, generations=60, population=8, spread=0.3)
    found = train(wanted, Three(jnp.zeros(3)), tmp_path, PlanarSettings(1), task=Aggregation())
    assert np.abs(found - GOAL).max() < 0.05
    assert isinstance(asked[0], Aggregation) and REWARD in asked[0].measured


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
        np.testing.assert_array_equal(trained(tmp_path / "out", wanted, resume=True), found)

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


class TestResume:
    def test_an_interruption_changes_nothing(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        trained(tmp_path / "whole")
        for broken in (0, 1, 3):
            out = tmp_path / f"broken{broken}"
            with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
                pretend(patch, breaks_after=broken)
                trained(out)
            asked = pretend(monkeypatch)
            trained(out, resume=True)
            assert len(asked) == 5 - broken and contents(out) == contents(tmp_path / "whole")

    def test_it_goes_on_for_longer(self, monkeypatch, tmp_path):
        asked = pretend(monkeypatch)
        trained(tmp_path / "long", replace(TRAINING, generations=7))
        trained(tmp_path / "out")
        asked.clear()
        trained(tmp_path / "out", replace(TRAINING, generations=7), resume=True)
        assert len(asked) == 2 and contents(tmp_path / "out") == contents(tmp_path / "long")

    def test_what_is_in_the_way_is_refused(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        trained(tmp_path)
        with pytest.raises(UserError, match="out must be a directory without a training"):
            trained(tmp_path)
        with pytest.raises(UserError, match=r"different settings \(.*seed"):
            trained(tmp_path, replace(TRAINING, seed=4), resume=True)
        with pytest.raises(UserError, match="different settings"):
            train(TRAINING, Three(jnp.zeros(3)), tmp_path, MujocoSettings(1), task=CLEANING, resume=True)
        (tmp_path / CHECKPOINT).unlink()
        with pytest.raises(UserError, match="this one lacks its checkpoint"):
            trained(tmp_path)
        assert len(trained(tmp_path, again=True)) == 3


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"robots": ()}, "robots must be between 1 and 2 numbers"),
        ({"robots": (4, 5, 6)}, "robots must be between 1 and 2 numbers, since a candidate has 2 worlds"),
        ({"robots": (4000,)}, "robots"),
        ({"sizes": (15.0, 10.5)}, "dust_area_offset"),
    ],
)
def test_worlds_that_cannot_be_are_refused_at_once(changed, sentence):
    with pytest.raises(UserError, match=sentence):
        replace(TRAINING, **changed)


@pytest.mark.parametrize("weights", [None, 3.0, [1.0], {}, jnp.zeros(3, int), [jnp.zeros(3), jnp.zeros(3, int)]])
def test_strategies_without_weights_are_refused(weights):
    with pytest.raises(UserError, match="Three has no weights to train"):
        policy(Three(weights), SMALL, 4)
    with pytest.raises(UserError, match="weights must be between 1"):
        policy(Three(jnp.zeros(0)), SMALL, 4)


def test_training_begins_where_a_file_ends(monkeypatch, tmp_path):
    pretend(monkeypatch)
    assert len(policy(Neural(), SMALL, 4).weights) == N_WEIGHTS
    trained(tmp_path)
    with pytest.raises(UserError, match=r"has 3 weights, but"):
        policy(Neural(tmp_path / WEIGHTS), SMALL, 4)


FLAGS = ["--generations=3", "--population=3", "--worlds=1", "--steps=6", "--robots=4", "--seed=5", "--threads=1"]
FLAGS += ["--arena.size=15", "--arena.dump-size=3", "--arena.dust-area-size=3", "--arena.dust-area-offset=5"]


def test_the_command_trains_in_worlds(tmp_path, capfd, monkeypatch):
    """In real worlds: its weights run by the strategy's flag, and another training with them begins there."""
    monkeypatch.chdir(tmp_path)
    cli.main(["train", *FLAGS])
    assert re.search(r"fitness .* in generation 3\n.*weights in runs/train/weights\.npz", capfd.readouterr().out)
    weights = load_weights("runs/train/weights.npz")
    assert len(weights) == N_WEIGHTS
    begins = Neural(Path("runs/train/weights.npz")).for_training(SMALL, None, 4)
    np.testing.assert_array_equal(begins.weights, weights)


def test_the_command_trains_a_policy_of_the_user(tmp_path, capfd, monkeypatch):
    """That of the documentation, whose flag then takes the weights; strategies without weights are refused."""
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[2] / "docs/policies.md").read_text()
    Path("turner.py").write_text(re.search(r"```python\n(# turner.py.*?)```", page, re.S)[1])
    cli.main(["train", "--strategy", "turner.py:Turner", *FLAGS])
    weights = load_weights("runs/train/weights.npz")
    assert len(weights) == 4 * 4 + (4 + 4) * 2
    again = cli.parse(["train", "--strategy", "turner.py:Turner", "--weights", "runs/train/weights.npz"])
    np.testing.assert_array_equal(policy(again.own, SMALL, 4).weights, weights)
    Path("walk.py").write_text("class Walk:\n    init = picks = act = None\n    def __init__(self): pass\n")
    with pytest.raises(SystemExit):
        cli.main(["train", "--strategy", "walk.py:Walk"])
    assert "Walk has no method init" in capfd.readouterr().err


@pytest.mark.slow
def test_killed_and_resumed(tmp_path):
    """In processes that are killed, at any moment, files end up byte for byte as without."""

    def begin(out):
        command = [sys.executable, "-m", "iswarm_mj", "train", *FLAGS, f"--out={out}", "--resume"]
        return subprocess.Popen(command, env=os.environ, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)

    assert begin(tmp_path / "whole").wait(600) == 0
    killed, rng = 0, np.random.default_rng(0)
    for _ in range(4):
        process = begin(tmp_path / "killed")
        found = tmp_path / "killed" / CHECKPOINT
        known = count(found)
        while process.poll() is None and count(found) == known:
            time.sleep(0.01)
        time.sleep(rng.uniform(0, 0.2))
        if process.poll() is None:
            process.send_signal(signal.SIGKILL)
            killed += 1
        process.wait(60)
    assert killed and begin(tmp_path / "killed").wait(600) == 0
    whole, other = contents(tmp_path / "whole"), contents(tmp_path / "killed")
    other.pop(".lock", None)
    assert whole == other
