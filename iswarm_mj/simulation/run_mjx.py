"""Batched runs in MJX: many worlds in one compiled program, on all devices, a chunk of steps at a time."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.mjx.arena import EXACT, IMPLEMENTATIONS, MjxArena, capacities, compile_mjx_arena, without_absent
from iswarm_mj.engines.mjx.motion import Bodies
from iswarm_mj.simulation.faults import describe
from iswarm_mj.simulation.initial import check_robots
from iswarm_mj.simulation.metrics import Measures, measure
from iswarm_mj.simulation.step import SwarmState
from iswarm_mj.simulation.step_mjx import Fault, StepRecord, WorldState, control_step
from iswarm_mj.simulation.worlds import Given, World, conditions_of_all, padded, stacked, starts_of, vector_strategies
from iswarm_mj.strategy.protocol import Strategy
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import SimulationFault
from iswarm_mj.utils.jax_setup import without_shardy

_WORLDS = "worlds"  # the axis of the mesh of devices


@dataclass(frozen=True)
class BatchSettings:
    """One run of B worlds in MJX."""

    steps: int
    """Control steps at most."""
    impl: str = "jax"
    """MJX's implementation: jax (everywhere) or warp (NVIDIA GPUs; slow on CPUs)."""
    stop_at: int | None = None
    """A world is finished when this many balls are delivered; None for all."""
    chunk: int = 25
    """Control steps that one call of the compiled program takes; faults and progress are seen between calls."""
    record_worlds: tuple[int, ...] = ()
    """Worlds whose steps are kept."""
    contact_room: float = 1.0
    """Room for contacts, relative to that of the rule (`engines.mjx_arena.capacities`); jams need more."""
    solver_iterations: int = EXACT
    """Iterations of the contact solver at most: 100 for MuJoCo's own result, 20 for speed."""

    def __post_init__(self):
        check("impl", self.impl, " or ".join(IMPLEMENTATIONS), self.impl in IMPLEMENTATIONS)
        check("steps", self.steps, "between 1 and 1000000", 1 <= self.steps <= 1_000_000)
        check("contact_room", self.contact_room, "between 0.01 and 100", 0.01 <= self.contact_room <= 100)
        check("solver_iterations", self.solver_iterations, "between 1 and 1000", 1 <= self.solver_iterations <= 1000)
        check("chunk", self.chunk, "between 1 and 10000", 1 <= self.chunk <= 10_000)


class BatchRun:
    """A run in progress: B worlds that advance together, on all devices given."""

    def __init__(
        self, config: SwarmConfig, worlds: Sequence[World], settings: BatchSettings, strategy: Strategy | None = None,
        devices: Sequence[Any] | None = None,
    ):  # fmt: skip
        """Prepare the worlds.

        Args:
            config: what all worlds share.
            worlds: B of them.
            settings: of the run.
            strategy: with a first axis of B worlds; by default the paper's, with each world's genome.
            devices: all that this process sees if not given.

        Raises:
            UserError: robots, worlds or settings that do not fit.
        """
        self.config, self.settings, self.worlds = config, settings, list(worlds)
        n_worlds, n_robots = len(worlds), max(w.n_robots for w in worlds)
        check_robots(config.arena, n_robots)
        unknown = [w for w in settings.record_worlds if not 0 <= w < n_worlds]
        check("record_worlds", str(unknown), f"numbers of worlds, 0 to {n_worlds - 1}", not unknown)
        devices = list(jax.local_devices() if devices is None else devices)[:n_worlds]
        self.mesh = Mesh(np.array(devices), (_WORLDS,))
        each = self.worlds_per_device = -(-n_worlds // len(devices))
        # Two at least: with one, its axis would vanish from the program, and with it the last bits.
        places = max(each, 2) if _in_turn_on(devices[0], settings.impl) else each
        world = np.arange(n_worlds)
        self._rows = world // each * places + world % each
        self._n_rows = places * len(devices)
        self.arena: MjxArena = compile_mjx_arena(
            config,
            n_robots,
            settings.impl,
            each,
            capacities(config, n_robots, settings.contact_room),
            settings.solver_iterations,
        )
        self.starts = [padded(start, n_robots) for start in starts_of(config, self.worlds)]
        strategy = vector_strategies(config, self.arena.probe[0], self.worlds) if strategy is None else strategy
        given, state = self._prepare(n_robots, strategy)
        self.is_masked = any(w.n_robots < n_robots for w in worlds)
        self._given, self._state = self._placed((given, state), PartitionSpec(_WORLDS))
        self.arena = self._placed(self.arena, PartitionSpec())
        self.step = 0
        self._seen = self._look()

    def _prepare(self, n_robots: int, strategy: Strategy) -> tuple[Given, WorldState]:
        """Arrays of all worlds, those that fill up the devices included."""
        n_worlds = len(self.worlds)
        key = jnp.stack([w.random_key for w in self.worlds])
        present = jnp.asarray([np.arange(n_robots) < w.n_robots for w in self.worlds])
        goal = self.settings.stop_at or self.config.arena.n_dust
        given = Given(strategy, conditions_of_all(self.config, self.worlds), key, present, jnp.full(n_worlds, goal))
        memories = jax.vmap(lambda strategy, key: strategy.init(n_robots, key))(strategy, key)
        poses = jnp.asarray(np.stack([start.poses for start in self.starts]), jnp.float32)
        zero, no = jnp.zeros(n_worlds, jnp.int32), jnp.zeros(n_worlds, bool)
        state = WorldState(
            bodies=Bodies(poses, jnp.zeros_like(poses)),
            swarm=SwarmState(
                memories,
                stacked([start.balls for start in self.starts]),
                stacked([start.is_alive for start in self.starts]),
            ),
            touching=jnp.zeros((n_worlds, n_robots, n_robots), bool),
            collisions=zero, is_finished=no, finished_at=zero, fault=Fault(zero, zero, zero),
        )  # fmt: skip
        world, is_filler = np.zeros(self._n_rows, int), np.ones(self._n_rows, bool)
        world[self._rows], is_filler[self._rows] = np.arange(n_worlds), False
        given, state = jax.tree.map(lambda a: a[world], (given, state))
        return given, state._replace(is_finished=jnp.asarray(is_filler))

    def _placed(self, tree: Any, spec: PartitionSpec) -> Any:
        """Put each device's worlds on it, or on each all that they share."""
        return jax.device_put(tree, NamedSharding(self.mesh, spec))

    @property
    def is_over(self) -> bool:
        """Whether the time is up or every world is finished."""
        return self.step >= self.settings.steps or bool(self._seen["is_finished"].all())

    def advance(self) -> StepRecord | None:
        """Take a chunk of control steps.

        Returns:
            What is kept of the recorded worlds, with axes steps and recorded worlds; None if there are none.

        Raises:
            SimulationFault: a robot has no finite pose or is outside the walls, or contacts found no room.
        """
        s = self.settings
        recorded = jnp.asarray(self._rows[list(s.record_worlds)], jnp.int32)
        n_worlds, first, last = (jnp.int32(n) for n in (self.worlds_per_device, self.step, s.steps))
        with without_shardy():
            self._state, records = _chunk(
                self.config, self.mesh, s.chunk, self.is_masked, bool(s.record_worlds), self.arena, self._given,
                self._state, n_worlds, first, last, recorded,
            )  # fmt: skip
        self.step = min(self.step + s.chunk, s.steps)
        self._seen = self._look()
        fault = describe(self._seen["fault"], self.arena.room)
        if fault:
            raise SimulationFault(fault)
        return self._recorded(records) if s.record_worlds else None

    def _recorded(self, records: StepRecord) -> StepRecord:
        """Of what each device kept (D, T, R, ...), the worlds that it has (T, R, ...)."""
        device = self._rows[list(self.settings.record_worlds)] // (self._n_rows // self.mesh.size)
        index = np.arange(len(device))
        return jax.tree.map(lambda a: np.moveaxis(a[device, :, index], 0, 1), jax.tree.map(np.asarray, records))

    def _look(self) -> dict[str, Any]:
        """Bring the counts to the host."""
        state = self._state
        found = {
            "balls": state.swarm.balls, "collisions": state.collisions, "is_finished": state.is_finished,
            "finished_at": state.finished_at, "fault": state.fault,
        }  # fmt: skip
        return jax.tree.map(lambda a: np.asarray(a)[self._rows], found)

    @property
    def last_step(self) -> int:
        """Last control step that any world took."""
        finished = self._seen["is_finished"]
        return int(self._seen["finished_at"].max()) if finished.all() else self.step

    def arrays(self) -> tuple[Given, WorldState]:
        """Return what is given and what changes, of all worlds and those that fill up the devices."""
        return self._given, self._state

    def swarm_state(self) -> SwarmState:
        """Return what is not rigid-body physics, of all worlds."""
        return jax.tree.map(lambda a: np.asarray(a)[self._rows], self._state.swarm)

    def delivered(self) -> np.ndarray:
        """Return the number of balls delivered in each world (B,)."""
        return self._seen["balls"].is_delivered.sum(axis=1)

    def measures(self, world: int) -> Measures:
        """Return the measures of a world so far."""
        seen = self._seen
        finished_at = int(seen["finished_at"][world]) if seen["is_finished"][world] else None
        return measure(seen["balls"], world, int(seen["collisions"][world]), finished_at)


@partial(jax.jit, static_argnames=("config", "mesh", "n_steps", "is_masked", "records"), donate_argnames=("state",))
def _chunk(config, mesh, n_steps, is_masked, records, arena, given, state, count, first, last, recorded):
    """Take `n_steps` control steps of all worlds; each device those of its own."""

    one_by_one = _in_turn_on(mesh.devices.flat[0], arena.impl)

    def on_device(arena, given, state, count, first, last, recorded):
        n_local = len(given.goal)
        place = recorded - jax.lax.axis_index(_WORLDS) * n_local

        def one_world(given: Given, state: WorldState, step: jax.Array) -> tuple[WorldState, StepRecord]:
            model = without_absent(arena.model, given.is_present) if is_masked else arena.model
            return control_step(config, arena, model, given, state, step, last)

        def keep(values: jax.Array) -> jax.Array:
            """Those of the recorded worlds, where this device has them."""
            return values[jnp.clip(place, 0, n_local - 1)]

        def all_worlds(state: WorldState, step: jax.Array) -> tuple[WorldState, Any]:
            if one_by_one:
                state, record = _in_turn(lambda given, state: one_world(given, state, step), given, state, count)
            else:
                state, record = jax.vmap(one_world, in_axes=(0, 0, None))(given, state, step)
            return state, jax.tree.map(keep, record) if records else None

        state, kept = jax.lax.scan(all_worlds, state, first + jnp.arange(n_steps))
        return state, jax.tree.map(lambda a: a[None], kept)

    own, shared = PartitionSpec(_WORLDS), PartitionSpec()
    spread = jax.shard_map(
        on_device, mesh=mesh, in_specs=(shared, own, own, shared, shared, shared, shared), out_specs=(own, own),
        check_vma=False,
    )  # fmt: skip
    return spread(arena, given, state, count, first, last, recorded)


def _in_turn_on(device: Any, impl: str) -> bool:
    """Whether worlds go one after the other: as fast on a CPU, and each is the same, bit by bit, in any batch."""
    return impl == "jax" and device.platform == "cpu"


def _in_turn(step: Callable[..., Any], given: Given, state: WorldState, count: jax.Array) -> tuple[WorldState, Any]:
    """Take a step of one world after the other, as `vmap` would of all at once.

    The number of worlds is a number at run time, so that the program of a world does not depend on it.
    """

    def world(tree: Any, index: jax.Array) -> Any:
        return jax.lax.optimization_barrier(jax.tree.map(lambda a: a[index], tree))

    def one(index: jax.Array, carry: tuple[WorldState, Any]) -> tuple[WorldState, Any]:
        new = jax.lax.optimization_barrier(step(world(given, index), world(carry[0], index)))
        return jax.tree.map(lambda all_, one: all_.at[index].set(one), carry, new)

    first = jnp.int32(0)
    shapes = jax.eval_shape(step, world(given, first), world(state, first))[1]
    records = jax.tree.map(lambda a: jnp.zeros((len(given.goal), *a.shape), a.dtype), shapes)
    return jax.lax.fori_loop(0, count, one, (state, records))


def worlds_of_seed(world: World, n_worlds: int) -> list[World]:
    """Return B worlds of one seed, numbered from 0: those of a run of that seed on a CPU."""
    return [replace(world, index=index) for index in range(n_worlds)]
