"""How control steps follow each other: what a run needs of it, and the loop on the host."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.base import Engine, Motion, Phase, Sight
from iswarm_mj.simulation.decide import Decision, Situation, decide
from iswarm_mj.simulation.state import Fault, StepRecord, SwarmState, WorldParams, WorldState
from iswarm_mj.simulation.step import Stepper, control_step
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.profiling import Stopwatch
from iswarm_mj.utils.robot import Robot


class Counts(NamedTuple):
    """What a run looks at after each call, as NumPy arrays of B worlds."""

    balls: Any
    """`Balls`; arrays of JAX where they need not leave a device until someone looks."""
    collisions: np.ndarray
    is_finished: np.ndarray
    finished_at: np.ndarray
    fault: Fault


@runtime_checkable
class Loop(Protocol):
    """Carries B worlds through control steps."""

    devices: list[Any]
    """JAX devices that the worlds are spread over; none where the CPU's threads do all."""

    def advance(self, first: int, last: int, recorded: tuple[int, ...]) -> tuple[int, StepRecord | None]:
        """Take some control steps.

        Args:
            first: number of the first one, from 0.
            last: number of steps of the run; those beyond are not taken.
            recorded: W worlds.

        Returns:
            The number T of steps taken, and their record (T, W, ...); None where no world is recorded.
        """
        ...

    def counts(self) -> Counts:
        """Return the counts so far."""
        ...

    def worlds(self) -> tuple[WorldParams, WorldState]:
        """Return parameters and state of all worlds, as NumPy arrays where possible."""
        ...

    def stage_times(self) -> dict[str, float]:
        """Return the median seconds that a control step spends in sense, policy and physics."""
        ...


class HostLoop:
    """Control steps one by one, with an engine that acts on B worlds at once; the robots' decisions are compiled."""

    def __init__(self, engine: Engine, config: SwarmConfig, params: WorldParams, state: WorldState, watch: Stopwatch):
        self._engine, self._config, self._watch = TimedEngine(engine, watch), config, watch
        self.devices: list[Any] = []
        cpu = jax.devices("cpu")[0]
        self._goal, self._is_present = params.goal, params.is_present
        self._params: WorldParams = jax.device_put(params, cpu)
        self._state = state._replace(swarm=jax.device_put(state.swarm, cpu))

    def advance(self, first: int, last: int, recorded: tuple[int, ...]) -> tuple[int, StepRecord | None]:
        """Take one control step, see `Loop.advance`."""
        params = self._params._replace(goal=self._goal, is_present=self._is_present)
        stepper = Stepper(self._engine, self._config, self._decide, bool(recorded))
        self._state, record = control_step(stepper, params, self._state, np.int32(first), np.int32(last))
        if record is None:
            return 1, None
        rows = list(recorded)
        return 1, jax.tree.map(lambda a: np.asarray(a)[rows][None], record)

    def counts(self) -> Counts:
        """See `Loop.counts`."""
        s = self._state
        found = Counts(s.swarm.balls, s.collisions, s.is_finished, s.finished_at, s.fault)
        return jax.tree.map(np.asarray, found)

    def worlds(self) -> tuple[WorldParams, WorldState]:
        """See `Loop.worlds`."""
        return self._params, self._state._replace(swarm=jax.tree.map(np.asarray, self._state.swarm))

    def stage_times(self) -> dict[str, float]:
        """See `Loop.stage_times`; of all steps so far."""
        laps = self._watch.laps
        return {stage: float(np.median(laps[stage])) for stage in ("sense", "policy", "physics") if laps[stage]}

    def _decide(self, params: WorldParams, swarm: SwarmState, situation: Situation) -> Decision:
        with self._watch("policy"):
            situation = situation._replace(poses=situation.poses.astype(np.float32))
            decision = decide_worlds(self._config, self._engine.robot, self._params, swarm, situation)
            command, has_priority = jax.tree.map(np.asarray, (decision.command, decision.has_priority))
        return Decision(decision.swarm, command, has_priority)


@partial(jax.jit, static_argnames=("config", "robot"))
def decide_worlds(
    config: SwarmConfig, robot: Robot, params: WorldParams, swarm: SwarmState, situation: Situation
) -> Decision:
    """`decide` for B worlds at once, all at the same step."""
    of_one = partial(decide, config, robot)
    steps = jnp.broadcast_to(situation.step, situation.is_running.shape)
    return jax.vmap(of_one)(params, swarm, situation._replace(step=steps))


class TimedEngine:
    """An engine on the host, with the time that it takes."""

    def __init__(self, engine: Engine, watch: Stopwatch):
        self._engine, self._watch = engine, watch
        self.place, self.poses = engine.place, engine.poses
        self.robot = engine.robot

    def sense(self, bodies: Any, emits: Array, is_running: Array) -> Sight:
        """See `Engine.sense`."""
        with self._watch("sense"):
            return self._engine.sense(bodies, emits, is_running)

    def move(self, bodies: Any, phases: Sequence[Phase], is_running: Array) -> Motion:
        """See `Engine.move`."""
        with self._watch("physics"):
            return self._engine.move(bodies, phases, is_running)
