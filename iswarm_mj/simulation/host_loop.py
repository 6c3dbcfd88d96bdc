"""Control steps on the host: threads take shards of a run's worlds through each step."""

from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Any, TypeVar

import jax
import numpy as np
from jaxtyping import Float

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.engines.base import Engine, poses_of_bodies
from iswarm_mj.engines.validation import engine_code
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.simulation.decide import Decision, decide_packed
from iswarm_mj.simulation.packed import Packed, pack, unpacked
from iswarm_mj.simulation.perceive import StepInputs
from iswarm_mj.simulation.state import StepRecord, SwarmState, WorldParams, WorldState
from iswarm_mj.simulation.step import Stepper, control_step
from iswarm_mj.utils.operating_system import n_usable_cores
from iswarm_mj.utils.profiling import Stopwatch

Tree = TypeVar("Tree")

MAX_WORLDS = 16
"""Largest number of worlds in a shard.

In many small shards the time that each call of a program takes shows: 32 worlds on one thread take
20 % longer in shards of 4, and 2 % in shards of 16."""

_STAGES = ("sense", "policy", "physics")


def shard_worlds(n_worlds: int) -> list[slice]:
    """Return the worlds of each shard, in equal numbers as far as possible.

    A run of several worlds has at least two shards, so that two threads share its work. More shards
    than needed would only cost time (`MAX_WORLDS`). The number of threads has no influence, since
    programs for other numbers of worlds may round otherwise: results are the same on any machine.

    Args:
        n_worlds: number of worlds, at least 1.
    """
    n_shards = max(-(-n_worlds // MAX_WORLDS), min(n_worlds, 2))
    edges = [n_worlds * shard // n_shards for shard in range(n_shards + 1)]
    return [slice(first, last) for first, last in pairwise(edges)]


class WorldShard:
    """Some worlds, with an engine that acts on all of them at once; their decisions are compiled.

    Attributes:
        engine: engine of these worlds.
        params: parameters of the worlds, NumPy arrays.
        state: state of the worlds, with packed memories and a packed state of the task
            (`packed.Packed`).
    """

    def __init__(
        self,
        engine: Engine,
        config: StaticConfig,
        params: WorldParams,
        state: WorldState,
        watch: Stopwatch,
    ):
        """Pack what programs take; the state has its bodies."""
        self.engine = engine
        self.state = state
        self._config = config
        self._watch = watch
        self.replace(params, state.swarm)

    def replace(self, params: WorldParams, swarm: SwarmState) -> None:
        """Replace the parameters and the state of the swarm, see `HostLoop.replace`."""
        cpu = jax.local_devices(backend="cpu")[0]
        swarm = swarm._replace(memory=pack(swarm.memory), task=pack(swarm.task))
        packed_params, swarm = jax.device_put((pack(params), swarm), cpu)
        self.params = params
        self._decide = partial(_decide_on_host, self._config, self.engine.robot, packed_params)
        self.state = self.state._replace(swarm=swarm)

    def poses(self) -> Float[np.ndarray, "B NM 3"]:
        """Return x, y [mm] and yaw [rad] of robots, and of boxes after them."""
        bodies = self.state.bodies
        return poses_of_bodies(self.engine, bodies)

    def place(self, poses: Float[np.ndarray, "B NM 3"]) -> None:
        """Put robots and boxes at other places, at rest."""
        with engine_code(self.engine):
            bodies = self.engine.place(poses, self.params.is_present)
        self.state = self.state._replace(bodies=bodies)

    def advance(self, step: int, last: int, recorded: Sequence[int]) -> StepRecord | None:
        """Take a control step.

        Args:
            step: number of the step, from 0.
            last: number of steps of the run.
            recorded: W worlds, counted from the first of the shard.

        Returns:
            Record of these worlds (W, ...) as NumPy arrays; None where no world is recorded.
        """
        stepper = Stepper(
            engine=self.engine,
            config=self._config,
            decide=self._decide,
            records=bool(recorded),
            watch=self._watch,
        )
        with engine_code(self.engine):
            self.state, record = control_step(
                stepper,
                self.params,
                self.state,
                step=np.asarray(step, np.int32),
                last=np.asarray(last, np.int32),
            )
        if record is None:
            return None
        return jax.tree.map(lambda a: np.asarray(a)[list(recorded)], unpacked(record))


def _decide_on_host(
    config: StaticConfig, robot: Robots, params: Packed, swarm: SwarmState, inputs: StepInputs
) -> Decision:
    """Return the decisions of a shard's robots; those that its engine needs as NumPy arrays."""
    bodies = (inputs.poses, inputs.boxes)
    poses, boxes = jax.tree.map(lambda a: a.astype(np.float32), bodies)
    inputs = inputs._replace(poses=poses, boxes=boxes)
    decision = decide_packed(config, robot, params, swarm, inputs)

    needed = (decision.drive, decision.progress, decision.box_targets)
    drive, progress, box_targets = jax.tree.map(np.asarray, needed)
    return decision._replace(drive=drive, progress=progress, box_targets=box_targets)


class HostLoop:
    """Control steps one by one: threads take shards of the worlds through each step.

    Attributes:
        devices: JAX devices that the worlds are spread over; none here.
    """

    def __init__(
        self,
        make_engine: Callable[[int, int], Engine],
        config: StaticConfig,
        params: WorldParams,
        start: tuple[np.ndarray, WorldState],
        n_threads: int,
        watch: Stopwatch,
    ):
        """Place the worlds.

        Args:
            make_engine: makes an engine for a number of worlds and of threads.
            config: settings that control steps are compiled for.
            params: parameters of B worlds.
            start: poses (B, N + M, 3) x, y [mm] and yaw [rad] of robots and boxes, and the state
                without bodies.
            n_threads: number of threads, 0 for one a core.
            watch: takes the times of the stages.
        """
        n_threads = n_threads or n_usable_cores()
        self.devices: list[Any] = []
        self._watch = watch
        self._slices = shard_worlds(len(params.goal))
        self._n_workers = min(n_threads, len(self._slices))
        self._pool = None
        if self._n_workers > 1:
            self._pool = ThreadPoolExecutor(self._n_workers - 1)
        self._is_compiled = False

        self._shards: list[WorldShard] = []
        for worlds in self._slices:
            shard_params, (poses, state) = _worlds_of((params, start), worlds)
            engine = make_engine(len(poses), n_threads // self._n_workers)
            with engine_code(engine):
                bodies = engine.place(poses, shard_params.is_present)
            state = state._replace(bodies=bodies)
            self._shards.append(WorldShard(engine, config, shard_params, state, watch))

    def advance(
        self, first: int, last: int, recorded: tuple[int, ...]
    ) -> tuple[int, StepRecord | None]:
        """Take one control step.

        Args:
            first: number of the step, from 0.
            last: number of steps of the run; those beyond are not taken.
            recorded: W worlds.

        Returns:
            Number T of steps taken, and their record (T, W, ...); None where no world is recorded.
        """
        recorded_of_shard = []
        for worlds in self._slices:
            recorded_here = [world for world in recorded if worlds.start <= world < worlds.stop]
            recorded_of_shard.append(recorded_here)
        records: list[StepRecord | None] = [None] * len(self._shards)

        def advance_shard(index: int) -> None:
            first_world = self._slices[index].start
            rows = [world - first_world for world in recorded_of_shard[index]]
            records[index] = self._shards[index].advance(first, last, rows)

        self._for_each_shard(advance_shard)
        if not recorded:
            return 1, None

        # Shards return their worlds in ascending order; the record has them in the order asked for.
        order = [world for worlds in recorded_of_shard for world in worlds]
        rows = [order.index(world) for world in recorded]
        joined = _joined([record for record in records if record is not None])
        return 1, jax.tree.map(lambda a: a[rows][None], joined)

    def read(self, part: Callable[[WorldState], Tree]) -> Tree:
        """Return part of the state of all B worlds, as NumPy arrays."""
        return _joined([part(shard.state) for shard in self._shards])

    def worlds(self) -> tuple[WorldParams, WorldState]:
        """Return parameters and state of all worlds, as NumPy arrays where possible."""
        params, state = _joined([(shard.params, shard.state) for shard in self._shards])
        return params, state

    def replace(self, params: WorldParams, swarm: SwarmState) -> None:
        """Replace parameters and state of the swarm by others of the same shapes and types.

        Args:
            params: parameters of B worlds; goal and places for robots stay as they are.
            swarm: state of B worlds.
        """
        for shard, worlds in zip(self._shards, self._slices, strict=True):
            shard.replace(*_worlds_of((params, swarm), worlds))

    def poses(self) -> Float[np.ndarray, "B NM 3"]:
        """Return x, y [mm] and yaw [rad] of robots, and of boxes after them."""
        return np.concatenate([shard.poses() for shard in self._shards])

    def place(self, poses: Float[np.ndarray, "B NM 3"]) -> None:
        """Put robots and boxes at other places, at rest."""
        for shard, worlds in zip(self._shards, self._slices, strict=True):
            shard.place(poses[worlds])

    def stage_times(self) -> dict[str, float]:
        """Return the median seconds that a control step spends in sense, policy and physics.

        The times cover all steps since the run began, or since `watch.laps` was cleared; they are
        those of the clock if all threads have the same work to do.
        """
        laps = self._watch.laps
        shards_a_worker = len(self._shards) / self._n_workers
        return {
            stage: shards_a_worker * float(np.median(laps[stage]))
            for stage in _STAGES
            if laps[stage]
        }

    def _for_each_shard(self, work: Callable[[int], None]) -> None:
        """Do work for the index of each shard, in all threads, of which the calling one is one."""
        indices = deque(range(len(self._shards)))

        def work_until_done() -> None:
            while indices:
                try:
                    index = indices.popleft()
                except IndexError:  # another thread took the last one
                    return
                work(index)

        helpers = []
        # In the first step several threads would compile the same program.
        if self._pool is not None and self._is_compiled:
            helpers = [self._pool.submit(work_until_done) for _ in range(self._n_workers - 1)]
        try:
            work_until_done()
        finally:
            for helper in helpers:
                helper.result()
        self._is_compiled = True


def _worlds_of(tree: Tree, worlds: slice) -> Tree:
    """Return the rows of some worlds, as NumPy arrays."""
    return jax.tree.map(lambda a: np.asarray(a)[worlds], tree)


def _joined(shards: Sequence[Tree]) -> Tree:
    """Return the trees of shards, one after the other, as one of NumPy arrays."""

    def join(*values: Any) -> np.ndarray:
        if len(values) == 1:
            return np.asarray(values[0])
        return np.concatenate(values)

    return jax.tree.map(join, *map(unpacked, shards))
