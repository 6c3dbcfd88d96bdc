"""How a run begins: the engine is made, and the worlds are placed in it."""

from collections.abc import Sequence
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.geometry.obstacles import poses_of_boxes
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.links import Links
from iswarm_mj.simulation.compiled_loop import CompiledLoop
from iswarm_mj.simulation.host_loop import HostLoop
from iswarm_mj.simulation.layouts import Start
from iswarm_mj.simulation.setup import Setup
from iswarm_mj.simulation.state import Fault, StepRecord, SwarmState, WorldParams, WorldState
from iswarm_mj.simulation.worlds import arenas_of_worlds, conditions_of_worlds, random_keys
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.contract import zeros_of
from iswarm_mj.strategy.declared import led_power
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.base import Task
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.profiling import Stopwatch

ENDLESS = 2**31 - 1
"""Progress that no task reaches."""


def build_loop(setup: Setup, strategy: Strategy, watch: Stopwatch) -> tuple[HostLoop | CompiledLoop, StepRecord]:
    """Make the engine of a run and place its worlds in it.

    Args:
        setup: of the run.
        strategy: with a first axis of B worlds.
        watch: takes the times of the stages on the host.

    Returns:
        The loop, and the record of the start of the recorded worlds (1, W, ...).
    """
    settings, static, capacity = setup.settings, setup.static, setup.capacity
    keys = random_keys(setup.worlds)
    params = world_params(setup, keys, strategy)
    poses, state = initial_state(setup, initial_memories(strategy, keys, capacity))
    boxes = poses[:, capacity:] if poses.shape[1] > capacity else None
    start = start_record(state, poses[:, :capacity], settings.record_worlds, setup.robot, boxes)
    if setup.engine.on_host:
        n_threads = getattr(setup.engine, "threads", 0)
        return HostLoop(setup.host_engine(), static, params, (poses, state), n_threads, watch), start
    engine, devices = setup.compiled_engine(len(setup.worlds))
    place = engine.place if engine.mapping(devices[0].platform) == "batch" else jax.vmap(engine.place)
    state = state._replace(bodies=place(jnp.asarray(poses, jnp.float32), params.is_present))
    return CompiledLoop(engine, static, params, state, getattr(setup.engine, "chunk", 1), devices), start


def world_params(setup: Setup, keys: Array, strategy: Any) -> WorldParams:
    """Return what stays the same in each world, stacked.

    Args:
        setup: of a run or an environment, with B worlds.
        keys: see `random_keys`, of which the first 64 bits count.
        strategy: with a first axis of B worlds.
    """
    worlds, goal = setup.worlds, ENDLESS if setup.goal is None else setup.goal
    n_robots = np.array([world.n_robots for world in worlds])
    return WorldParams(
        strategy=strategy,
        conditions=conditions_of_worlds(setup.config, worlds),
        key=np.asarray(jax.random.key_data(keys))[:, :2],
        is_present=np.arange(setup.capacity) < n_robots[:, None],
        goal=np.full(len(worlds), goal, np.int32),
        task=setup.tasks,
        arena=arenas_of_worlds(setup.config, worlds),
        is_driven=np.array([[mass == 0 for *_, mass, _ in start.boxes or ()] for start in setup.starts], bool),
    )


@partial(jax.jit, static_argnames=("capacity",))
def initial_memories(strategy: Strategy, key: Array, capacity: int) -> tuple[Any, Float[Array, "B N"] | None]:
    """Return what the robots of B worlds remember at the start, and the power of their LEDs, see `led_power`."""

    def of_world(strategy: Strategy, key: Array) -> Any:
        memory = strategy.init(capacity, key)
        return memory, led_power(strategy, memory)

    return jax.vmap(of_world)(strategy, key)


def initial_state(setup: Setup, first: Any = (None, None)) -> tuple[Float[np.ndarray, "B NM 3"], WorldState]:
    """Return the poses of robots and boxes of B worlds at the start, and their state but for the engine's bodies.

    Robots have full capacitors, if any.

    Args:
        setup: of a run or an environment.
        first: see `initial_memories`.
    """
    starts, task, capacity, energy = setup.starts, setup.task, setup.capacity, setup.config.energy
    n_worlds, has_energy = len(starts), energy.model != "none"
    swarm = SwarmState(
        memory=first[0],
        task=_stacked(task, [start.task for start in starts]),
        is_alive=_padded([np.asarray(start.is_alive) for start in starts], capacity),
        is_loaded=_padded([_loaded(task, start) for start in starts], capacity),
        energy=np.full((n_worlds, capacity), energy.full, np.float32) if has_energy else None,
        steps_without_energy=np.zeros((n_worlds, capacity), np.int32) if has_energy else None,
        led_power=first[1],
    )
    nothing = zeros_of(WorldState, B=(n_worlds,), K=setup.robot.most_partners, N=capacity)
    state = WorldState(bodies=None, swarm=swarm, fault=Fault(**zeros_of(Fault, B=(n_worlds,))), **nothing)
    boxes = np.stack([poses_of_boxes(start.boxes or ()) for start in starts])
    return np.concatenate([_padded([start.poses for start in starts], capacity), boxes], axis=1), state


def _stacked(task: Task, states: Sequence[Any]) -> Any:
    shapes = {tuple(map(np.shape, jax.tree.leaves(state))) for state in states}
    if len(shapes) > 1:
        raise UserError(
            f"the state of {type(task).__name__} has other shapes in worlds with other numbers of robots; "
            "give all worlds the same number"
        )
    return jax.tree.map(lambda *values: np.stack(values), *states)


def _loaded(task: Task, start: Start) -> Bool[np.ndarray, "N"]:
    """Which robots hold a ball at the start."""
    loaded = np.zeros(len(start.poses), bool)
    balls = task.balls(start.task)
    if balls is not None:
        loaded[np.asarray(balls.holder)[np.asarray(balls.is_held)]] = True
    return loaded


def _padded(each: Sequence[np.ndarray], capacity: int) -> np.ndarray:
    """Values of the robots of each world, stacked, with zeros or false for empty places."""
    filled = np.zeros((len(each), capacity, *each[0].shape[1:]), each[0].dtype)
    for row, values in zip(filled, each, strict=True):
        row[: len(values)] = values
    return filled


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
    sizes = {"T": (len(rows),), "B": (len(rows),), "N": poses.shape[1], "S": len(robot.sides)}
    record = StepRecord(
        **zeros_of(StepRecord, **sizes)
        | {"poses": poses[rows], "is_running": np.ones(len(rows), bool), "speed": np.zeros(len(rows))},
        swarm=jax.tree.map(lambda a: np.asarray(a)[rows], state.swarm),
        links=Links(**zeros_of(Links, **sizes)),
        command=Command(**zeros_of(Command, N=poses[rows].shape[:2])),
        boxes=None if boxes is None else boxes[rows],
    )
    return jax.tree.map(lambda a: a[None], record)
