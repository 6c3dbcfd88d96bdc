"""A share of a run's worlds on the host: one thread carries it through a control step, from light to counts."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.base import Engine
from iswarm_mj.simulation.decide import Decision, decide_packed
from iswarm_mj.simulation.packed import is_key, pack, unpacked
from iswarm_mj.simulation.perceive import StepInputs
from iswarm_mj.simulation.state import StepRecord, SwarmState, WorldParams, WorldState
from iswarm_mj.simulation.step import Stepper, control_step
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.profiling import Stopwatch

WORLDS = 16
"""Of a share at most. In many small ones the time that each call of a program takes shows: 32 worlds on one thread take
20 % longer in shares of 4, 2 % in shares of 16."""


def shares_of(n_worlds: int) -> list[slice]:
    """Worlds of each share, as equal in number as possible, and of two shares at least where there are two worlds.

    They do not depend on the number of threads, since programs for other numbers of worlds may round otherwise.
    """
    n_shares = max(-(-n_worlds // WORLDS), min(n_worlds, 2))
    edges = [n_worlds * share // n_shares for share in range(n_shares + 1)]
    return [slice(first, last) for first, last in pairwise(edges)]


class Share:
    """Some worlds, with an engine of their own that acts on all of them at once; their decisions are compiled.

    Attributes:
        engine: of these worlds.
        params: as NumPy arrays, but for random keys.
        state: with packed memories and a packed state of the task (`packed.Packed`).
    """

    def __init__(self, engine: Engine, config: SwarmConfig, params: WorldParams, state: WorldState, watch: Stopwatch):
        self.engine, self._config, self._watch = engine, config, watch
        self.state = state
        self.replace(params, state.swarm)

    def replace(self, params: WorldParams, swarm: SwarmState) -> None:
        """See `loop.HostLoop.replace`."""
        cpu = jax.local_devices(backend="cpu")[0]
        swarm = swarm._replace(memory=pack(swarm.memory), task=pack(swarm.task))
        self.params, (self._packed_params, swarm) = params, jax.device_put((pack(params), swarm), cpu)
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

    def _decide(self, params: WorldParams, swarm: SwarmState, begin: StepInputs) -> Decision:
        poses, boxes = jax.tree.map(lambda a: a.astype(np.float32), (begin.poses, begin.boxes))
        begin = begin._replace(poses=poses, boxes=boxes)
        decision = decide_packed(self._config, self.engine.robot, self._packed_params, swarm, begin)
        names = "command", "is_refused", "is_blocked", "progress", "boxes"
        return decision._replace(**{name: jax.tree.map(np.asarray, getattr(decision, name)) for name in names})


def rows(tree: Any, worlds: slice) -> Any:
    """Those of some worlds, as NumPy arrays but for random keys; JAX would compile a program for each shape."""

    def of(values: Array) -> Array:
        if is_key(values):
            data = jnp.asarray(np.asarray(jax.random.key_data(values))[worlds])
            return jax.random.wrap_key_data(data, impl=jax.random.key_impl(values))
        return np.asarray(values)[worlds]

    return jax.tree.map(of, tree)
