"""Base classes of users' code: each mistake in its methods is one sentence; defaults do nothing."""

import subprocess
import sys
from dataclasses import dataclass
from typing import ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from iswarm_mj.sensors.fields import Integer
from iswarm_mj.strategy.base import (
    Strategy,
    StrategyFactory,
    is_batch_invariant,
    makes_strategies,
    overrides,
)
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.validation import check_methods
from iswarm_mj.tasks.base import Quantity, Task, has_balls, is_scored, without_balls
from iswarm_mj.tasks.cleaning import Cleaning
from iswarm_mj.tasks.validation import check_methods as check_task_methods
from iswarm_mj.utils.errors import UserError


class Walk(Strategy):
    """A strategy with no more than it must have."""

    def init(self, n_robots, key):
        return jnp.zeros(n_robots)

    def picks(self, memory):
        return memory < 0

    def act(self, memory, observation, key):
        return memory, Command(memory, memory)


class Gather(Task):
    """A task with no more than it must have."""

    def lay_out(self, config, n_robots, rng, shared, cell):
        return np.zeros((n_robots, 3)), ()

    def advance(self, state, inputs, key):
        return state, without_balls(len(inputs.poses))


def derive(base=Walk, **methods):
    """Return a class `Mine` with some methods of its own."""
    return type("Mine", (base,), methods)


SPEAKS = {
    "payload": {"word": Integer(3)},
    "say": lambda self, memory, is_loaded: {"word": memory},
}
"""What robots have that send messages."""


@pytest.mark.parametrize(
    ("cls", "sentence"),
    [
        (
            derive(release=Walk.picks),
            "Mine.release is never used: Strategy has releases, but no release; rename it",
        ),
        (derive(led_powers=Walk.picks), "Strategy has led_power"),
        (derive(record=("x",), releases=Walk.picks), "Strategy has recorded, but no record"),
        (derive(payloads={}), "Strategy has payload, but no payloads"),
        (derive(_release=Walk.picks), None),
        (derive(turn_aside=Walk.picks), None),
        (derive(act=None), "Mine has no method act; a strategy has it, see Strategy"),
        (
            type("Mine", (Strategy,), {"init": Walk.init}),
            "Mine has no method act and no method picks; a strategy has it, see Strategy",
        ),
        (
            type("Mine", (Strategy,), {"init": Walk.init, "pick": Walk.picks, "act": Walk.act}),
            "Mine has no method picks; rename pick, which it has, to picks",
        ),
        (
            type("Mine", (), {"init": 1, "picks": 1, "act": 1}),
            r"write class Mine\(Strategy\), with from iswarm_mj",
        ),
        (
            derive(say=lambda self, memory, is_loaded: {}),
            "has a method say, but no attribute payload",
        ),
        (derive(payload={"word": Integer(3)}), "has an attribute payload, but no method say"),
        (derive(**SPEAKS), None),
        (type("Mine", (StrategyFactory,), {"for_world": None}), "Mine has no method for_world"),
        (type("Mine", (StrategyFactory,), {"for_world": Walk.init}), None),
    ],
)
def test_methods_of_a_strategy_are_there_and_spelt_as_in_the_base_class(cls, sentence):
    if sentence is None:
        check_methods(cls)
        return
    with pytest.raises(UserError, match=sentence):
        check_methods(cls)


@pytest.mark.parametrize(
    ("cls", "sentence"),
    [
        (
            derive(Gather, survive=Walk.picks),
            "Mine.survive is never used: Task has survives, but no survive",
        ),
        (derive(Cleaning, drive_box=Walk.picks), "Task has drive_boxes"),
        (
            derive(Cleaning, goals=Walk.picks),
            "Mine.goals is never used: Task has goal, but no goals",
        ),
        (derive(Cleaning, goals=Walk.picks, goal=Cleaning.goal), None),
        (derive(Cleaning, sense={"light": Quantity("of the sun")}), "Task has senses"),
        (derive(Gather, area=Walk.picks, areas=Walk.picks), None),
        (derive(Gather, advance=None), "Mine has no method advance; a task has it, see Task"),
        (type("Mine", (Walk,), {}), "Mine is not a task, since it does not derive from Task"),
        (Gather, None),
        (Cleaning, None),
    ],
)
def test_methods_of_a_task_are_there_and_spelt_as_in_the_base_class(cls, sentence):
    if sentence is None:
        check_task_methods(cls)
        return
    with pytest.raises(UserError, match=sentence):
        check_task_methods(cls)


def test_fields_of_a_dataclass_may_be_called_nearly_as_a_method():
    @dataclass(frozen=True)
    class Lamp(Gather):
        goals: float = 2.0
        measured: ClassVar = {}

    check_task_methods(Lamp())


def test_defaults_of_strategies_change_nothing():
    walk = Walk()
    memory = jnp.arange(3.0)
    assert walk.releases(memory) is None
    assert walk.led_power(memory) is None
    assert walk.say(memory, memory > 0) == {}
    assert walk.correct_odometry(memory, memory) is memory
    assert walk.listen(memory, None, jax.random.key(0)) is memory
    assert walk.for_world(None, None, 3) is walk
    assert not makes_strategies(walk)


def test_defaults_of_tasks_change_nothing():
    task = Gather()
    conditions = object()
    assert task.goal(None, 3) is None
    assert task.survives(()) is None
    assert task.drive_boxes(()) is None
    assert task.balls(()) is None
    assert task.conditions((), conditions) is conditions
    assert task.areas(None, ()) == {}
    assert task.metrics(()) == {}


def test_methods_show_what_a_task_has():
    assert overrides(Gather(), Task, "advance")
    assert not overrides(Gather(), Task, "survives")
    assert not has_balls(Gather())
    assert has_balls(Cleaning())
    assert is_scored(Cleaning())


def test_only_the_class_that_states_it_is_batch_invariant():
    assert is_batch_invariant(Cleaning())
    assert not is_batch_invariant(derive(Cleaning)())


STATES = """
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from iswarm_mj import Cleaning, UserError, check_task, without_balls


class Places(NamedTuple):
    x: np.ndarray


@dataclass(frozen=True)
class Placed(Cleaning):
    def lay_out(self, config, n_robots, rng, shared, cell):
        poses, _ = super().lay_out(config, n_robots, rng, shared, cell)
        return poses, Places(np.zeros(n_robots, np.float32))

    def advance(self, state, inputs, key):
        return state, without_balls(len(inputs.poses))


@dataclass(frozen=True)
class WithoutBalls(Placed):
    def balls(self, state):
        return None


for task in (Placed(), WithoutBalls()):
    try:
        check_task(task)
    except UserError as error:
        print(error)
"""
"""Program that checks tasks, without the tests' checks of types, which would say another sentence
before."""

SENTENCES = [
    "Placed.balls must return Balls, or None (got a Places, as it is inherited from Cleaning); "
    "write Placed.balls",
    "WithoutBalls.progress is that of Cleaning, which reads is_delivered of the state, but the "
    "state that WithoutBalls.lay_out returns, a Places, has none; write WithoutBalls.progress, or "
    "return a state that has it",
]


def test_a_state_lacks_what_an_inherited_method_reads():
    process = subprocess.run([sys.executable, "-c", STATES], capture_output=True, text=True)
    assert process.stdout.splitlines() == SENTENCES, process.stderr
