"""How a run begins: the engine is made, and the worlds are placed in it."""

from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mjx.arena import compile_mjx_arena, contact_capacity
from iswarm_mj.engines.mjx.engine import MjxEngine
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.sensors.links import Links
from iswarm_mj.sensors.optics import N_SIDES
from iswarm_mj.simulation.compiled_loop import CompiledLoop
from iswarm_mj.simulation.initial import Start
from iswarm_mj.simulation.loop import HostLoop, Loop
from iswarm_mj.simulation.settings import EngineSettings, MjxSettings, MujocoSettings, RunSettings
from iswarm_mj.simulation.state import StepRecord, WorldParams, WorldState
from iswarm_mj.simulation.step import ball_centres
from iswarm_mj.simulation.worlds import World, first_state, vector_strategies, world_params
from iswarm_mj.strategy.protocol import Strategy
from iswarm_mj.utils.profiling import Stopwatch
from iswarm_mj.utils.robot import Robot


def start_loop(
    config: SwarmConfig, worlds: Sequence[World], starts: Sequence[Start], strategy: Strategy | None,
    settings: RunSettings, engine: EngineSettings, watch: Stopwatch,
) -> tuple[Loop, StepRecord]:  # fmt: skip
    """Make the engine and place the worlds in it.

    Args:
        config: what all worlds share.
        worlds: B of them.
        starts: how each begins.
        strategy: with a first axis of B worlds; None for the paper's, with the genome of each world.
        settings: of the run.
        engine: settings of the engine.
        watch: takes the times of the engine's stages.

    Returns:
        The loop, and the record of the start of the recorded worlds (1, W, ...).
    """
    n_robots = max(world.n_robots for world in worlds)
    capacity = settings.capacity or n_robots
    goal = settings.stop_at or config.arena.n_dust

    def begin(robot: Robot) -> tuple[WorldParams, np.ndarray, WorldState]:
        own = vector_strategies(config, robot.probe_tip[0], worlds) if strategy is None else strategy
        params = world_params(config, worlds, own, goal, capacity)
        return params, *first_state(starts, params)

    match engine:
        case MujocoSettings():
            arena = compile_arena(config, n_robots, np.zeros(0))
            made = MujocoEngine(config, arena, len(worlds), engine.threads, capacity)
            params, poses, state = begin(made.robot)
            state = state._replace(bodies=made.place(poses, params.is_present))
            loop: Loop = HostLoop(made, config, params, state, watch)
        case MjxSettings():
            devices = list(engine.devices or jax.local_devices())
            made = _mjx_engine(config, worlds, capacity, engine, len(devices))
            params, poses, state = begin(made.robot)
            loop = CompiledLoop(made, config, params, state, poses, engine.chunk, devices)
    return loop, start_record(state, poses, settings.record_worlds, made.robot)


def _mjx_engine(
    config: SwarmConfig, worlds: Sequence[World], capacity: int, settings: MjxSettings, n_devices: int
) -> MjxEngine:
    buffers = contact_capacity(config, capacity, settings.contact_capacity)
    each = -(-len(worlds) // min(n_devices, len(worlds)))
    arena = compile_mjx_arena(config, capacity, settings.impl, each, buffers, settings.solver_iterations)
    return MjxEngine(arena, config, is_masked=any(world.n_robots < capacity for world in worlds))


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
    sides, zero = (*poses.shape[:2], N_SIDES), np.zeros(len(rows), np.int32)
    nothing = [np.zeros(sides, dtype) for dtype in (np.int32, np.bool_, np.int32, np.float32, np.float32)]
    record = StepRecord(
        step=zero,
        poses=poses,
        swarm=swarm,
        links=Links(*nothing),
        has_priority=np.zeros(poses.shape[:2], bool),
        balls=ball_centres(swarm.balls, poses, robot),
        collisions=zero,
        speed=zero.astype(float),
        is_running=zero == 0,
    )
    return jax.tree.map(lambda a: a[None], record)
