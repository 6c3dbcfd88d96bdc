"""`iswarm train`: its flags, a real training, and what cannot be trained."""

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

DOCUMENTATION = Path(__file__).parents[2] / "docs/policies.md"
FLAGS = [
    "--generations=3",
    "--population=3",
    "--worlds=1",
    "--steps=6",
    "--robots=4",
    "--seed=5",
    "--threads=1",
    "--arena.size=15",
    "--arena.dump-size=3",
    "--arena.dust-area-size=3",
    "--arena.dust-area-offset=5",
]


@pytest.mark.usefixtures("few_pixels")
@pytest.mark.slow
def test_the_command_trains_the_policy_of_the_documentation(tmp_path, capfd, monkeypatch):
    """The flag `--weights` takes the weights that were written."""
    monkeypatch.chdir(tmp_path)
    code = re.search(r"```python\n(# turner.py.*?)```", DOCUMENTATION.read_text(), re.S)[1]
    Path("turner.py").write_text(code)
    cli.main(["train", "--strategy", "turner.py:Turner", *FLAGS])
    summary = r"fitness .* in generation 3\n.*weights in runs/train/weights\.npz"
    assert re.search(summary, capfd.readouterr().out)

    weights = load_weights("runs/train/weights.npz")
    assert len(weights) == 3 * 4 + 4 * 2
    again = ["train", "--strategy", "turner.py:Turner", "--weights", "runs/train/weights.npz"]
    strategy = cli.parse(again).strategy_plugin
    flat_weights, _ = ravel_pytree(policy(strategy, SMALL, 4).weights)
    np.testing.assert_array_equal(flat_weights, weights)


class TestFlags:
    @pytest.fixture
    def call(self, monkeypatch):
        """Return the arguments of the last call of a stand-in for `train`."""
        call = {}

        def pretend(*arguments, **options):
            call.clear()
            call.update(options, arguments=arguments)

        monkeypatch.setattr(training, "train", pretend)
        return call

    def test_all_of_them_are_forwarded(self, tmp_path, call):
        robot = robot_file(tmp_path, "five")
        out = tmp_path / "out"
        plan_flags = ["--validation=6", "--spread=0.25", "--sizes", "15", "20", "--arena.n-dust=6"]
        cli.main(["train", *FLAGS, *plan_flags, f"--out={out}", f"--robot={robot}", "--again"])
        wanted = Training(
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
        engine = PlanarSettings(1).for_batches()
        assert call == {
            "arguments": (wanted, Neural(), out, engine),
            "task": CLEANING,
            "robot_file": robot,
            "again": True,
        }

    def test_the_task_and_the_engine_may_be_others(self, tmp_path, call):
        out = f"--out={tmp_path}"
        cli.main(["train", "--task=aggregation", out, "--engine=mjx", "--impl=warp"])
        plan, _, _, engine = call["arguments"]
        assert plan == Training()
        assert engine == MjxSettings("warp").for_batches() != MjxSettings("warp")
        assert isinstance(call["task"], Aggregation)
        assert call["robot_file"] is None
        assert not call["again"]


class WithoutBalls(Aggregation):
    """A task with a fitness but no balls."""

    fitness = Cleaning.fitness


class Raising(Cleaning):
    """A task whose fitness raises an error."""

    def fitness(self, measures, config, n_robots, steps):
        raise ValueError("no idea")


class Unequal(Aggregation):
    """A task whose state has a number for each robot."""

    def lay_out(self, config, n_robots, rng, shared, cell):
        poses, spots = super().lay_out(config, n_robots, rng, shared, cell)
        return poses, spots._replace(shares=np.zeros(n_robots, np.float32))

    def advance(self, state, inputs, key):
        _, sensed = super().advance(state, inputs, key)
        return state, sensed


class RewardingCommands(Aggregation):
    """A task whose rewards depend on commands, which a training does not have."""

    def reward(self, before, after, inputs):
        return inputs.command.forward


@pytest.mark.parametrize(
    ("task", "robots", "message"),
    [
        (WithoutBalls(), (4,), "WithoutBalls has a fitness, .* no method balls"),
        (Raising(), (4,), r"Raising.fitness raised ValueError: no idea"),
        (Unequal(), (4, 3), "Unequal has other shapes in worlds with other numbers of robots"),
        (
            RewardingCommands(),
            (4,),
            "RewardingCommands.reward, here without commands and messages, raised AttributeError",
        ),
    ],
)
def test_tasks_that_cannot_be_scored_are_refused(task, robots, message, tmp_path):
    """Nothing stays behind, so that the next training may use the directory."""
    short = replace(
        TRAINING, config=SwarmConfig(), robots=robots, steps=1, generations=1, population=2
    )
    out = tmp_path / "out"
    with pytest.raises(UserError, match=message):
        train(short, Three(jnp.zeros(3)), out, PlanarSettings(1), task=task)
    assert not list(out.glob("*.*"))


class TestWorlds:
    @pytest.mark.parametrize(
        ("change", "message"),
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
    def test_impossible_ones_are_refused_at_once(self, change, message):
        with pytest.raises(UserError, match=message):
            replace(TRAINING, **change)

    def test_a_candidate_may_have_one_for_each_number_of_robots(self):
        assert replace(TRAINING, robots=(4, 5)).robots == (4, 5)
        assert Training().worlds >= len(Training().robots)


class TestWeights:
    @pytest.mark.parametrize("weights", [None, [1.0], jnp.zeros(3, int)])
    def test_they_must_be_arrays_of_floats(self, weights):
        with pytest.raises(UserError, match="Three has no weights to train"):
            policy(Three(weights), SMALL, 4)

    @pytest.mark.parametrize("weights", [[], [0.5], [0.0, np.nan], [2e6, 0.0]])
    def test_they_must_be_at_least_two_and_small(self, weights):
        with pytest.raises(UserError, match="weights must be"):
            policy(Three(jnp.array(weights, float)), SMALL, 4)
