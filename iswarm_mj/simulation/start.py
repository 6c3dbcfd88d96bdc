"""How a run begins: the engine is made, and the worlds are placed in it."""

import importlib.util
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.arena import ArenaModel, compile_arena, read_robot
from iswarm_mj.engines.base import CompiledEngine, Engine
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.sensors.links import Links
from iswarm_mj.simulation.common import common
from iswarm_mj.simulation.compiled_loop import CompiledLoop
from iswarm_mj.simulation.initial import Start
from iswarm_mj.simulation.loop import HostLoop, Loop
from iswarm_mj.simulation.settings import EngineSettings, MjxSettings, PlanarSettings, RunSettings
from iswarm_mj.simulation.state import StepRecord, WorldState
from iswarm_mj.simulation.step import ball_centres
from iswarm_mj.simulation.worlds import World, first_state, vector_strategies, world_params
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.protocol import Strategy
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.layout import cell_of
from iswarm_mj.tasks.protocol import Task
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.profiling import Stopwatch
from iswarm_mj.utils.robot import Robot


class Plan(NamedTuple):
    """What a run is made of."""

    config: SwarmConfig
    """What all worlds share."""
    settings: RunSettings
    engine: EngineSettings
    worlds: Sequence[World]
    """B of them."""
    starts: Sequence[Start]
    """How each of them begins."""
    strategy: Strategy | None
    """With a first axis of B worlds; None for the paper's, with the genome of each world."""
    robot_file: Path | None
    """MJCF file of the robots; None for `models/robot.xml`."""
    goal: int
    """Progress of the task that finishes a world."""
    task: Task = CLEANING
    """With a first axis of B worlds."""


def start_loop(plan: Plan, watch: Stopwatch) -> tuple[Loop, StepRecord]:
    """Make the engine of a run and place its worlds in it.

    Args:
        plan: of the run.
        watch: takes the times of the stages on the host.

    Returns:
        The loop, and the record of the start of the recorded worlds (1, W, ...).
    """
    config, settings, worlds, robot = plan.config, plan.settings, plan.worlds, read_robot(plan.robot_file)
    n_robots, shared = max(world.n_robots for world in worlds), common(config).config
    capacity = settings.capacity or n_robots
    strategy = plan.strategy
    if strategy is None:
        strategy = vector_strategies(config, robot, worlds)
    params = world_params(config, worlds, strategy, plan.goal, capacity, plan.task)
    if config.gripper.bench == "auto":
        shared = replace(shared, gripper=replace(shared.gripper, bench="c" if plan.engine.on_host else "mjx"))
    energy = None if config.energy.model == "none" else config.energy.full
    poses, state = first_state(plan.starts, params, energy)
    start = start_record(state, poses, settings.record_worlds, robot)
    engine = plan.engine
    if engine.on_host:
        make = host_engine(config, engine, n_robots, capacity, plan.robot_file)
        return HostLoop(make, shared, params, (poses, state), getattr(engine, "threads", 0), watch), start
    devices = devices_of(engine)[: len(worlds)]
    is_masked = any(world.n_robots < capacity for world in worlds)
    each = -(-len(worlds) // len(devices))
    made = compiled_engine(config, engine, capacity, each, plan.robot_file, devices[0].platform, is_masked)
    place = made.place if made.mapping(devices[0].platform) == "batch" else jax.vmap(made.place)
    state = state._replace(bodies=place(jnp.asarray(poses, jnp.float32), params.is_present))
    return CompiledLoop(made, shared, params, state, getattr(engine, "chunk", 1), devices), start


def devices_of(engine: EngineSettings) -> list[Any]:
    """Return the JAX devices that an engine of compiled programs is to use."""
    return list(getattr(engine, "devices", None) or jax.local_devices())


def host_engine(
    config: SwarmConfig, engine: EngineSettings, n_robots: int, capacity: int, robot_file: Path | None
) -> Callable[[int, int], Engine]:
    """Return what makes an engine on the host for a number of worlds and of threads.

    Args:
        config: of the run.
        engine: settings of one with `on_host`.
        n_robots: in the largest world.
        capacity: places for robots.
        robot_file: MJCF file of the robots; None for `models/robot.xml`.
    """
    if isinstance(engine, PlanarSettings):  # one robot stands for all, here and below
        one = compile_arena(config, 1, np.zeros(0), robot_file=robot_file, refinement=engine.refinement)
        return lambda n_worlds, n_threads: PlanarEngine(config, one, n_threads)
    arena = compile_arena(config, n_robots, np.zeros(0), robot_file=robot_file)
    return lambda n_worlds, n_threads: MujocoEngine(config, arena, n_worlds, n_threads, capacity)


def compiled_engine(
    config: SwarmConfig,
    engine: EngineSettings,
    capacity: int,
    n_worlds: int,
    robot_file: Path | None,
    platform: str,
    is_masked: bool = False,
) -> CompiledEngine:
    """Return an engine for programs of JAX.

    Args:
        config: of the run.
        engine: settings of one without `on_host`.
        capacity: places for robots.
        n_worlds: of a device.
        robot_file: MJCF file of the robots; None for `models/robot.xml`.
        platform: of the devices.
        is_masked: some worlds have fewer robots than places.
    """
    if isinstance(engine, MjxSettings):
        # Here, since importing MJX takes seconds, which the other engines need not wait for.
        from iswarm_mj.engines.mjx.arena import compile_mjx_arena, contact_capacity
        from iswarm_mj.engines.mjx.engine import MjxEngine

        room = engine.contact_capacity * cell_of(read_robot(robot_file)) ** 2  # large robots cover more of the floor
        buffers = contact_capacity(config, capacity, room)
        arena = compile_mjx_arena(
            config, capacity, engine.impl, n_worlds, buffers, engine.solver_iterations, robot_file
        )
        return MjxEngine(arena, config, is_masked)
    refinement = engine.refinement if isinstance(engine, PlanarSettings) else 1
    one = compile_arena(config, 1, np.zeros(0), robot_file=robot_file, refinement=refinement)
    return _batch_engine(one, config, platform)


def _batch_engine(arena: ArenaModel, config: SwarmConfig, platform: str) -> CompiledEngine:
    """The planar engine for programs of JAX; an optional package compiles it."""
    if importlib.util.find_spec("warp") is None:
        raise UserError("impl warp needs the package warp-lang; run pip install 'iswarm-mj[warp]'.")
    from iswarm_mj.engines.planar.batch_engine import read_engine

    return read_engine(arena, config, platform)


def start_record(state: WorldState, poses: np.ndarray, recorded: Sequence[int], robot: Robot) -> StepRecord:
    """Record of the start of W worlds (1, W, ...), in which nobody has heard anybody.

    Args:
        state: of B worlds.
        poses: (B, N, 3) x, y [mm] and yaw [rad].
        recorded: W worlds.
        robot: its geometry.
    """
    rows = list(recorded)
    swarm: Any = jax.tree.map(lambda a: np.asarray(a)[rows], state.swarm)
    poses = poses[rows]
    sides, zero = (*poses.shape[:2], len(robot.sides)), np.zeros(len(rows), np.int32)
    nothing = [np.zeros(sides, dtype) for dtype in (np.int32, np.bool_, np.int32, np.float32, np.float32)]
    record = StepRecord(
        step=zero,
        poses=poses,
        swarm=swarm,
        links=Links(*nothing),
        has_priority=np.zeros(poses.shape[:2], bool),
        message=np.zeros(poses.shape[:2], np.uint32),
        is_heard=np.zeros(sides, bool),
        measured_distance=np.zeros(sides, np.float32),
        command=Command(*np.zeros((2, *poses.shape[:2]), np.float32)),
        balls=ball_centres(swarm.balls, poses, robot),
        collisions=zero,
        speed=zero.astype(float),
        is_running=zero == 0,
    )
    return jax.tree.map(lambda a: a[None], record)
