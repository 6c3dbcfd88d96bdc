"""Control steps compiled into one program: many worlds, a chunk of steps at a time, on all devices."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.engines.base import CompiledEngine, boxes_of
from iswarm_mj.simulation.actuate import drive_phases
from iswarm_mj.simulation.decide import decide, decide_worlds
from iswarm_mj.simulation.packed import kinds_of
from iswarm_mj.simulation.perceive import StepInputs
from iswarm_mj.simulation.state import StepRecord, SwarmState, WorldParams, WorldState
from iswarm_mj.simulation.step import Stepper, control_step
from iswarm_mj.utils.jax_setup import without_shardy

Tree = TypeVar("Tree")
_WORLDS = "worlds"  # the axis of the mesh of devices
_OWN, _SHARED = PartitionSpec(_WORLDS), PartitionSpec()
_REPEATS = 5  # of each stage that is timed
_UNROLLED = 2  # steps of a batch that a GPU takes without asking the host whether to go on


class Shared(NamedTuple):
    """What all devices are given alike in a call."""

    engine: CompiledEngine
    n_worlds: jax.Array
    """Worlds of each device, without padding."""
    first: jax.Array
    """Number of the first control step."""
    last: jax.Array
    """Number of steps of the run."""
    recorded: jax.Array
    """(W,) rows of the recorded worlds, among those of all devices."""


class CompiledLoop:
    """Chunks of control steps of B worlds, spread over devices; to a run it is as a `HostLoop`."""

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
            config: everything that is not evolved.
            params: of B worlds.
            state: of B worlds at the start.
            chunk: control steps in a call.
            devices: that share the worlds.
        """
        self._config, self._chunk = config, chunk
        n_worlds = len(params.goal)
        self.devices = devices = list(devices)[:n_worlds]
        self.mesh = Mesh(np.array(devices), (_WORLDS,))
        self.worlds_per_device = -(-n_worlds // len(devices))
        # Two at least on CPUs: with one, its axis would vanish from the program, and with it the last bits.
        rows = max(self.worlds_per_device, 2) if devices[0].platform == "cpu" else self.worlds_per_device
        world = np.arange(n_worlds)
        self._rows = world // self.worlds_per_device * rows + world % self.worlds_per_device
        self._n_rows = rows * len(devices)
        self._params, self._state = self._placed(self._with_padding(params, state), _OWN)
        self._engine: CompiledEngine = self._placed(engine, _SHARED)

    def _with_padding(self, params: WorldParams, state: WorldState) -> tuple[WorldParams, WorldState]:
        """Arrays of all rows; worlds that only fill up the devices are finished."""
        world, is_padding = np.zeros(self._n_rows, int), np.ones(self._n_rows, bool)
        world[self._rows], is_padding[self._rows] = np.arange(len(self._rows)), False
        params, state = _rows_of(params, state, world)
        return params, state._replace(is_finished=is_padding)

    def _placed(self, tree: Any, spec: PartitionSpec) -> Any:
        return jax.device_put(tree, NamedSharding(self.mesh, spec))

    def advance(self, first: int, last: int, recorded: tuple[int, ...]) -> tuple[int, StepRecord | None]:
        """Take a chunk of control steps, see `HostLoop.advance`."""
        rows = self._rows[list(recorded)]
        shared = Shared(
            engine=self._engine,
            n_worlds=jnp.int32(self.worlds_per_device),
            first=jnp.int32(first),
            last=jnp.int32(last),
            recorded=jnp.asarray(rows, jnp.int32),
        )
        with without_shardy():
            kinds = kinds_of(jax.tree.structure((self._params, self._state)))
            program = Program(self._config, self.mesh, self._chunk, bool(recorded), kinds)
            self._state, records = _advance(program, shared, self._params, self._state)
        taken = min(self._chunk, last - first)
        if not recorded:
            return taken, None
        # Of what each device kept (D, T, W, ...), the worlds that it has (T, W, ...).
        device, index = rows // (self._n_rows // self.mesh.size), np.arange(len(rows))
        return taken, jax.tree.map(lambda a: np.moveaxis(np.asarray(a)[device, :, index], 0, 1)[:taken], records)

    def read(self, part: Callable[[WorldState], Tree]) -> Tree:
        """See `HostLoop.read`."""
        return jax.tree.map(lambda a: np.asarray(a)[self._rows], part(self._state))

    def worlds(self) -> tuple[WorldParams, WorldState]:
        """See `HostLoop.worlds`."""
        return jax.tree.map(lambda a: a[self._rows], (self._params, self._state))

    def replace(self, params: WorldParams, swarm: SwarmState) -> None:
        """See `HostLoop.replace`."""
        old, state = self.worlds()
        params = params._replace(goal=old.goal, is_present=old.is_present)
        finished = self._state.is_finished  # so are rows that only fill up the devices
        self._params, state = self._placed(self._with_padding(params, state._replace(swarm=swarm)), _OWN)
        self._state = state._replace(is_finished=finished)

    def stage_times(self) -> dict[str, float]:
        """See `HostLoop.stage_times`; each stage as a program of its own, of the worlds of the first device."""
        params, state, engine = self.on_first_device()
        config, running = self._config, jnp.ones(len(params.goal), bool)
        is_batched = engine.mapping(self.devices[0].platform) == "batch"
        sense = jax.jit(engine.sense if is_batched else jax.vmap(engine.sense))
        alive = state.swarm.is_alive
        sight = sense(state.bodies, alive, running)
        policy = jax.jit(partial(decide_worlds, config, engine.robot))
        begin = StepInputs(engine.poses(state.bodies), sight, jnp.int32(7), running, boxes_of(engine, state.bodies))
        command = policy(params, state.swarm, begin).done.command

        def move(bodies, command, running):
            return engine.move(bodies, drive_phases(config.drive, command), running)

        physics = jax.jit(move if is_batched else jax.vmap(move))
        return {
            "sense": _median(sense, state.bodies, alive, running),
            "policy": _median(policy, params, state.swarm, begin),
            "physics": _median(physics, state.bodies, command, running),
        }

    def on_first_device(self) -> tuple[WorldParams, WorldState, CompiledEngine]:
        """Return parameters and state of the first device's worlds, without padding, and its engine."""
        local = jax.tree.map(lambda a: a.addressable_shards[0].data, (self._params, self._state, self._engine))
        params, state = jax.tree.map(lambda a: a[: self.worlds_per_device], local[:2])
        return params, state, local[2]


@jax.jit
def _rows_of(params: WorldParams, state: WorldState, worlds: jax.Array) -> tuple[WorldParams, WorldState]:
    """Parameters and state of these worlds, by one program."""
    return jax.tree.map(lambda a: a[worlds], (params, state))


class Program(NamedTuple):
    """What is compiled into a program."""

    config: StaticConfig
    mesh: Mesh
    """The devices."""
    n_steps: int
    """Control steps of a call."""
    records: bool
    """Worlds are recorded."""
    kinds: tuple[type | None, ...]
    """See `packed.kinds_of`, of parameters and state."""


@partial(jax.jit, static_argnames=("program",), donate_argnames=("state",))
def _advance(
    program: Program, shared: Shared, params: WorldParams, state: WorldState
) -> tuple[WorldState, StepRecord | None]:
    """Take the control steps of a call of all worlds; each device those of its own."""

    def on_device(shared: Shared, params: WorldParams, state: WorldState) -> tuple[WorldState, StepRecord | None]:
        engine, n_rows = shared.engine, len(params.goal)
        platform = program.mesh.devices.flat[0].platform
        mapping = engine.mapping(platform)
        decide_step = decide_worlds if mapping == "batch" else decide
        place = shared.recorded - jax.lax.axis_index(_WORLDS) * n_rows

        def keep(values: jax.Array) -> jax.Array:
            """Those of the recorded worlds, where this device has them."""
            return values[jnp.clip(place, 0, n_rows - 1)]

        def all_worlds(carry: tuple[WorldState, jax.Array], _: None) -> tuple[Any, StepRecord | None]:
            state, step = carry

            def take(params: WorldParams, state: WorldState) -> tuple[WorldState, StepRecord | None]:
                decide_with = partial(decide_step, program.config, engine.robot, params)
                stepper = Stepper(engine, program.config, decide_with, program.records)
                return control_step(stepper, params, state, step, shared.last)

            match mapping:
                case "batch":
                    state, record = take(params, state)
                case "vmap":
                    state, record = jax.vmap(take)(params, state)
                case "in turn":
                    state, record = _in_turn(take, params, state, shared.n_worlds)
            return (state, step + 1), jax.tree.map(keep, record)

        unroll = _UNROLLED if mapping == "batch" and platform == "gpu" else 1
        (state, _), kept = jax.lax.scan(all_worlds, (state, shared.first), None, program.n_steps, unroll=unroll)
        return state, jax.tree.map(lambda a: a[None], kept)

    spread = jax.shard_map(
        on_device, mesh=program.mesh, in_specs=(_SHARED, _OWN, _OWN), out_specs=(_OWN, _OWN), check_vma=False
    )
    return spread(shared, params, state)


def _in_turn(
    step: Callable[..., Any], params: WorldParams, state: WorldState, n_worlds: jax.Array
) -> tuple[WorldState, Any]:
    """Take a step of one world after the other, as `vmap` would of all at once.

    The number of worlds is a number at run time, so that the program of a world does not depend on it.
    """

    def world(tree: Any, index: jax.Array) -> Any:
        return jax.lax.optimization_barrier(jax.tree.map(lambda a: a[index], tree))

    def one(index: jax.Array, carry: tuple[WorldState, Any]) -> tuple[WorldState, Any]:
        new = jax.lax.optimization_barrier(step(world(params, index), world(carry[0], index)))
        return jax.tree.map(lambda all_, one: all_.at[index].set(one), carry, new)

    first = jnp.int32(0)
    shapes = jax.eval_shape(step, world(params, first), world(state, first))[1]
    records = jax.tree.map(lambda a: jnp.zeros((len(params.goal), *a.shape), a.dtype), shapes)
    return jax.lax.fori_loop(0, n_worlds, one, (state, records))


def _median(program: Callable[..., Any], *arguments: Any) -> float:
    """Median time of a compiled program [s]."""
    jax.block_until_ready(program(*arguments))
    laps = []
    for _ in range(_REPEATS):
        started = time.perf_counter()
        jax.block_until_ready(program(*arguments))
        laps.append(time.perf_counter() - started)
    return float(np.median(laps))
