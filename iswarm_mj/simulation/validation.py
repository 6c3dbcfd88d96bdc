"""Checks of a strategy, a task or an engine on demand: the same that every run does before it
begins."""

from dataclasses import replace
from typing import Any

from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.simulation.build import exercise_engine
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.setup import set_up
from iswarm_mj.simulation.stacking import of_all_worlds
from iswarm_mj.strategy.teams import check_strategies

USUAL = Scenario(robots=8)
"""Scenario in which something is checked unless another one is given."""


def check_strategy(strategy: Any, scenario: Scenario = USUAL) -> None:
    """Check a strategy: its methods, and the shapes and types of what they return.

    Every run does so before it begins.

    Args:
        strategy: derives from `Strategy` or `StrategyFactory`.
        scenario: everything else, such as the task whose quantities robots sense.

    Raises:
        UserError: one sentence that names the mistake, its file and line, and the cure.
    """
    scenario = replace(scenario, strategy=strategy, steps=1)
    setup = set_up(scenario, scenario.settings())
    strategies = of_all_worlds(
        strategy,
        setup.config,
        setup.robot,
        setup.worlds,
        is_per_world=scenario.strategy_per_world,
    )
    check_strategies(strategies, setup.capacity, len(setup.robot.sides), setup.sensed)


def check_task(task: Any, scenario: Scenario = USUAL) -> None:
    """Check a task: its methods, how a world begins, and what its methods return.

    Every run does so before it begins.

    Args:
        task: derives from `Task`.
        scenario: everything else.

    Raises:
        UserError: one sentence that names the mistake, its file and line, and the cure.
    """
    scenario = replace(scenario, task=task, steps=1)
    set_up(scenario, scenario.settings())


def check_engine(engine: EngineSettings, scenario: Scenario = USUAL) -> None:
    """Check an engine: place robots in two worlds, let them sense, and move them without a command.

    Every run with an engine of a user does so before it begins.

    Args:
        engine: settings of the engine.
        scenario: everything else but the number of worlds.

    Raises:
        UserError: one sentence that names the mistake: shapes, types or the exception of a method,
            or robots that are not where they were placed, or that move without a command.
    """
    scenario = replace(scenario, engine=engine, worlds=2, steps=1)
    exercise_engine(set_up(scenario, scenario.settings()))
