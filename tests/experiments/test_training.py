"""The training of policies: what it finds, its files, that no interruption changes a byte, and what is refused."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pyarrow.csv
import pytest
from helpers_robots import robot_file
from helpers_search import contents
from helpers_training import GOAL, SMALL, TRAINING, Three, pretend

from iswarm_mj.commands import main as cli
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.experiments.runner import training
from iswarm_mj.experiments.runner.journal import count
from iswarm_mj.experiments.runner.training import CHECKPOINT, CURVE, WEIGHTS, Training, points, policy, train
from iswarm_mj.strategy.network import load_weights
from iswarm_mj.strategy.neural import N_WEIGHTS, Neural
from iswarm_mj.tasks.aggregation import Aggregation
from iswarm_mj.tasks.cleaning import CLEANING, Cleaning
from iswarm_mj.tasks.rewarded import REWARD
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.workflows.rollout import Rollout

pytestmark = pytest.mark.usefixtures("few_pixels")


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
            trained(tmp_path / "out", robot_file=None, resume=True)

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


class TestResume:
    def test_an_interruption_changes_nothing(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        trained(tmp_path / "whole")
        for broken in (0, 1, 3):
            out = tmp_path / f"broken{broken}"
            with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
                pretend(patch, breaks_after=broken)
                trained(out)
            assert (out / CURVE).exists() == (out / WEIGHTS).exists() == bool(broken)
            if broken:
                assert pyarrow.csv.read_csv(out / CURVE).num_rows == broken
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
        with pytest.raises(UserError, match=r"different settings \(.*task"):
            train(TRAINING, Three(jnp.zeros(3)), tmp_path, PlanarSettings(1), task=Aggregation(), resume=True)
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


def test_the_command_forwards_all_flags(tmp_path, monkeypatch):
    given = {}
    monkeypatch.setattr(training, "train", lambda *args, **options: given.update(options, args=args))
    path = robot_file(tmp_path, "five")
    flags = [*FLAGS, "--validation=6", "--spread=0.25", "--sizes", "15", "20", "--arena.n-dust=6"]
    cli.main(["train", *flags, f"--out={tmp_path / 'out'}", f"--robot={path}", "--resume"])
    plan, strategy, out, engine = given.pop("args")
    assert plan == Training(
        config=SMALL,
        robots=(4,),
        sizes=(15, 20),
        steps=6,
        generations=3,
        population=3,
        worlds=1,
        validation=6,
        spread=0.25,
        seed=5,
    )
    assert (strategy, out, engine) == (Neural(), tmp_path / "out", PlanarSettings(1).for_batches())
    assert given == {"task": CLEANING, "robot_file": path, "resume": True}
    cli.main(["train", "--task=aggregation", "--out", str(tmp_path / "out"), "--engine=mjx", "--impl=warp"])
    assert isinstance(given["task"], Aggregation) and given["robot_file"] is None and not given["resume"]
    assert given["args"][0] == Training() and given["args"][3] == MjxSettings("warp").for_batches() != MjxSettings(
        "warp"
    )


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
