"""How a run begins: the engine is made, and the worlds are placed in it."""

from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.sensors.links import Links
from iswarm_mj.simulation.compiled_loop import CompiledLoop
from iswarm_mj.simulation.loop import HostLoop
from iswarm_mj.simulation.setup import Setup
from iswarm_mj.simulation.state import StepRecord, WorldState
from iswarm_mj.simulation.worlds import first_memories, first_state, random_keys, world_params
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.protocol import Strategy
from iswarm_mj.utils.profiling import Stopwatch
from iswarm_mj.utils.robot import Robots


def start_loop(setup: Setup, strategy: Strategy, watch: Stopwatch) -> tuple[HostLoop | CompiledLoop, StepRecord]:
    """Make the engine of a run and place its worlds in it.

    Args:
        setup: of the run.
        strategy: with a first axis of B worlds.
        watch: takes the times of the stages on the host.

    Returns:
        The loop, and the record of the start of the recorded worlds (1, W, ...).
    """
    config, settings, program, capacity = setup.config, setup.settings, setup.program_config, setup.capacity
    keys = random_keys(setup.worlds)
    params = world_params(config, setup.worlds, keys, strategy, setup.tasks, setup.goal, capacity)
    first = first_memories(strategy, keys, capacity)
    poses, state = first_state(config, setup.starts, setup.task, setup.robot, capacity, first)
    boxes = poses[:, capacity:] if poses.shape[1] > capacity else None
    start = start_record(state, poses[:, :capacity], settings.record_worlds, setup.robot, boxes)
    if setup.engine.on_host:
        n_threads = getattr(setup.engine, "threads", 0)
        return HostLoop(setup.host_engine(), program, params, (poses, state), n_threads, watch), start
    engine, devices = setup.compiled_engine(len(setup.worlds))
    place = engine.place if engine.mapping(devices[0].platform) == "batch" else jax.vmap(engine.place)
    state = state._replace(bodies=place(jnp.asarray(poses, jnp.float32), params.is_present))
    return CompiledLoop(engine, program, params, state, getattr(setup.engine, "chunk", 1), devices), start


def start_record(
    state: WorldState, poses: np.ndarray, recorded: Sequence[int], robot: Robots, boxes: np.ndarray | None
) -> StepRecord:
    """Record of the start of W worlds (1, W, ...), in which nobody has heard anybody.

    Args:
        state: of B worlds.
        poses: (B, N, 3) x, y [mm] and yaw [rad].
        recorded: W worlds.
        robot: its geometry.
        boxes: (B, M, 3) likewise; None where there are none.
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
        command=Command(np.zeros(poses.shape[:2], np.float32), np.zeros(poses.shape[:2], np.float32)),
        collisions=zero,
        speed=zero.astype(float),
        is_running=zero == 0,
        boxes=None if boxes is None else boxes[rows],
    )
    return jax.tree.map(lambda a: a[None], record)
