"""Environments on engines of the host, many worlds at once, and on compiled engines, as pure functions."""

from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.engines.base import CompiledEngine, Engine, Motion, boxes_of
from iswarm_mj.envs import tables
from iswarm_mj.envs.core import Core, Episode, Intent, State
from iswarm_mj.envs.tables import checked
from iswarm_mj.simulation.actuate import drive_phases, velocity_towards
from iswarm_mj.simulation.decide import pad_singleton_batch
from iswarm_mj.utils.errors import UserError, shown
from iswarm_mj.utils.jax_setup import check_jax


class Env:
    """N robots of one world, or of B worlds at once, which act together.

    On a compiled engine `reset` and `step` are pure functions, for `jax.jit`, and `jax.vmap` where `n_worlds` is None.
    On an engine of the host they are not; what is not the engine's is compiled.

    Attributes:
        core: what does not depend on the engine.
        n_robots: N.
        n_worlds: B; None where `reset` and `step` are of one world, and `jax.vmap` maps them.
        observations: what each robot observes: names, sizes, units and bounds.
        actions: what each robot does.
        observation_size: D, numbers that each robot observes.
        action_size: A, numbers of each robot's action.
        dt: duration of a step [s].
    """

    def __init__(self, core: Core, engine: CompiledEngine | Engine, n_worlds: int | None, on_host: bool):
        """Compile nothing yet; `on_host` says whether the engine computes on the host."""
        self.core, self.n_worlds, self.n_robots = core, n_worlds, core.n_robots
        self.observations, self.actions, self.dt = core.observations, core.actions, core.config.drive.control_period
        self.observation_size, self.action_size = (
            sum(row.size for row in t) for t in (core.observations, core.actions)
        )
        self._engine, self._on_host = engine, on_host
        self._device = jax.local_devices(backend="cpu")[0] if on_host else None
        stages = "begin", "auto_reset", "act", "observe"
        self._begin, self._auto_reset, self._act, self._observe = map(self._of_worlds, stages)
        self._compiled_reset = self._reset if on_host else jax.jit(self._reset)
        self._compiled_step = self._step if on_host else jax.jit(self._step)

    def named(self, obs: Any) -> dict[str, Any]:
        """Return observations (..., D) by the names of `observations`.

        Raises:
            UserError: these are none of this environment.
        """
        if getattr(obs, "shape", ())[-1:] != (self.observation_size,):
            raise UserError(
                f"obs must be an array (..., {self.observation_size}) (got {shown(obs)}); give the `obs` of a state."
            )
        return tables.split(self.observations, obs)

    def poses(self, state: State) -> Any:
        """Return where robots are (*B, N, 3), which they do not know: x, y [mm] and yaw [rad]."""
        return self._engine.poses(state.data.world.bodies)

    def boxes(self, state: State) -> Any:
        """Return where boxes are (*B, M, 3), likewise; None where there are none."""
        return boxes_of(self._engine, state.data.world.bodies)

    def reset(self, key: jax.Array) -> State:
        """Begin an episode.

        Args:
            key: random key, or one for each of B worlds.
        """
        check_jax()
        with jax.default_device(self._device):
            return self._compiled_reset(jax.device_put(self._keys(key), self._device))

    def step(self, state: State, action: Any) -> State:
        """Take a control step; a world whose episode has ended begins a new one instead.

        Args:
            state: from `reset` or `step`.
            action: (*B, N, A) from -1 to 1, see `actions`; beyond they are clipped. An action that is not finite is a
                fault, which ends the episode of its world alone.

        Raises:
            UserError: shape or type of the action do not fit.
        """
        check_jax()
        action = checked(action, (*self._axes, self.n_robots, self.action_size))
        with jax.default_device(self._device):
            return self._compiled_step(state, action)

    def _reset(self, key: jax.Array) -> State:
        data, poses = self._begin(key)
        is_new, zero = self._committed(jnp.ones(self._axes, bool)), jnp.zeros(self._axes, jnp.int32)
        bodies = self._engine.place(*self._given((poses, jnp.ones((*self._axes, self.n_robots), bool))))
        still, poses = jnp.zeros((*self._axes, self.n_robots, self.action_size)), poses[..., : self.n_robots, :]
        intent = self._act(data, is_new, still, poses)
        return self._seen(data, is_new, intent, Motion(bodies, self._given(data.world.touching), zero, zero))

    def _step(self, state: State, action: jax.Array) -> State:
        world, is_new = state.data.world, state.done
        data, poses = self._auto_reset(state.data._replace(world=world._replace(bodies=None)), is_new)
        before = self._committed(jnp.asarray(self._engine.poses(world.bodies), jnp.float32))
        intent = self._act(data, is_new, action, before)
        config, there = self.core.config, boxes_of(self._engine, world.bodies)
        boxes = velocity_towards(config, self._given(intent.boxes), there)
        phases = drive_phases(config.drive, self._given(intent.done.command), boxes)
        motion = self._engine.move(world.bodies, phases, self._given(intent.is_running))
        return self._seen(data, is_new, intent, motion._replace(bodies=self._placed(motion.bodies, is_new, poses)))

    def _seen(self, data: Episode, is_new: Any, intent: Intent, motion: Motion) -> State:
        engine, bodies = self._engine, motion.bodies
        sight = engine.sense(bodies, *self._given((intent.is_emitting, jnp.ones(self._axes, bool))))
        seen = engine.poses(bodies), boxes_of(engine, bodies)
        poses, boxes = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), seen)
        state = self._observe(data, is_new, intent, motion._replace(bodies=None), poses, boxes, sight)
        return state._replace(data=state.data._replace(world=state.data.world._replace(bodies=bodies)))

    def _placed(self, bodies: Any, is_new: Any, poses: Any) -> Any:
        """Bodies of which the robots of new episodes rest at their beginnings."""
        is_new, poses = self._given((is_new, poses))
        if self._on_host and not is_new.any():
            return bodies
        xp = np if self._on_host else jnp
        placed = self._engine.place(poses, xp.ones((*self._axes, self.n_robots), bool))
        return jax.tree.map(lambda new, old: xp.where(_over(is_new, new), new, old), placed, bodies)

    def _of_worlds(self, name: str) -> Callable[..., Any]:
        """A stage of `Core` of all worlds that `reset` and `step` are of."""
        if self._on_host:
            arrays, structure = jax.tree.flatten(self.core)
            return partial(_program(structure, name), arrays)
        stage = getattr(self.core, name)
        return stage if self.n_worlds is None else jax.vmap(stage)

    def _given(self, values: Any) -> Any:
        """Values as the engine takes them: NumPy arrays on the host."""
        return jax.tree.map(np.asarray, values) if self._on_host else values

    def _committed(self, values: Any) -> Any:
        """Values committed to the device, as results of programs are: else `jax.jit` compiles for both kinds."""
        return jax.device_put(values, self._device) if self._on_host else values

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


@lru_cache(maxsize=64)
def _program(structure: Any, name: str) -> Callable[..., Any]:
    """A stage of worlds on the host, compiled once for all environments that differ in arrays of `Core` alone."""

    def of_worlds(arrays: list[Any], *given: Any) -> Any:
        stage = getattr(jax.tree.unflatten(structure, arrays), name)
        return pad_singleton_batch(jax.vmap(stage))(*given)

    return jax.jit(of_worlds)


def _over(flags: Any, values: Any) -> Any:
    """Flags (*B,) with axes for those that values (*B, ...) have beyond."""
    return flags.reshape(flags.shape + (1,) * (values.ndim - flags.ndim))
