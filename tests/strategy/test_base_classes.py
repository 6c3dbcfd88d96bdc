"""Base classes of what users write: each mistake in their methods is one sentence, and defaults do
nothing."""

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
    def init(self, n_robots, key):
        return jnp.zeros(n_robots)

    def picks(self, memory):
        return memory < 0

    def act(self, memory, observation, key):
        return memory, Command(memory, memory)


class Gather(Task):
    def lay_out(self, config, n_robots, rng, shared, cell):
        return np.zeros((n_robots, 3)), ()

    def advance(self, state, inputs, key):
        return state, without_balls(len(inputs.poses))


def mine(base=Walk, **methods):
    return type("Mine", (base,), methods)


SPEAKS = {"payload": {"word": Integer(3)}, "say": lambda self, memory, is_loaded: {"word": memory}}


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (
            mine(release=Walk.picks),
            "Mine.release is never used: Strategy has releases, but no release; rename it",
        ),
        (mine(led_powers=Walk.picks), "Strategy has led_power"),
        (mine(record=("x",), releases=Walk.picks), "Strategy has recorded, but no record"),
        (mine(payloads={}), "Strategy has payload, but no payloads"),
        (mine(_release=Walk.picks), None),
        (mine(turn_aside=Walk.picks), None),
        (mine(act=None), "Mine has no method act; a strategy has it, see Strategy"),
        (
            type("Mine", (Strategy,), {"init": Walk.init}),
            "Mine has no method act and no method picks",
        ),
        (
            type("Mine", (), {"init": 1, "picks": 1, "act": 1}),
            r"write class Mine\(Strategy\), with from iswarm_mj",
        ),
        (
            mine(say=lambda self, memory, is_loaded: {}),
            "has a method say, but no attribute payload",
        ),
        (mine(payload={"word": Integer(3)}), "has an attribute payload, but no method say"),
        (mine(**SPEAKS), None),
        (type("Mine", (StrategyFactory,), {"for_world": None}), "Mine has no method for_world"),
        (type("Mine", (StrategyFactory,), {"for_world": Walk.init}), None),
    ],
)
def test_methods_of_a_strategy_are_there_and_spelt_as_in_the_base_class(given, sentence):
    if sentence is None:
        check_methods(given)
        return
    with pytest.raises(UserError, match=sentence):
        check_methods(given)


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        (
            mine(Gather, survive=Walk.picks),
            "Mine.survive is never used: Task has survives, but no survive",
        ),
        (mine(Cleaning, drive_box=Walk.picks), "Task has drive_boxes"),
        (mine(Cleaning, goals=Walk.picks), "Mine.goals is never used: Task has goal, but no goals"),
        (mine(Cleaning, goals=Walk.picks, goal=Cleaning.goal), None),
        (mine(Cleaning, sense={"light": Quantity("of the sun")}), "Task has senses"),
        (mine(Gather, area=Walk.picks, areas=Walk.picks), None),
        (mine(Gather, advance=None), "Mine has no method advance; a task has it, see Task"),
        (type("Mine", (Walk,), {}), "Mine is not a task, since it does not derive from Task"),
        (Gather, None),
        (Cleaning, None),
    ],
)
def test_methods_of_a_task_are_there_and_spelt_as_in_the_base_class(given, sentence):
    if sentence is None:
        check_task_methods(given)
        return
    with pytest.raises(UserError, match=sentence):
        check_task_methods(given)


def test_fields_of_a_dataclass_may_be_called_nearly_as_a_method():
    @dataclass(frozen=True)
    class Lamp(Gather):
        goals: float = 2.0
        measured: ClassVar = {}

    check_task_methods(Lamp())


def test_defaults_change_nothing():
    walk, memory = Walk(), jnp.arange(3.0)
    assert (
        walk.releases(memory) is walk.led_power(memory) is None
        and walk.say(memory, memory > 0) == {}
    )
    assert (
        walk.correct_odometry(memory, memory)
        is walk.listen(memory, None, jax.random.key(0))
        is memory
    )
    assert walk.for_world(None, None, 3) is walk and not makes_strategies(walk)
    task = Gather()
    assert task.survives(()) is task.drive_boxes(()) is task.balls(()) is task.goal(None, 3) is None
    assert task.conditions((), memory) is memory and task.areas(None, ()) == task.metrics(()) == {}
    assert not overrides(task, Task, "survives") and overrides(task, Task, "advance")
    assert not has_balls(task) and has_balls(Cleaning()) and is_scored(Cleaning())


def test_only_the_class_that_states_it_is_batch_invariant():
    assert is_batch_invariant(Cleaning()) and not is_batch_invariant(mine(Cleaning)())


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
"""In a process of its own, since tests check the types of arguments, which says another sentence
before."""


def test_a_state_lacks_what_an_inherited_method_reads():
    done = subprocess.run([sys.executable, "-c", STATES], capture_output=True, text=True)
    assert done.stdout.splitlines() == [
        "Placed.balls must return Balls, or None (got a Places, as it is inherited from Cleaning); write Placed.balls",
        "WithoutBalls.progress is that of Cleaning, which reads is_delivered of the state, but the state that "
        "WithoutBalls.lay_out returns, a Places, has none; write WithoutBalls.progress, or return a state that has it",
    ], done.stderr
