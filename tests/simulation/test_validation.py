"""What is wrong with a user's strategy, task or engine is found on demand, too."""

from pathlib import Path

import jax.numpy as jnp
import pytest
from support.small import SMALL
from support.tasks import Eastward, Still

from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.registry import find_engine
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.validation import check_engine, check_strategy, check_task
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.aggregation import Beeclust
from iswarm_mj.utils.errors import UserError

DATA = Path(__file__).parents[1] / "data"


class Short(Still):
    def act(self, memory, observation, key):
        return memory, Command(jnp.zeros(3), jnp.zeros(3))


class Nowhere(Eastward):
    def progress(self, state):
        return state["is_east"].mean()


def test_shipped_ones_pass():
    check_strategy(Still(), Scenario(SMALL, robots=8))
    check_task(Eastward(2.0), Scenario(SMALL, robots=8))
    for engine in (MujocoSettings(1), PlanarSettings(1)):
        check_engine(engine, Scenario(SMALL, robots=8))


def test_engines_of_users_pass_on_the_host_and_in_programs():
    for name in ("teleport.py:TeleportSettings", "glide.py:GlideSettings"):
        check_engine(find_engine(str(DATA / name))(), Scenario(SMALL, robots=5))


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (
            lambda: check_strategy(Short(), Scenario(SMALL, robots=8)),
            r"Short.act must return float32\[8\]",
        ),
        (
            lambda: check_strategy(Beeclust(), Scenario(SMALL, robots=8)),
            "follows the light of the task aggregation",
        ),
        (
            lambda: check_task(Nowhere(2.0), Scenario(SMALL, robots=8)),
            r"Nowhere.progress must return int32",
        ),
        (lambda: check_task(Still(), Scenario(SMALL, robots=8)), "Still is not a task"),
    ],
)
def test_mistakes_are_one_sentence(call, sentence):
    with pytest.raises(UserError, match=sentence):
        call()


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "Places(np.array(poses, float))",
            "Places(np.array(poses, float) + 1.0)",
            "Teleport.place must put robots",
        ),
        (
            "poses = bodies.poses\n",
            "poses = bodies.poses + 0.2\n",
            "Teleport.move must leave robots",
        ),
        (
            "poses = bodies.poses\n",
            "poses = bodies.poses + [0, 0, 0.1]\n",
            "Teleport.move must leave robots",
        ),
        ("return bodies.poses", "return bodies.poses[0]", "Teleport.poses must return"),
    ],
)
def test_an_engine_that_moves_robots_by_itself_is_refused(tmp_path, old, new, sentence):
    text = (DATA / "teleport.py").read_text()
    assert old in text
    (tmp_path / "moves.py").write_text(text.replace(old, new))
    with pytest.raises(UserError, match=sentence):
        check_engine(
            find_engine(f"{tmp_path}/moves.py:TeleportSettings")(), Scenario(SMALL, robots=5)
        )
