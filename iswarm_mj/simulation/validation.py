"""Checks of a strategy, a task or an engine on demand.

Strategies and tasks are checked as every run does before it begins; engines are tried, too.
"""

from dataclasses import replace
from typing import Any

import jax
import numpy as np

from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.simulation.actuate import drive_phases
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.setup import Setup, set_up
from iswarm_mj.simulation.stacking import of_all_worlds
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.validation import check_strategies
from iswarm_mj.utils.errors import UserError

USUAL = Scenario(robots=8)
"""Scenario in which something is checked unless another one is given."""
N_WORLDS = 2
"""Worlds in which an engine is tried."""
STILL_MM = 0.05
"""Distance by which contacts may move robots that do not drive [mm]."""
STILL_RAD = 0.05
"""Angle by which contacts may turn them [rad]."""


def check_strategy(strategy: Any, scenario: Scenario = USUAL) -> None:
    """Check a strategy as a run would: its methods, and the shapes and types of what they return.

    Args:
        strategy: derives from `Strategy` or `StrategyFactory`.
        scenario: all else of the run, such as the task whose quantities robots sense.

    Raises:
        UserError: what is wrong, in one sentence with file, line and cure.
    """
    scenario = replace(scenario, strategy=strategy, steps=1)
    setup = set_up(scenario, scenario.settings())
    strategies = of_all_worlds(
        strategy, setup.config, setup.robot, setup.worlds, is_per_world=scenario.strategy_per_world
    )
    check_strategies(strategies, setup.capacity, len(setup.robot.sides), setup.sensed)


def check_task(task: Any, scenario: Scenario = USUAL) -> None:
    """Check a task as a run would: its methods, how a world begins, and what its methods return.

    Args:
        task: derives from `Task`.
        scenario: all else of the run.

    Raises:
        UserError: what is wrong, in one sentence with file, line and cure.
    """
    scenario = replace(scenario, task=task, steps=1)
    set_up(scenario, scenario.settings())


def check_engine(engine: EngineSettings, scenario: Scenario = USUAL) -> None:
    """Check an engine: place robots in two worlds, let them sense, and move them by a command of
    zero.

    Args:
        engine: settings of the engine.
        scenario: all else of the run, but for its number of worlds.

    Raises:
        UserError: what is wrong, in one sentence: a method's shapes, types or exception, or robots
            that do not stand where they were placed, or that move without a command.
    """
    scenario = replace(scenario, engine=engine, worlds=N_WORLDS, steps=1)
    setup = set_up(scenario, scenario.settings())
    poses = np.stack([start.poses for start in setup.starts])
    is_present = np.ones(poses.shape[:2], bool)
    is_running = np.ones(N_WORLDS, bool)
    command = Command(np.zeros(poses.shape[:2], np.float32), np.zeros(poses.shape[:2], np.float32))

    if engine.on_host:
        made = setup.host_engine()(N_WORLDS, 1)
        first, last, _ = _try(made, setup, poses, is_present, is_running, command)
    else:
        made, devices = setup.compiled_engine(N_WORLDS)

        def trial(*arrays: Any) -> Any:
            return _try(made, setup, *arrays)

        acts_on_all = made.mapping(devices[0].platform) == "batch"
        program = jax.jit(trial if acts_on_all else jax.vmap(trial))
        arrays = poses.astype(np.float32), is_present, is_running, command
        first, last, _ = jax.tree.map(np.asarray, program(*arrays))

    name = getattr(made, "name", type(made).__name__)  # engines of users are wrapped
    _check_still(f"{name}.place must put robots where it is told", first - poses)
    _check_still(f"{name}.move must leave robots that have no command where they are", last - first)


def _try(
    engine: Any, setup: Setup, poses: Any, is_present: Any, is_running: Any, command: Command
) -> tuple[Any, Any, Any]:
    """Return where robots are after they were placed and after a control step, and what they
    sensed."""
    bodies = engine.place(poses, is_present)
    first = engine.poses(bodies)
    sight = engine.sense(bodies, is_present, is_running)
    phases = drive_phases(setup.static.drive, command)
    last = engine.poses(engine.move(bodies, phases, is_running).bodies)
    return first, last, sight


def _check_still(rule: str, way: np.ndarray) -> None:
    """Raise a UserError if robots moved, or are nowhere."""
    farthest, turned = (float(np.abs(part).max()) for part in (way[..., :2], way[..., 2]))
    if not (farthest <= STILL_MM and turned <= STILL_RAD):
        raise UserError(
            f"{rule} (a robot is {farthest:g} mm and {turned:g} rad away); correct the engine"
        )
