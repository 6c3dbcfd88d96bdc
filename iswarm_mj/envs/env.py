"""Environments on compiled engines, as pure functions, and on engines of the host, many worlds at once."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, get_type_hints

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.engines.base import CompiledEngine, Engine, Motion
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.envs import observations
from iswarm_mj.envs.actions import checked
from iswarm_mj.envs.core import Core
from iswarm_mj.envs.observations import Row
from iswarm_mj.envs.state import Episode, State
from iswarm_mj.simulation.decide import alike
from iswarm_mj.simulation.step import drive_phases
from iswarm_mj.utils.errors import UserError, shown


class Env(ABC):
    """N robots of one world, or of B worlds at once, which act together.

    Attributes:
        core: what does not depend on the engine.
        n_robots: N.
        n_worlds: B; None where `reset` and `step` are of one world, and `jax.vmap` maps them.
    """

    def __init__(self, core: Core, engine: CompiledEngine | Engine, n_worlds: int | None):
        self.core, self.n_worlds = core, n_worlds
        self._bodies = get_type_hints(engine.place)["return"]
        self.n_robots = core.beginnings.poses.shape[1]

    @property
    def observations(self) -> list[Row]:
        """What each robot observes: names, sizes, units and bounds."""
        return self.core.observations

    @property
    def actions(self) -> list[Row]:
        """What each robot does, likewise."""
        return self.core.actions

    @property
    def observation_size(self) -> int:
        """D, numbers that each robot observes."""
        return sum(row.size for row in self.observations)

    @property
    def action_size(self) -> int:
        """A, numbers of each robot's action."""
        return sum(row.size for row in self.actions)

    @property
    def dt(self) -> float:
        """Duration of a step [s]."""
        return self.core.config.drive.control_period

    def named(self, obs: Any) -> dict[str, Any]:
        """Return observations (..., D) by the names of `observations`.

        Raises:
            UserError: these are none of this environment.
        """
        if getattr(obs, "shape", ())[-1:] != (self.observation_size,):
            raise UserError(
                f"obs must be an array (..., {self.observation_size}) (got {shown(obs)}); give the `obs` of a state."
            )
        return observations.split(self.observations, obs)

    @abstractmethod
    def reset(self, key: jax.Array) -> State:
        """Begin an episode.

        Args:
            key: random key, or one for each of B worlds.
        """

    @abstractmethod
    def step(self, state: State, action: Any) -> State:
        """Take a control step; a world whose episode has ended begins a new one instead.

        Args:
            state: from `reset` or `step`.
            action: (*B, N, A) from -1 to 1, see `actions`; beyond they are clipped. An action that is not finite is a
                fault, which ends the episode of its world alone.

        Raises:
            UserError: shape or type of the action do not fit, or the state is that of another environment.
        """

    @property
    def _axes(self) -> tuple[int, ...]:
        return () if self.n_worlds is None else (self.n_worlds,)

    def _keys(self, key: Any) -> jax.Array:
        is_key = isinstance(key, jax.Array) and jnp.issubdtype(key.dtype, jax.dtypes.prng_key)
        if isinstance(key, jax.Array) and key.dtype == jnp.uint32 and key.shape == (*self._axes, 2):
            key, is_key = jax.random.wrap_key_data(key), True
        if not is_key or key.shape != self._axes:
            many = self.n_worlds is not None
            example = f"jax.random.split(jax.random.key(0), {self.n_worlds})" if many else "jax.random.key(0)"
            what = f"{self.n_worlds} random keys, one for each world" if many else "a random key"
            raise UserError(f"reset needs {what}; make them by {example}")
        return key

    def _check(self, state: Any) -> None:
        """Refuse what is no state of this environment."""
        is_one = isinstance(state, State) and isinstance(state.data, Episode)
        if not is_one or any(part is None for part in (*state, state.data.world)):
            raise UserError(f"step needs a state that reset or step returned (got a {type(state).__name__})")
        shape = *self._axes, self.n_robots, self.observation_size
        if state.obs.shape != shape or not isinstance(state.data.world.bodies, self._bodies):
            raise UserError("step got a state of another environment; begin with a state of this one's reset")

    def _action(self, action: Any) -> Any:
        return checked(action, (*self._axes, self.n_robots, self.action_size))


class CompiledEnv(Env):
    """An environment of pure functions, for `jax.jit`, and `jax.vmap` where `n_worlds` is None."""

    def __init__(self, core: Core, engine: CompiledEngine, n_worlds: int | None):
        super().__init__(core, engine, n_worlds)
        self._engine = engine
        self._compiled_reset, self._compiled_step = jax.jit(self._reset), jax.jit(self._step)

    def reset(self, key: jax.Array) -> State:
        """See `Env.reset`."""
        return self._compiled_reset(key)

    def step(self, state: State, action: Any) -> State:
        """See `Env.step`."""
        self._check(state)
        return self._compiled_step(state, action)

    def _each(self, function: Callable[..., Any]) -> Callable[..., Any]:
        return function if self.n_worlds is None else jax.vmap(function)

    def _reset(self, key: jax.Array) -> State:
        data, done = self._each(self.core.ended)(self._keys(key))
        present = jnp.ones((*self._axes, self.n_robots), bool)
        bodies = self._engine.place(jnp.zeros((*present.shape, 3), jnp.float32), present)
        action = jnp.zeros((*self._axes, self.n_robots, self.action_size))
        return self._advance(data._replace(world=data.world._replace(bodies=bodies)), done, action, moves=False)

    def _step(self, state: State, action: Any) -> State:
        return self._advance(state.data, state.done, jnp.asarray(self._action(action)), moves=True)

    def _advance(self, data: Episode, done: jax.Array, action: jax.Array, moves: bool) -> State:
        engine, bodies = self._engine, data.world.bodies
        data = data._replace(world=data.world._replace(bodies=None))
        plan = self._each(self.core.prepare)(data, done, action)
        if moves:
            motion = engine.move(bodies, drive_phases(self.core.config.drive, plan.command), plan.is_running)
        else:
            motion = Motion(bodies, data.world.touching, data.step, data.step)
        placed = engine.place(plan.poses, jnp.ones(plan.poses.shape[:-1], bool))
        bodies = jax.tree.map(lambda new, old: jnp.where(_over(done, new), new, old), placed, motion.bodies)
        sight = engine.sense(bodies, self.core.talks(done, plan), jnp.ones_like(done))
        motion = motion._replace(bodies=None)
        state = self._each(self.core.finish)(data, done, plan, motion, engine.poses(bodies), sight)
        return state._replace(data=state.data._replace(world=state.data.world._replace(bodies=bodies)))


class HostEnv(Env):
    """An environment of B worlds on an engine of the host, whose other computations are compiled.

    MuJoCo in C keeps velocities to itself, so that with it the latest state alone can be stepped.
    """

    def __init__(self, core: Core, engine: Engine, n_worlds: int):
        super().__init__(core, engine, n_worlds)
        self._engine, self._cpu = engine, jax.local_devices(backend="cpu")[0]
        self._ended, self._prepare, self._finish = (
            jax.jit(alike(jax.vmap(function))) for function in (core.ended, core.prepare, core.finish)
        )
        self._latest: Any = None

    def reset(self, key: jax.Array) -> State:
        """See `Env.reset`."""
        _refuse_tracers("reset", key)
        with jax.default_device(self._cpu):
            data, done = self._ended(jax.device_put(self._keys(key), self._cpu))
            action = np.zeros((*self._axes, self.n_robots, self.action_size), np.float32)
            plan = self._prepare(data, done, action)
            present = np.ones((*self._axes, self.n_robots), bool)
            bodies = self._engine.place(np.asarray(plan.poses, float), present)
            zero = np.zeros(self._axes, np.int32)
            return self._perceive(data, done, plan, Motion(bodies, np.asarray(data.world.touching), zero, zero))

    def step(self, state: State, action: Any) -> State:
        """See `Env.step`."""
        self._check(state)
        _refuse_tracers("step", action, state.done)
        given = self._action(action)
        bodies, world = state.data.world.bodies, state.data.world
        if isinstance(self._engine, MujocoEngine) and bodies is not self._latest:
            raise UserError(
                "MuJoCo in C keeps velocities to itself, so that the latest state alone can be stepped; "
                "use PlanarSettings or MjxSettings to go back to others, or make another environment"
            )
        with jax.default_device(self._cpu):
            data = state.data._replace(world=world._replace(bodies=None))
            plan = self._prepare(data, state.done, given)
            command = jax.tree.map(np.asarray, plan.command)
            phases = drive_phases(self.core.config.drive, command)
            motion = self._engine.move(bodies, phases, np.asarray(plan.is_running))
            ended = np.flatnonzero(np.asarray(state.done))
            if len(ended):
                poses = np.asarray(plan.poses, float)[ended]
                motion = motion._replace(bodies=self._replaced(motion.bodies, ended, poses))
            return self._perceive(data, state.done, plan, motion)

    def _perceive(self, data: Episode, done: jax.Array, plan: Any, motion: Motion) -> State:
        bodies, engine = motion.bodies, self._engine
        sight = engine.sense(bodies, np.asarray(self.core.talks(done, plan)), np.ones(self._axes, bool))
        poses = engine.poses(bodies).astype(np.float32)
        state = self._finish(data, done, plan, motion._replace(bodies=None), poses, sight)
        self._latest = bodies
        return state._replace(data=state.data._replace(world=state.data.world._replace(bodies=bodies)))

    def _replaced(self, bodies: Any, worlds: np.ndarray, poses: np.ndarray) -> Any:
        """Bodies of which the robots of some worlds rest elsewhere."""
        if isinstance(self._engine, MujocoEngine):
            return self._engine.replace(bodies, worlds, poses)
        placed = self._engine.place(poses, np.ones(poses.shape[:-1], bool))

        def put(new: np.ndarray, old: np.ndarray) -> np.ndarray:
            old = old.copy()
            old[worlds] = new
            return old

        return jax.tree.map(put, placed, bodies)


def _refuse_tracers(name: str, *values: Any) -> None:
    """Refuse values inside of `jax.jit` and `jax.vmap`, which an engine of the host cannot compute with."""
    if any(isinstance(value, jax.core.Tracer) for value in values):
        raise UserError(
            f"this environment's engine computes on the host, outside of programs of JAX; call {name} without jax.jit "
            "and jax.vmap, or make the environment with MjxSettings() or PlanarSettings(impl='warp')"
        )


def _over(flags: jax.Array, values: jax.Array) -> jax.Array:
    """Flags (*B,) with axes for those that values (*B, ...) have beyond."""
    return flags.reshape(flags.shape + (1,) * (values.ndim - flags.ndim))
