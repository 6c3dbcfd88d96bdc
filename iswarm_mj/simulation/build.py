"""Building of a run: the engine is made, and the worlds are placed in it."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.engines.validation import check_engine
from iswarm_mj.geometry.obstacles import BOX_FIELDS, poses_of_boxes
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.links import Links
from iswarm_mj.simulation.compiled_loop import CompiledLoop, placed_bodies
from iswarm_mj.simulation.failures import failing_steps
from iswarm_mj.simulation.host_loop import HostLoop
from iswarm_mj.simulation.layouts import Start
from iswarm_mj.simulation.memory_limits import devices_of
from iswarm_mj.simulation.setup import Setup
from iswarm_mj.simulation.state import Fault, StepRecord, SwarmState, WorldParams, WorldState
from iswarm_mj.simulation.worlds import (
    World,
    arenas_of_worlds,
    conditions_of_worlds,
    random_keys,
)
from iswarm_mj.strategy.attributes import led_power
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.base import Task
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.declared_shapes import zeros_of
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.profiling import Stopwatch

UNREACHABLE_GOAL = 2**31 - 1
"""Goal of a world that never finishes: progress that no task reaches."""

_MAX_EXERCISED = 2
"""Largest number of worlds in which an engine is exercised: two may differ, as in a run of many."""

_MASS = BOX_FIELDS.index("mass")


class InitialMemories(NamedTuple):
    """Contribution of the strategy to the state at the start."""

    memory: Any = None
    """Memories of the robots of B worlds; None where no strategy acts, as in environments."""
    led_power: Float[Array, "B N"] | None = None
    """Power of their LEDs, from 0 to 1; None where all send at full power."""


def build_loop(
    setup: Setup, strategy: Strategy, watch: Stopwatch
) -> tuple[HostLoop | CompiledLoop, StepRecord]:
    """Make the engine of a run and place its worlds in it.

    Args:
        setup: checked parts of the run.
        strategy: strategy with a first axis of B worlds.
        watch: takes the times of the stages on the host.

    Returns:
        The loop, and the record of the start of the recorded worlds (1, W, ...).

    Raises:
        UserError: the engine is a user's, and wrong.
    """
    if not setup.engine.is_shipped:
        exercise_engine(setup)

    n_robots = setup.capacity
    keys = random_keys(setup.worlds)
    params = world_params(setup, keys, strategy)
    poses, state = initial_state(setup, initial_memories(strategy, keys, n_robots))

    has_boxes = poses.shape[1] > n_robots
    start = start_record(
        state=state,
        poses=poses[:, :n_robots],
        recorded=setup.settings.record_worlds,
        robot=setup.robot,
        boxes=poses[:, n_robots:] if has_boxes else None,
    )

    if setup.engine.on_host:
        host_loop = HostLoop(
            make_engine=setup.host_engine(),
            config=setup.static,
            params=params,
            start=(poses, state),
            n_threads=getattr(setup.engine, "threads", 0),
            watch=watch,
        )
        return host_loop, start

    engine, devices = setup.compiled_engine(len(setup.worlds))
    bodies = placed_bodies(engine, devices[0].platform, poses, params.is_present)
    state = state._replace(bodies=bodies)
    compiled_loop = CompiledLoop(
        engine=engine,
        config=setup.static,
        params=params,
        state=state,
        chunk=getattr(setup.engine, "chunk", 1),
        devices=devices,
    )
    return compiled_loop, start


def exercise_engine(setup: Setup) -> None:
    """Check the engine of a run in its first worlds, see `engines.validation.check_engine`.

    Raises:
        UserError: the engine is wrong.
    """
    n_worlds = min(setup.settings.n_worlds, _MAX_EXERCISED)
    check_engine(
        settings=setup.engine,
        model=setup.model,
        robot=setup.robot,
        poses=_initial_poses(setup.starts[:n_worlds], setup.capacity),
        is_present=_taken_places(setup.worlds[:n_worlds], setup.capacity),
        device=None if setup.engine.on_host else devices_of(setup.engine)[0],
    )


def world_params(setup: Setup, keys: Array, strategy: Any) -> WorldParams:
    """Return the parameters of B worlds.

    Args:
        setup: checked parts of a run or an environment, with B worlds.
        keys: random keys of the worlds (`random_keys`), of which the first 64 bits count.
        strategy: strategy with a first axis of B worlds.
    """
    worlds = setup.worlds
    goal = UNREACHABLE_GOAL if setup.goal is None else setup.goal
    failures: Any = setup.scenario.failing  # parsed when the scenario was made
    is_driven = [[box[_MASS] == 0 for box in start.boxes or ()] for start in setup.starts]
    key_data = np.asarray(jax.random.key_data(keys))[:, :2]
    return WorldParams(
        strategy=strategy,
        conditions=conditions_of_worlds(setup.config, worlds),
        key=key_data,
        is_present=_taken_places(worlds, setup.capacity),
        goal=np.full(len(worlds), goal, np.int32),
        task=setup.tasks,
        arena=arenas_of_worlds(setup.config, worlds),
        is_driven=np.array(is_driven, bool),
        fails_at=failing_steps(
            failures,
            key_data,
            [world.n_robots for world in worlds],
            setup.capacity,
        ),
    )


@partial(jax.jit, static_argnames=("n_robots",))
def initial_memories(strategy: Strategy, keys: Array, n_robots: int) -> InitialMemories:
    """Return the memories of the robots of B worlds at the start, and the power of their LEDs."""

    def of_world(strategy: Strategy, key: Array) -> InitialMemories:
        memory = strategy.init(n_robots, key)
        return InitialMemories(memory, led_power(strategy, memory))

    return jax.vmap(of_world)(strategy, keys)


def initial_state(
    setup: Setup, memories: InitialMemories | None = None
) -> tuple[Float[np.ndarray, "B NM 3"], WorldState]:
    """Return poses of robots and boxes of B worlds at the start, and their state without bodies.

    Capacitors, if any, are full.

    Args:
        setup: checked parts of a run or an environment.
        memories: memories of the robots; None where no strategy acts.
    """
    starts = setup.starts
    task = setup.task
    n_robots = setup.capacity
    n_worlds = len(starts)
    memories = InitialMemories() if memories is None else memories

    energy = None
    steps_without_energy = None
    if setup.config.energy.model != "none":
        energy = np.full((n_worlds, n_robots), setup.config.energy.full, np.float32)
        steps_without_energy = np.zeros((n_worlds, n_robots), np.int32)

    swarm = SwarmState(
        memory=memories.memory,
        task=_stacked(task, [start.task for start in starts]),
        is_alive=_padded([np.asarray(start.is_alive) for start in starts], n_robots),
        is_loaded=_padded([_is_loaded(task, start) for start in starts], n_robots),
        energy=energy,
        steps_without_energy=steps_without_energy,
        led_power=memories.led_power,
    )
    fault = Fault(**zeros_of(Fault, B=(n_worlds,)))
    zeros = zeros_of(WorldState, B=(n_worlds,), K=setup.robot.most_partners, N=n_robots)
    state = WorldState(bodies=None, swarm=swarm, fault=fault, **zeros)

    return _initial_poses(starts, n_robots), state


def _initial_poses(starts: Sequence[Start], n_places: int) -> Float[np.ndarray, "B NM 3"]:
    """Return the poses of robots, and of boxes after them, at the start of B worlds."""
    robots = _padded([start.poses for start in starts], n_places)
    boxes = np.stack([poses_of_boxes(start.boxes or ()) for start in starts])
    return np.concatenate([robots, boxes], axis=1)


def _taken_places(worlds: Sequence[World], n_places: int) -> Bool[np.ndarray, "B N"]:
    """Return which places for robots are taken in B worlds."""
    n_robots = np.array([world.n_robots for world in worlds])
    return np.arange(n_places) < n_robots[:, None]


def _stacked(task: Task, states: Sequence[Any]) -> Any:
    """Return the states of a task in all worlds as one.

    Raises:
        UserError: they have different shapes.
    """
    shapes = {tuple(map(np.shape, jax.tree.leaves(state))) for state in states}
    if len(shapes) > 1:
        raise UserError(
            f"the state of {type(task).__name__} has other shapes in worlds with other numbers of "
            "robots; give all worlds the same number"
        )
    return jax.tree.map(lambda *values: np.stack(values), *states)


def _is_loaded(task: Task, start: Start) -> Bool[np.ndarray, "N"]:
    """Return which robots hold a ball at the start."""
    is_loaded = np.zeros(len(start.poses), bool)
    balls = task.balls(start.task)
    if balls is not None:
        holders = np.asarray(balls.holder)[np.asarray(balls.is_held)]
        is_loaded[holders] = True
    return is_loaded


def _padded(values_of_worlds: Sequence[np.ndarray], n_places: int) -> np.ndarray:
    """Return values of the robots of each world, stacked, with zeros or false for empty places."""
    first = values_of_worlds[0]
    padded = np.zeros((len(values_of_worlds), n_places, *first.shape[1:]), first.dtype)
    for row, values in zip(padded, values_of_worlds, strict=True):
        row[: len(values)] = values
    return padded


def start_record(
    state: WorldState,
    poses: np.ndarray,
    recorded: Sequence[int],
    robot: Robots,
    boxes: np.ndarray | None,
) -> StepRecord:
    """Return the record of the start of W worlds (1, W, ...), when nobody has heard anybody.

    Args:
        state: state of B worlds.
        poses: x, y [mm] and yaw [rad] of the robots (B, N, 3).
        recorded: W worlds.
        robot: geometry of the robots.
        boxes: poses of the boxes (B, M, 3); None where there are none.
    """
    rows = list(recorded)
    n_worlds = len(rows)
    n_robots = poses.shape[1]
    sizes = {"T": (n_worlds,), "B": (n_worlds,), "N": n_robots, "S": len(robot.sides)}

    fields = zeros_of(StepRecord, **sizes)
    fields["poses"] = poses[rows]
    fields["is_running"] = np.ones(n_worlds, bool)
    fields["speed"] = np.zeros(n_worlds)
    record = StepRecord(
        **fields,
        swarm=jax.tree.map(lambda a: np.asarray(a)[rows], state.swarm),
        links=Links(**zeros_of(Links, **sizes)),
        command=Command(**zeros_of(Command, N=(n_worlds, n_robots))),
        boxes=None if boxes is None else boxes[rows],
    )
    return jax.tree.map(lambda a: a[None], record)
