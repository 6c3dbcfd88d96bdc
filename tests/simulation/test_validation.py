"""Checks on demand: they find what a run would refuse, in one sentence."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import jax.numpy as jnp
import pytest
from support.small import SMALL
from support.tasks import Eastward, Still

from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.registry import find_engine
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.validation import check_engine, check_strategy, check_task
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.aggregation import Beeclust
from iswarm_mj.tasks.cleaning import Cleaning
from iswarm_mj.utils.constraints import Within
from iswarm_mj.utils.errors import UserError

DATA = Path(__file__).parents[1] / "data"
SCENARIO = Scenario(SMALL, robots=8)

BOX = (5.0, 3.0, 1.0, 1.0, 0.0, 1e-5, 0.01)
WITH_BOX = replace(SMALL, arena=replace(SMALL.arena, boxes=(BOX,)))


class Short(Still):
    """Strategy that commands three robots, however many there are."""

    def act(self, memory, observation, key):
        return memory, Command(jnp.zeros(3), jnp.zeros(3))


class Nowhere(Eastward):
    """Task whose progress is a share instead of a number."""

    def progress(self, state):
        return state["is_east"].mean()


@pytest.fixture
def changed_engine(tmp_path):
    """Return a function that returns the settings of an engine with a part of its file replaced."""

    def change(name, old, new):
        file, _, cls = name.partition(":")
        text = (DATA / file).read_text()
        assert old in text
        (tmp_path / file).write_text(text.replace(old, new))
        return find_engine(f"{tmp_path / file}:{cls}")()

    return change


def test_shipped_ones_pass():
    check_strategy(Still(), SCENARIO)
    check_task(Eastward(2.0), SCENARIO)


@pytest.mark.parametrize("engine", [MujocoSettings(1), PlanarSettings(1)])
@pytest.mark.parametrize("config", [SMALL, WITH_BOX], ids=["no box", "one box"])
def test_shipped_engines_pass(engine, config):
    check_engine(engine, Scenario(config, robots=8))


@pytest.mark.parametrize("name", ["teleport.py:TeleportSettings", "glide.py:GlideSettings"])
def test_engines_of_users_pass_on_the_host_and_in_programs(name):
    check_engine(find_engine(str(DATA / name))(), SCENARIO)


@pytest.mark.parametrize("mapping", ["vmap", "in turn"])
def test_engines_of_users_pass_with_any_mapping(changed_engine, mapping):
    check_engine(changed_engine("glide.py:GlideSettings", '"batch"', f'"{mapping}"'), SCENARIO)


@pytest.mark.parametrize(
    ("check", "given", "sentence"),
    [
        (check_strategy, Short(), r"Short.act must return float32\[8\]"),
        (check_strategy, Beeclust(), "follows the light of the task aggregation"),
        (check_task, Nowhere(2.0), r"Nowhere.progress must return int32"),
        (check_task, Still(), "Still is not a task"),
    ],
)
def test_mistakes_are_one_sentence(check, given, sentence):
    with pytest.raises(UserError, match=sentence):
        check(given, SCENARIO)


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
def test_an_engine_that_moves_robots_by_itself_is_refused(changed_engine, old, new, sentence):
    engine = changed_engine("teleport.py:TeleportSettings", old, new)
    with pytest.raises(UserError, match=sentence):
        check_engine(engine, SCENARIO)


def test_an_engine_that_has_boxes_says_where_they_are(changed_engine):
    claims = 'name: ClassVar[str] = "teleport"\n    has_boxes: ClassVar[bool] = True\n'
    name = 'name: ClassVar[str] = "teleport"\n'
    engine = changed_engine("teleport.py:TeleportSettings", name, claims)
    with pytest.raises(UserError, match=r"Teleport\.(poses|boxes) must return"):
        check_engine(engine, Scenario(WITH_BOX, robots=8))


@dataclass(frozen=True)
class Paced(Cleaning):
    """Cleaning with a setting that has a range."""

    pace: Annotated[float, Within(0, 4, "mm")] = 1.0


@pytest.mark.parametrize(
    "call", [check_task, lambda task: Run(Scenario(SMALL, task=task, robots=8))]
)
def test_fields_of_a_task_stay_in_their_ranges(call):
    with pytest.raises(UserError, match=r"pace must be between 0 and 4 mm \(got 9"):
        call(Paced(pace=9.0))
