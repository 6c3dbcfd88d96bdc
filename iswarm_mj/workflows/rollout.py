"""Rollouts of any strategy in many worlds at once: one call, arrays with a world axis."""

from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from types import NoneType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.robot_file import as_robot_file, read_robots
from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.geometry.robot import RobotFile
from iswarm_mj.simulation.layouts import Start, draw_start_with
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario, config_of, refuse_beside_scenario
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.genome import TYPE1, Genome
from iswarm_mj.tasks.base import Task
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.constraints import check, check_kind, is_whole
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.utils.files import check_name
from iswarm_mj.utils.signals import saved
from iswarm_mj.workflows.recorder import Recorder, advanced


class Rollout(NamedTuple):
    """Results of B worlds, as NumPy arrays with the worlds first; see `tasks.measures.Measures`."""

    delivered: np.ndarray
    """(B,) balls at the dump at the end; undefined, like `picked` and carriage, for tasks without a dump."""
    picked: np.ndarray
    """(B,) balls picked up at least once."""
    collisions: np.ndarray
    """(B,) pairs of robots in contact that were not in contact one control step earlier, summed over the steps."""
    mean_carriage_steps: np.ndarray
    """(B,) mean control steps for which a delivered ball was carried; NaN where none was delivered."""
    is_finished: np.ndarray
    """(B,) bool, the goal was reached, in cleaning all balls delivered; the world stands still from then on."""
    finished_at: np.ndarray
    """(B,) control step after which the goal was reached; 0 where it was not."""
    steps: np.ndarray
    """(C,) control steps after which progress was counted."""
    delivered_after: np.ndarray
    """(B, C) progress of the task after these steps, in cleaning balls at the dump."""
    poses: np.ndarray | None
    """(W, 1 + steps, N, 3) x, y [mm] and yaw [rad] of the worlds in `poses_of`, from the start on; None without any."""
    faults: list[SimulationFault]
    """Faults of worlds; their measures count up to the fault."""
    metrics: dict[str, np.ndarray]
    """(B,) metrics of the task at the end, by their names."""


def rollout(
    scenario: Scenario | SwarmConfig | None = None,
    strategy: Strategy | Genome | Any = None,
    keys: jax.Array | None = None,
    *,
    config: SwarmConfig | None = None,
    n_robots: int | Sequence[int] | None = None,
    steps: int | None = None,
    engine: EngineSettings | None = None,
    strategy_per_world: bool = False,
    task: Task | Any = None,
    robot_file: RobotFile = None,
    stop_at: int | None = None,
    every: int = 10,
    poses_of: Sequence[int] = (),
    record: str | Path | None = None,
) -> Rollout:
    """Run a strategy in B worlds.

    `rollout(scenario)` is of the worlds of a scenario, those of `Run(scenario)`; the parts of a scenario can be given
    one by one in its place, with keys.

    A key determines its world: positions of robots and balls at the start, radii and adhesion of the balls (NumPy's
    generator, seeded by the key's data), then the noise and the strategy's random numbers (the key itself). Different
    strategies with the same keys meet the same worlds.

    Programs are compiled for each configuration, class of strategy, number of robots and `every`, but not for values of
    the strategy's arrays.

    Args:
        scenario: what is simulated; or what all worlds share, as `config`.
        strategy: a genome or a `strategy.base.Strategy`.
        keys: (B,) from `jax.random.split(jax.random.key(seed), B)`; with a scenario, in place of its seed and worlds.
        config: what all worlds share.
        n_robots: N, in each world or of each world.
        steps: maximum control steps.
        engine: `MjxSettings()` by default, for GPUs; on a CPU `PlanarSettings()` or `MujocoSettings()` are much faster.
        strategy_per_world: the arrays of `strategy` have a first axis of B worlds.
        task: a `tasks.base.Task`; cleaning by default.
        robot_file: MJCF file of the robots, or of each kind (`RobotFile`); None for `models/robot.xml`.
        stop_at: progress at which a world is finished, in cleaning balls delivered; None for the task's goal.
        every: control steps between counts of progress; the last step is always counted.
        poses_of: numbers of the W worlds whose poses are kept.
        record: file, `*.rrd`, for a recording of the first of these worlds, or of world 0; open it with `rerun`.

    Raises:
        UserError: keys, robots, settings or strategy do not fit, or the recording cannot be written; or parts beside a
            scenario.
    """
    worlds: Sequence[World] | None = None
    n_worlds = 1
    seed = 0
    if isinstance(scenario, Scenario):
        refuse_beside_scenario(
            config=config,
            strategy=strategy,
            n_robots=n_robots,
            steps=steps,
            engine=engine,
            task=task,
            robot_file=robot_file,
            stop_at=stop_at,
        )
        config = scenario.config
        strategy = scenario.strategy
        n_robots = scenario.n_robots
        steps = scenario.steps
        engine = scenario.engine
        task = scenario.task
        robot_file = scenario.robot_file
        stop_at = scenario.goal
        seed = scenario.seed
        n_worlds = scenario.n_worlds
        worlds = None if isinstance(scenario.worlds, int) else scenario.worlds
        if keys is not None and scenario.worlds != 1:
            raise UserError("keys are given beside a scenario with worlds of its own; give it worlds=1")
    else:
        config = config_of(scenario, config)
        engine = MjxSettings() if engine is None else engine
    if keys is not None or not isinstance(scenario, Scenario):
        n_worlds = _number_of(keys)
    check_kind("record", record, (str, Path, NoneType))
    if record is not None:
        check_name(record, ".rrd", setting="record")
    check_kind("poses_of", poses_of, (list, tuple, range))
    check("every", every, "a whole number between 1 and 10000", is_whole(every) and 1 <= every <= 10_000)
    every = int(every)
    known = all(is_whole(world) and world in range(n_worlds) for world in poses_of)
    known = known and len(set(poses_of)) == len(poses_of)
    check("poses_of", tuple(poses_of), f"distinct worlds from 0 to {n_worlds - 1}", known)
    recorded = tuple(poses_of) or (() if record is None else (0,))
    numbers: list[Any] = list(n_robots) if isinstance(n_robots, Sequence) else [n_robots] * n_worlds
    are_numbers = len(numbers) == n_worlds and all(map(is_whole, numbers))
    check("n_robots", n_robots, f"a whole number, or a list of one for each of {n_worlds} worlds", are_numbers)
    if steps is None:
        raise UserError("steps are missing; give `steps`, the number of control steps at most")
    settings = RunSettings(max(numbers), steps, seed, n_worlds, stop_at, record_worlds=recorded)
    engine = engine.in_chunks(every) if isinstance(engine, EngineSettings) else engine
    task = CLEANING if task is None else task
    if keys is not None:
        worlds = _worlds_of_keys(config, strategy, task, robot_file, keys, numbers)
    run = Run(
        config,
        strategy,
        settings,
        engine,
        worlds=worlds,
        strategy_per_world=strategy_per_world,
        task=task,
        robot_file=robot_file,
    )
    counted = np.minimum(np.arange(every, steps + every, every), steps)
    delivered, poses = np.tile(run.progress()[:, None].astype(int), len(counted)), [run.start.poses]
    recorders = [] if record is None else [Recorder(run, Path(record))]
    with saved(recorders[0].save) if recorders else nullcontext():
        for taken in advanced(run, recorders):
            poses += [] if taken is None else [np.asarray(taken.poses)]
            delivered[:, counted >= run.step] = run.progress()[:, None]
    found: Any = None
    if poses_of:  # after the last block the robots rest
        found = np.concatenate([np.asarray(block) for block in poses]).swapaxes(0, 1).astype(np.float32)
        found = np.concatenate([found, np.repeat(found[:, -1:], 1 + steps - found.shape[1], axis=1)], axis=1)
    measures = [run.measures(world) for world in range(n_worlds)]
    counts = {name: np.array([getattr(m, name) for m in measures]) for name in ("delivered", "picked", "collisions")}
    return Rollout(
        **counts,
        mean_carriage_steps=np.array([m.mean_carriage_steps for m in measures], float),  # NaN for None
        is_finished=np.array([m.finished_at is not None for m in measures]),
        finished_at=np.array([m.finished_at or 0 for m in measures]),
        steps=counted,
        delivered_after=delivered,
        poses=found,
        faults=run.faults,
        metrics=run.metrics(),
    )


def _worlds_of_keys(
    config: SwarmConfig, strategy: Any, task: Any, robot_file: RobotFile, keys: jax.Array, numbers: Sequence[int]
) -> list[World]:
    """Return worlds with so many robots each that keys determine."""
    robot = read_robots(as_robot_file(robot_file))
    genome = strategy if isinstance(strategy, Genome) else TYPE1  # which is ignored

    starts: dict[tuple[bytes, int], Start] = {}  # worlds of the same key begin alike
    worlds = []
    for index, (number, data) in enumerate(zip(numbers, np.asarray(jax.random.key_data(keys)), strict=True)):
        if (which := (data.tobytes(), int(number))) not in starts:
            rng = np.random.default_rng(data)
            starts[which] = draw_start_with(config, task, robot, which[1], rng, rng)
        worlds.append(World(genome, which[1], index=index, start=starts[which], key=keys[index]))
    return worlds


def _number_of(keys: Any) -> int:
    """Return the number of random keys.

    Raises:
        UserError: they are none.
    """
    is_key = isinstance(keys, jax.Array) and jnp.issubdtype(keys.dtype, jax.dtypes.prng_key)
    if not is_key or keys.ndim != 1 or not len(keys):
        given = f"{keys.dtype}{list(keys.shape)}" if hasattr(keys, "shape") else f"a {type(keys).__name__}"
        raise UserError(
            f"keys was {given}; it must be random keys, one for each world: "
            "make B of them by jax.random.split(jax.random.key(0), B)."
        )
    return len(keys)
