"""`iswarm train`: its flags, real trainings, and what cannot be trained, of which nothing stays
behind."""

import re
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from support.robots import robot_file
from support.training import SMALL, TRAINING, Three

from iswarm_mj.commands import main as cli
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.search import training
from iswarm_mj.search.training import Training, policy, train
from iswarm_mj.strategy.network import load_weights
from iswarm_mj.strategy.neural import Neural
from iswarm_mj.tasks.aggregation import Aggregation
from iswarm_mj.tasks.cleaning import CLEANING, Cleaning
from iswarm_mj.utils.errors import UserError

pytestmark = pytest.mark.usefixtures("few_pixels")
FLAGS = [
    "--generations=3",
    "--population=3",
    "--worlds=1",
    "--steps=6",
    "--robots=4",
    "--seed=5",
    "--threads=1",
]
FLAGS += [
    "--arena.size=15",
    "--arena.dump-size=3",
    "--arena.dust-area-size=3",
    "--arena.dust-area-offset=5",
]


def test_the_command_trains_in_worlds(tmp_path, capfd, monkeypatch):
    """The policy of the documentation, whose flag takes the weights."""
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).parents[2] / "docs/policies.md").read_text()
    Path("turner.py").write_text(re.search(r"```python\n(# turner.py.*?)```", page, re.S)[1])
    cli.main(["train", "--strategy", "turner.py:Turner", *FLAGS])
    assert re.search(
        r"fitness .* in generation 3\n.*weights in runs/train/weights\.npz", capfd.readouterr().out
    )
    weights = load_weights("runs/train/weights.npz")
    assert len(weights) == 3 * 4 + 4 * 2
    again = cli.parse(
        ["train", "--strategy", "turner.py:Turner", "--weights", "runs/train/weights.npz"]
    )
    flat, _ = ravel_pytree(policy(again.own, SMALL, 4).weights)
    np.testing.assert_array_equal(flat, weights)
    Path("walk.py").write_text(
        "class Walk:\n    init = picks = act = None\n    def __init__(self): pass\n"
    )
    with pytest.raises(SystemExit):
        cli.main(["train", "--strategy", "walk.py:Walk"])
    assert (
        "Walk is not a strategy, since it does not derive from Strategy" in capfd.readouterr().err
    )


def test_the_command_forwards_all_flags(tmp_path, monkeypatch):
    given = {}
    monkeypatch.setattr(
        training, "train", lambda *args, **options: given.update(options, args=args)
    )
    path = robot_file(tmp_path, "five")
    flags = [*FLAGS, "--validation=6", "--spread=0.25", "--sizes", "15", "20", "--arena.n-dust=6"]
    cli.main(["train", *flags, f"--out={tmp_path / 'out'}", f"--robot={path}", "--again"])
    plan, strategy, out, engine = given.pop("args")
    numbers = {
        "steps": 6,
        "generations": 3,
        "population": 3,
        "worlds": 1,
        "validation": 6,
        "spread": 0.25,
        "seed": 5,
    }
    assert plan == Training(config=SMALL, robots=(4,), sizes=(15, 20), **numbers)
    assert (strategy, out, engine) == (Neural(), tmp_path / "out", PlanarSettings(1).for_batches())
    assert given == {"task": CLEANING, "robot_file": path, "again": True}
    cli.main(
        [
            "train",
            "--task=aggregation",
            "--out",
            str(tmp_path / "out"),
            "--engine=mjx",
            "--impl=warp",
        ]
    )
    assert (
        isinstance(given["task"], Aggregation)
        and given["robot_file"] is None
        and not given["again"]
    )
    assert given["args"][0] == Training() and given["args"][3] == MjxSettings(
        "warp"
    ).for_batches() != MjxSettings("warp")


class Balls(Aggregation):
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
    few = replace(
        TRAINING, config=SwarmConfig(), robots=robots, steps=1, generations=1, population=2
    )
    with pytest.raises(UserError, match=sentence):
        train(few, Three(jnp.zeros(3)), tmp_path / "out", PlanarSettings(1), task=task)
    assert not list((tmp_path / "out").glob("*.*"))


@pytest.mark.parametrize(
    ("changed", "sentence"),
    [
        ({"robots": ()}, "robots must be between 1 and 2 numbers"),
        (
            {"robots": (4, 5, 6)},
            "robots must be between 1 and 2 numbers, since a candidate has 2 worlds",
        ),
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
    assert replace(TRAINING, robots=(4, 5)).robots == (4, 5) and Training().worlds >= len(
        Training().robots
    )


@pytest.mark.parametrize(
    ("weights", "sentence"),
    [
        *((none, "Three has no weights to train") for none in (None, [1.0], jnp.zeros(3, int))),
        *(
            (jnp.array(first, float), "weights must be")
            for first in ([], [0.5], [0.0, np.nan], [2e6, 0.0])
        ),
    ],
)
def test_weights_that_no_search_can_begin_with(weights, sentence):
    with pytest.raises(UserError, match=sentence):
        policy(Three(weights), SMALL, 4)
