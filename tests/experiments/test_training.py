"""The training of policies: what it finds, its files, that no interruption changes a byte, and what is refused."""

import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pyarrow.csv
import pytest
from helpers_robots import robot_file
from helpers_search import contents
from helpers_training import GOAL, SMALL, TRAINING, Three, pretend, trained

from iswarm_mj.commands import main as cli
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.experiments.runner import training
from iswarm_mj.experiments.runner.journal import count
from iswarm_mj.experiments.runner.training import CHECKPOINT, CURVE, WEIGHTS, Training, points, policy, train
from iswarm_mj.strategy.network import load_weights
from iswarm_mj.strategy.neural import N_WEIGHTS, Neural
from iswarm_mj.tasks.aggregation import Aggregation
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.rewarded import REWARD
from iswarm_mj.utils.errors import UserError
from iswarm_mj.workflows.rollout import Rollout

pytestmark = pytest.mark.usefixtures("few_pixels")


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
            trained(out)
            assert len(asked) == 5 - broken and contents(out) == contents(tmp_path / "whole")

    def test_it_goes_on_for_longer(self, monkeypatch, tmp_path):
        asked = pretend(monkeypatch)
        trained(tmp_path / "long", replace(TRAINING, generations=7))
        trained(tmp_path / "out")
        asked.clear()
        trained(tmp_path / "out", replace(TRAINING, generations=7))
        assert len(asked) == 2 and contents(tmp_path / "out") == contents(tmp_path / "long")

    def test_what_is_in_the_way_is_refused(self, monkeypatch, tmp_path):
        pretend(monkeypatch)
        trained(tmp_path)
        with pytest.raises(UserError, match=r"different settings \(.*task"):
            train(TRAINING, Three(jnp.zeros(3)), tmp_path, PlanarSettings(1), task=Aggregation())
        with pytest.raises(UserError, match=r"different settings \(.*seed"):
            trained(tmp_path, replace(TRAINING, seed=4))
        with pytest.raises(UserError, match="different settings"):
            train(TRAINING, Three(jnp.zeros(3)), tmp_path, MujocoSettings(1), task=CLEANING)
        assert len(trained(tmp_path, again=True)) == 3


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
    cli.main(["train", *flags, f"--out={tmp_path / 'out'}", f"--robot={path}", "--again"])
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
    assert given == {"task": CLEANING, "robot_file": path, "again": True}
    cli.main(["train", "--task=aggregation", "--out", str(tmp_path / "out"), "--engine=mjx", "--impl=warp"])
    assert isinstance(given["task"], Aggregation) and given["robot_file"] is None and not given["again"]
    assert given["args"][0] == Training() and given["args"][3] == MjxSettings("warp").for_batches() != MjxSettings(
        "warp"
    )


@pytest.mark.slow
def test_killed_and_resumed(tmp_path):
    """In processes that are killed, at any moment, files end up byte for byte as without."""

    def begin(out):
        command = [sys.executable, "-m", "iswarm_mj", "train", *FLAGS, f"--out={out}"]
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
