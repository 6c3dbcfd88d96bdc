"""Compiled control steps: one program takes a chunk of steps of many worlds on all devices."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec
from jaxtyping import Float

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.engines.base import CompiledEngine, Mapping, boxes_of, poses_of_bodies
from iswarm_mj.simulation.actuate import drive_phases
from iswarm_mj.simulation.decide import decide, decide_worlds
from iswarm_mj.simulation.packed import node_types_of
from iswarm_mj.simulation.perceive import StepInputs
from iswarm_mj.simulation.state import StepRecord, SwarmState, WorldParams, WorldState
from iswarm_mj.simulation.step import Stepper, control_step
from iswarm_mj.utils.jax_setup import without_shardy

Tree = TypeVar("Tree")

_WORLDS = "worlds"
"""Name of the axis of the mesh of devices."""
_PER_DEVICE = PartitionSpec(_WORLDS)
"""Each device has rows of its own."""
_REPLICATED = PartitionSpec()
"""All devices have the same values."""

_TIMED_CALLS = 5
"""Calls of each stage that is timed."""
_TIMED_STEP = 7
"""Number of the control step for which stages are timed; any will do."""
_UNROLLED_STEPS = 2
"""Steps of a batch that a GPU takes without asking the host whether to go on."""


class SharedInputs(NamedTuple):
    """Inputs of a call that are the same on all devices."""

    engine: CompiledEngine
    """Engine of the worlds of one device."""
    n_worlds: jax.Array
    """Number of worlds of each device, without padding."""
    first: jax.Array
    """Number of the first control step."""
    last: jax.Array
    """Number of steps of the run."""
    recorded: jax.Array
    """Rows (W,) of the recorded worlds, among those of all devices."""


class Program(NamedTuple):
    """Constants that are compiled into a program."""

    config: StaticConfig
    """Settings that control steps are compiled for."""
    mesh: Mesh
    """Devices that share the worlds."""
    n_steps: int
    """Number of control steps of a call."""
    records: bool
    """Some worlds are recorded."""
    node_types: tuple[type | None, ...]
    """Types of the nodes of parameters and state (`packed.node_types_of`)."""


class CompiledLoop:
    """Chunks of control steps of B worlds on several devices, with the methods of `HostLoop`.

    Each device has the same number of rows for worlds; those without a world are padding, finished
    from the start.
    """

    def __init__(
        self,
        engine: CompiledEngine,
        config: StaticConfig,
        params: WorldParams,
        state: WorldState,
        chunk: int,
        devices: Sequence[Any],
    ):
        """Distribute the worlds over the devices.

        Args:
            engine: senses and moves.
            config: settings that control steps are compiled for.
            params: parameters of B worlds.
            state: state of B worlds at the start.
            chunk: number of control steps in a call.
            devices: devices that share the worlds.
        """
        self._config = config
        self._chunk = chunk
        n_worlds = len(params.goal)
        self.devices = list(devices)[:n_worlds]
        self.mesh = Mesh(np.array(self.devices), (_WORLDS,))
        self.worlds_per_device = -(-n_worlds // len(self.devices))

        # At least two rows on CPUs: with one, XLA drops the axis of worlds, and results round
        # otherwise.
        rows_per_device = self.worlds_per_device
        if self.devices[0].platform == "cpu":
            rows_per_device = max(rows_per_device, 2)
        self._n_rows = rows_per_device * len(self.devices)
        device, index = np.divmod(np.arange(n_worlds), self.worlds_per_device)
        self._rows = device * rows_per_device + index

        padded = self._with_padding(params, state)
        self._params, self._state = self._put_on_devices(padded, _PER_DEVICE)
        self._engine: CompiledEngine = self._put_on_devices(engine, _REPLICATED)

    def _with_padding(
        self, params: WorldParams, state: WorldState
    ) -> tuple[WorldParams, WorldState]:
        """Return parameters and state of all rows; padding repeats world 0, and is finished."""
        world = np.zeros(self._n_rows, int)
        world[self._rows] = np.arange(len(self._rows))
        is_padding = np.ones(self._n_rows, bool)
        is_padding[self._rows] = False
        params, state = _rows_of(params, state, world)
        return params, state._replace(is_finished=is_padding)

    def _put_on_devices(self, tree: Any, spec: PartitionSpec) -> Any:
        """Return arrays on the devices, with rows of their own or replicated."""
        return jax.device_put(tree, NamedSharding(self.mesh, spec))

    def advance(
        self, first: int, last: int, recorded: tuple[int, ...]
    ) -> tuple[int, StepRecord | None]:
        """Take a chunk of control steps, see `HostLoop.advance`."""
        rows = self._rows[list(recorded)]
        shared = SharedInputs(
            engine=self._engine,
            n_worlds=jnp.int32(self.worlds_per_device),
            first=jnp.int32(first),
            last=jnp.int32(last),
            recorded=jnp.asarray(rows, jnp.int32),
        )
        with without_shardy():
            program = Program(
                config=self._config,
                mesh=self.mesh,
                n_steps=self._chunk,
                records=bool(recorded),
                node_types=node_types_of(jax.tree.structure((self._params, self._state))),
            )
            self._state, records = _advance(program, shared, self._params, self._state)

        n_taken = min(self._chunk, last - first)
        if not recorded:
            return n_taken, None

        # Every device kept a record for every recorded world (D, T, W, ...); take it from the one
        # that has the world.
        device = rows // (self._n_rows // self.mesh.size)
        column = np.arange(len(rows))

        def of_recorded_worlds(values: jax.Array) -> np.ndarray:
            worlds_first = np.asarray(values)[device, :, column]
            return np.moveaxis(worlds_first, 0, 1)[:n_taken]

        return n_taken, jax.tree.map(of_recorded_worlds, records)

    def read(self, part: Callable[[WorldState], Tree]) -> Tree:
        """Return part of the state of all B worlds, as NumPy arrays."""
        return jax.tree.map(lambda a: np.asarray(a)[self._rows], part(self._state))

    def worlds(self) -> tuple[WorldParams, WorldState]:
        """Return parameters and state of all worlds."""
        return jax.tree.map(lambda a: a[self._rows], (self._params, self._state))

    def replace(self, params: WorldParams, swarm: SwarmState) -> None:
        """Replace parameters and state of the swarm, see `HostLoop.replace`."""
        old_params, state = self.worlds()
        params = params._replace(goal=old_params.goal, is_present=old_params.is_present)
        is_finished = self._state.is_finished  # with padding, which stays finished
        padded = self._with_padding(params, state._replace(swarm=swarm))
        self._params, state = self._put_on_devices(padded, _PER_DEVICE)
        self._state = state._replace(is_finished=is_finished)

    def poses(self) -> Float[np.ndarray, "B NM 3"]:
        """Return x, y [mm] and yaw [rad] of robots, and of boxes after them."""
        return poses_of_bodies(self._engine, self._state.bodies)[self._rows]

    def place(self, poses: Float[np.ndarray, "B NM 3"]) -> None:
        """Put robots and boxes at other places, at rest."""
        params, state = self.worlds()
        placed = placed_bodies(self._engine, self.devices[0].platform, poses, params.is_present)
        is_finished = self._state.is_finished  # with padding, which stays finished
        padded = self._with_padding(params, state._replace(bodies=placed))
        self._params, state = self._put_on_devices(padded, _PER_DEVICE)
        self._state = state._replace(is_finished=is_finished)

    def stage_times(self) -> dict[str, float]:
        """Return the median seconds of the stages of a control step, see `HostLoop.stage_times`.

        Each stage is timed as a program of its own, with the worlds of the first device.
        """
        params, state, engine = self.on_first_device()
        config = self._config
        is_running = jnp.ones(len(params.goal), bool)
        emits = state.swarm.is_alive

        def move(bodies, command, is_running):
            return engine.move(bodies, drive_phases(config.drive, command), is_running)

        if engine.mapping(self.devices[0].platform) == "batch":
            sense = jax.jit(engine.sense)
            physics = jax.jit(move)
        else:
            sense = jax.jit(jax.vmap(engine.sense))
            physics = jax.jit(jax.vmap(move))
        policy = jax.jit(partial(decide_worlds, config, engine.robot))

        inputs = StepInputs(
            poses=engine.poses(state.bodies),
            sight=sense(state.bodies, emits, is_running),
            step=jnp.int32(_TIMED_STEP),
            is_running=is_running,
            boxes=boxes_of(engine, state.bodies),
        )
        command = policy(params, state.swarm, inputs).drive.command
        return {
            "sense": _median_time(sense, state.bodies, emits, is_running),
            "policy": _median_time(policy, params, state.swarm, inputs),
            "physics": _median_time(physics, state.bodies, command, is_running),
        }

    def on_first_device(self) -> tuple[WorldParams, WorldState, CompiledEngine]:
        """Return parameters, state and engine of the first device's worlds, without padding."""
        on_all = (self._params, self._state, self._engine)
        params, state, engine = jax.tree.map(lambda a: a.addressable_shards[0].data, on_all)
        params, state = jax.tree.map(lambda a: a[: self.worlds_per_device], (params, state))
        return params, state, engine


@jax.jit
def _rows_of(
    params: WorldParams, state: WorldState, worlds: jax.Array
) -> tuple[WorldParams, WorldState]:
    """Return parameters and state of worlds, by one program instead of one for each array."""
    return jax.tree.map(lambda a: a[worlds], (params, state))


@partial(jax.jit, static_argnames=("program",), donate_argnames=("state",))
def _advance(
    program: Program, shared: SharedInputs, params: WorldParams, state: WorldState
) -> tuple[WorldState, StepRecord | None]:
    """Take the control steps of a call in all worlds; each device takes those of its own."""
    spread = jax.shard_map(
        partial(_advance_device, program),
        mesh=program.mesh,
        in_specs=(_REPLICATED, _PER_DEVICE, _PER_DEVICE),
        out_specs=(_PER_DEVICE, _PER_DEVICE),
        check_vma=False,
    )
    return spread(shared, params, state)


def _advance_device(
    program: Program, shared: SharedInputs, params: WorldParams, state: WorldState
) -> tuple[WorldState, StepRecord | None]:
    """Take the control steps of a call in the worlds of one device.

    Returns:
        The state, and the record of the recorded worlds (1, T, W, ...), undefined for worlds of
        other devices.
    """
    platform = program.mesh.devices.flat[0].platform
    mapping = shared.engine.mapping(platform)
    n_rows = len(params.goal)
    row_here = shared.recorded - jax.lax.axis_index(_WORLDS) * n_rows

    def of_recorded_worlds(values: jax.Array) -> jax.Array:
        return values[jnp.clip(row_here, 0, n_rows - 1)]

    def take_step(carry: tuple[WorldState, jax.Array], _: None) -> tuple[Any, StepRecord | None]:
        state, step = carry
        state, record = _step_worlds(program, shared, mapping, params, state, step)
        return (state, step + 1), jax.tree.map(of_recorded_worlds, record)

    unroll = _UNROLLED_STEPS if mapping == "batch" and platform == "gpu" else 1
    (state, _), records = jax.lax.scan(
        take_step, (state, shared.first), None, program.n_steps, unroll=unroll
    )
    return state, jax.tree.map(lambda a: a[None], records)


def _step_worlds(
    program: Program,
    shared: SharedInputs,
    mapping: Mapping,
    params: WorldParams,
    state: WorldState,
    step: jax.Array,
) -> tuple[WorldState, StepRecord | None]:
    """Take one control step in the worlds of a device, by the engine's mapping."""
    engine = shared.engine
    decide_step = decide_worlds if mapping == "batch" else decide

    def take(params: WorldParams, state: WorldState) -> tuple[WorldState, StepRecord | None]:
        decide_with = partial(decide_step, program.config, engine.robot, params)
        stepper = Stepper(engine, program.config, decide_with, program.records)
        return control_step(stepper, params, state, step, shared.last)

    match mapping:
        case "batch":
            return take(params, state)
        case "vmap":
            return jax.vmap(take)(params, state)
        case "in turn":
            return _in_turn(take, params, state, shared.n_worlds)


def _in_turn(
    take: Callable[..., Any], params: WorldParams, state: WorldState, n_worlds: jax.Array
) -> tuple[WorldState, Any]:
    """Take a step of one world after the other, with results as of `jax.vmap(take)`.

    The number of worlds is a number at run time, and barriers keep XLA from fusing a step with its
    surroundings: the program of a world does not depend on how many there are.
    """

    def world_of(tree: Any, index: jax.Array) -> Any:
        return jax.lax.optimization_barrier(jax.tree.map(lambda a: a[index], tree))

    def take_world(index: jax.Array, carry: tuple[WorldState, Any]) -> tuple[WorldState, Any]:
        states, _ = carry
        results = take(world_of(params, index), world_of(states, index))
        results = jax.lax.optimization_barrier(results)
        return jax.tree.map(lambda rows, row: rows.at[index].set(row), carry, results)

    first_world = jnp.int32(0)
    _, record_shapes = jax.eval_shape(
        take, world_of(params, first_world), world_of(state, first_world)
    )
    n_rows = len(params.goal)
    records = jax.tree.map(lambda a: jnp.zeros((n_rows, *a.shape), a.dtype), record_shapes)
    return jax.lax.fori_loop(0, n_worlds, take_world, (state, records))


def _median_time(program: Callable[..., Any], *arguments: Any) -> float:
    """Return the median time of a call of a compiled program [s]."""
    jax.block_until_ready(program(*arguments))
    laps = []
    for _ in range(_TIMED_CALLS):
        started = time.perf_counter()
        jax.block_until_ready(program(*arguments))
        laps.append(time.perf_counter() - started)
    return float(np.median(laps))


def placed_bodies(engine: CompiledEngine, platform: str, poses: Any, is_present: Any) -> Any:
    """Return the bodies of B worlds at rest at some poses, see `Engine.place`.

    Args:
        engine: engine of the worlds.
        platform: platform of the devices, such as "cpu".
        poses: x, y [mm] and yaw [rad] of robots and boxes (B, N + M, 3).
        is_present: places that hold a robot (B, N).
    """
    is_batched = engine.mapping(platform) == "batch"
    place = engine.place if is_batched else jax.vmap(engine.place)
    return place(jnp.asarray(poses, jnp.float32), is_present)
