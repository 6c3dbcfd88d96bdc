"""How control steps follow each other on the host: threads carry shares of a run's worlds from light to counts."""

import os
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Any, TypeVar

import jax
import numpy as np

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.engines.base import Engine
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.simulation.decide import Decision, decide_packed
from iswarm_mj.simulation.packed import Packed, pack, unpacked
from iswarm_mj.simulation.perceive import StepInputs
from iswarm_mj.simulation.state import StepRecord, SwarmState, WorldParams, WorldState
from iswarm_mj.simulation.step import Stepper, control_step
from iswarm_mj.utils.profiling import Stopwatch

Tree = TypeVar("Tree")
MAX_WORLDS = 16
"""Of a share at most. In many small ones the time that each call of a program takes shows: 32 worlds on one thread take
20 % longer in shares of 4, 2 % in shares of 16."""


def shard_worlds(n_worlds: int) -> list[slice]:
    """Worlds of each share, as equal in number as possible, and of two shares at least where there are two worlds.

    They do not depend on the number of threads, since programs for other numbers of worlds may round otherwise.
    """
    n_shares = max(-(-n_worlds // MAX_WORLDS), min(n_worlds, 2))
    edges = [n_worlds * share // n_shares for share in range(n_shares + 1)]
    return [slice(first, last) for first, last in pairwise(edges)]


class WorldShard:
    """Some worlds, with an engine of their own that acts on all of them at once; their decisions are compiled.

    Attributes:
        engine: of these worlds.
        params: as NumPy arrays.
        state: with packed memories and a packed state of the task (`packed.Packed`).
    """

    def __init__(self, engine: Engine, config: StaticConfig, params: WorldParams, state: WorldState, watch: Stopwatch):
        self.engine, self._config, self._watch = engine, config, watch
        self.state = state
        self.replace(params, state.swarm)

    def replace(self, params: WorldParams, swarm: SwarmState) -> None:
        """See `HostLoop.replace`."""
        cpu = jax.local_devices(backend="cpu")[0]
        swarm = swarm._replace(memory=pack(swarm.memory), task=pack(swarm.task))
        packed_params, swarm = jax.device_put((pack(params), swarm), cpu)
        self.params = params
        self._decide = partial(_decide, self._config, self.engine.robot, packed_params)
        self.state = self.state._replace(swarm=swarm)

    def advance(self, step: int, last: int, recorded: Sequence[int]) -> StepRecord | None:
        """Take a control step.

        Args:
            step: its number, from 0.
            last: number of steps of the run.
            recorded: W worlds, counted from the first of the share.

        Returns:
            Their record (W, ...) as NumPy arrays; None where no world is recorded.
        """
        stepper = Stepper(self.engine, self._config, self._decide, bool(recorded), self._watch)
        self.state, record = control_step(
            stepper, self.params, self.state, np.asarray(step, np.int32), np.asarray(last, np.int32)
        )
        return None if record is None else jax.tree.map(lambda a: np.asarray(a)[list(recorded)], unpacked(record))


def _decide(config: StaticConfig, robot: Robots, params: Packed, swarm: SwarmState, begin: StepInputs) -> Decision:
    """Return what the robots of a share decide; what its engine needs of that as NumPy arrays."""
    poses, boxes = jax.tree.map(lambda a: a.astype(np.float32), (begin.poses, begin.boxes))
    decision = decide_packed(config, robot, params, swarm, begin._replace(poses=poses, boxes=boxes))
    needed = (decision.done, decision.progress, decision.boxes)
    done, progress, boxes = jax.tree.map(np.asarray, needed)
    return decision._replace(done=done, progress=progress, boxes=boxes)


class HostLoop:
    """Control steps one by one: threads carry shares of the worlds through a step, and meet at its end.

    Attributes:
        devices: JAX devices that the worlds are spread over, which are none here.
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
            config: what control steps are compiled for.
            params: of B worlds.
            start: poses (B, N + M, 3) x, y [mm] and yaw [rad], and the state but for the bodies.
            n_threads: threads, 0 for one a core.
            watch: takes the times of the stages.
        """
        n_threads = n_threads or len(os.sched_getaffinity(0))
        self.devices: list[Any] = []
        self._watch, self._parts = watch, shard_worlds(len(params.goal))
        self._n_workers = min(n_threads, len(self._parts))
        self._pool = ThreadPoolExecutor(self._n_workers - 1) if self._n_workers > 1 else None
        self._shares: list[WorldShard] = []
        self._is_compiled = False
        for part in self._parts:
            own, (poses, state) = jax.tree.map(lambda a, part=part: np.asarray(a)[part], (params, start))
            engine = make_engine(len(poses), n_threads // self._n_workers)
            state = state._replace(bodies=engine.place(poses, own.is_present))
            self._shares.append(WorldShard(engine, config, own, state, watch))

    def advance(self, first: int, last: int, recorded: tuple[int, ...]) -> tuple[int, StepRecord | None]:
        """Take one control step.

        Args:
            first: its number, from 0.
            last: number of steps of the run; those beyond are not taken.
            recorded: W worlds.

        Returns:
            The number T of steps taken, and their record (T, W, ...); None where no world is recorded.
        """
        of_share = [[world for world in recorded if part.start <= world < part.stop] for part in self._parts]
        found: list[StepRecord | None] = [None] * len(self._shares)

        def advance(index: int) -> None:
            part = self._parts[index]
            found[index] = self._shares[index].advance(first, last, [w - part.start for w in of_share[index]])

        self._each(advance)
        if not recorded:
            return 1, None
        order = [world for worlds in of_share for world in worlds]
        places = [order.index(world) for world in recorded]
        record = _joined([record for record in found if record is not None])
        return 1, jax.tree.map(lambda a: a[places][None], record)

    def read(self, part: Callable[[WorldState], Tree]) -> Tree:
        """Return part of the state of all B worlds, as NumPy arrays."""
        return _joined([part(share.state) for share in self._shares])

    def worlds(self) -> tuple[WorldParams, WorldState]:
        """Return parameters and state of all worlds, as NumPy arrays where possible."""
        params, state = _joined([(share.params, share.state) for share in self._shares])
        return params, state

    def replace(self, params: WorldParams, swarm: SwarmState) -> None:
        """Put other parameters and another state of the swarm, of the same shapes and types, in place of the present.

        Args:
            params: of B worlds; goal and places for robots stay as they are.
            swarm: of B worlds.
        """
        for share, part in zip(self._shares, self._parts, strict=True):
            share.replace(*jax.tree.map(lambda a, part=part: np.asarray(a)[part], (params, swarm)))

    def stage_times(self) -> dict[str, float]:
        """Return the median seconds that a control step spends in sense, policy and physics.

        They are of all steps so far, by the clock if all threads have as much to do.
        """
        laps, turns = self._watch.laps, len(self._shares) / self._n_workers
        return {stage: turns * float(np.median(laps[stage])) for stage in ("sense", "policy", "physics") if laps[stage]}

    def _each(self, work: Callable[[int], None]) -> None:
        """Do something for each share, by its index, in as many threads as there are."""
        left = deque(range(len(self._shares)))

        def go_on() -> None:
            while left:
                try:
                    index = left.popleft()
                except IndexError:  # another thread took the last one
                    return
                work(index)

        others = []
        if self._pool is not None and self._is_compiled:  # else several threads would compile one program
            others = [self._pool.submit(go_on) for _ in range(self._n_workers - 1)]
        try:
            go_on()
        finally:
            for other in others:
                other.result()
        self._is_compiled = True


def _joined(parts: Sequence[Tree]) -> Tree:
    """Of shares of worlds one after the other, as NumPy arrays."""

    def join(*values: Any) -> np.ndarray:
        return np.asarray(values[0]) if len(values) == 1 else np.concatenate(values)

    return jax.tree.map(join, *map(unpacked, parts))
