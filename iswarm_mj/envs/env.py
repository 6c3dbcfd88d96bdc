"""Environments: many worlds at once on host engines, pure functions on compiled ones."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from functools import lru_cache, partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.engines.base import CompiledEngine, Engine, Motion, boxes_of
from iswarm_mj.engines.validation import engine_code
from iswarm_mj.envs import tables
from iswarm_mj.envs.core import Core, Episode, Intent, Seen, State
from iswarm_mj.envs.tables import check_action
from iswarm_mj.simulation.actuate import drive_phases, velocity_towards
from iswarm_mj.simulation.decide import pad_singleton_batch
from iswarm_mj.utils.errors import UserError, shown
from iswarm_mj.utils.jax_setup import check_jax


class Env:
    """N robots of one world, or of B worlds at once, which act together.

    On a compiled engine `reset` and `step` are pure functions, for `jax.jit`, and `jax.vmap` where
    `n_worlds` is None. On an engine of the host they are not; only the parts without the engine are
    compiled.

    Attributes:
        core: the part that does not depend on the engine.
        n_robots: number of robots N.
        n_worlds: number of worlds B; None where `reset` and `step` take one world, and `jax.vmap`
            maps them.
        observations: rows of an observation: names, sizes, units and bounds.
        actions: rows of an action.
        observation_size: D, numbers of each robot's observation.
        action_size: A, numbers of each robot's action.
        dt: duration of a step [s].
    """

    def __init__(
        self, core: Core, engine: CompiledEngine | Engine, n_worlds: int | None, *, on_host: bool
    ):
        """Take the parts of an environment, and compile nothing yet.

        Args:
            core: the part that does not depend on the engine.
            engine: the engine.
            n_worlds: number of worlds, see the attribute.
            on_host: the engine computes on the host.
        """
        self.core = core
        self.n_worlds = n_worlds
        self.n_robots = core.n_robots
        self.observations = core.observations
        self.actions = core.actions
        self.observation_size = sum(row.size for row in self.observations)
        self.action_size = sum(row.size for row in self.actions)
        self.dt = core.static_config.drive.control_period
        self._engine = engine
        self._on_host = on_host
        self._device = jax.local_devices(backend="cpu")[0] if on_host else None

        self._begin = self._stage("begin")
        self._auto_reset = self._stage("auto_reset")
        self._act = self._stage("act")
        self._observe = self._stage("observe")
        self._compiled_reset = self._reset if on_host else jax.jit(self._reset)
        self._compiled_step = self._step if on_host else jax.jit(self._step)

    def named(self, obs: Any) -> dict[str, Any]:
        """Return observations (..., D) by the names of `observations`.

        Raises:
            UserError: the array has another number of columns.
        """
        if getattr(obs, "shape", ())[-1:] != (self.observation_size,):
            raise UserError(
                f"obs must be an array (..., {self.observation_size}) (got {shown(obs)}); "
                "give the `obs` of a state."
            )
        return tables.split(self.observations, obs)

    def poses(self, state: State) -> Any:
        """Return the poses of the robots (*B, N, 3): x, y [mm] and yaw [rad]."""
        return self._engine.poses(state.data.world.bodies)

    def boxes(self, state: State) -> Any:
        """Return the poses of the boxes (*B, M, 3); None where there are none."""
        return boxes_of(self._engine, state.data.world.bodies)

    def reset(self, key: jax.Array) -> State:
        """Begin an episode.

        Args:
            key: random key, or one for each of B worlds.

        Raises:
            UserError: these are no random keys, or not as many as worlds.
        """
        check_jax()
        keys = self._check_keys(key)
        with self._explain_engine(), jax.default_device(self._device):
            return self._compiled_reset(jax.device_put(keys, self._device))

    def step(self, state: State, action: Any) -> State:
        """Take a control step; a world whose episode has ended begins a new one instead.

        Args:
            state: state from `reset` or `step`.
            action: (*B, N, A) from -1 to 1, see `actions`; beyond, it is clipped. An action that is
                not finite is a fault, which ends the episode of its world alone.

        Raises:
            UserError: shape or type of the action do not fit.
        """
        check_jax()
        action = check_action(action, (*self._axes, self.n_robots, self.action_size))
        with self._explain_engine(), jax.default_device(self._device):
            return self._compiled_step(state, action)

    def _explain_engine(self) -> AbstractContextManager[None]:
        """Return a context in which exceptions of a user's engine on the host are explained."""
        return engine_code(self._engine) if self._on_host else nullcontext()

    def _reset(self, key: jax.Array) -> State:
        """Begin episodes: place the robots, and let them perceive."""
        episode, poses = self._begin(key)
        is_new = self._committed(jnp.ones(self._axes, bool))
        all_present = jnp.ones((*self._axes, self.n_robots), bool)
        bodies = self._engine.place(*self._for_engine((poses, all_present)))

        no_action = jnp.zeros((*self._axes, self.n_robots, self.action_size))
        robot_poses = poses[..., : self.n_robots, :]
        intent = self._act(episode, is_new, no_action, robot_poses)

        no_fault = jnp.zeros(self._axes, jnp.int32)
        touching = self._for_engine(episode.world.touching)
        motion = Motion(bodies, touching, fault=no_fault, robot=no_fault)
        return self._look(episode, is_new, intent, motion)

    def _step(self, state: State, action: jax.Array) -> State:
        """Take a control step: act, move, and perceive; worlds with new episodes only perceive."""
        world = state.data.world
        is_new = state.done
        old_episode = state.data._replace(world=world._replace(bodies=None))
        episode, new_poses = self._auto_reset(old_episode, is_new)

        poses = self._committed(jnp.asarray(self._engine.poses(world.bodies), jnp.float32))
        intent = self._act(episode, is_new, action, poses)
        motion = self._move(world.bodies, intent)
        bodies = self._place_new(motion.bodies, is_new, new_poses)
        return self._look(episode, is_new, intent, motion._replace(bodies=bodies))

    def _move(self, bodies: Any, intent: Intent) -> Motion:
        """Return the motion of robots and driven boxes."""
        drive_config = self.core.static_config.drive
        box_velocity = velocity_towards(
            drive_config,
            is_driven=self._for_engine(self.core.params.is_driven),
            target_poses=self._for_engine(intent.box_targets),
            box_poses=boxes_of(self._engine, bodies),
        )
        command = self._for_engine(intent.drive.command)
        phases = drive_phases(drive_config, command, box_velocity)
        return self._engine.move(bodies, phases, self._for_engine(intent.is_running))

    def _place_new(self, bodies: Any, is_new: Any, poses: Any) -> Any:
        """Return bodies of which those of new episodes rest at their poses."""
        is_new, poses = self._for_engine((is_new, poses))
        if self._on_host and not is_new.any():
            return bodies
        xp = np if self._on_host else jnp
        all_present = xp.ones((*self._axes, self.n_robots), bool)
        placed = self._engine.place(poses, all_present)

        def choose(new: Any, old: Any) -> Any:
            trailing_axes = (1,) * (new.ndim - is_new.ndim)
            return xp.where(is_new.reshape(is_new.shape + trailing_axes), new, old)

        return jax.tree.map(choose, placed, bodies)

    def _look(self, episode: Episode, is_new: Any, intent: Intent, motion: Motion) -> State:
        """Return the state after a motion: the engine senses, and the robots perceive."""
        bodies = motion.bodies
        seen = self._sense(bodies, intent)
        state = self._observe(episode, is_new, intent, motion._replace(bodies=None), seen)

        # `Core` knows nothing of the bodies, which only the engine understands.
        world = state.data.world._replace(bodies=bodies)
        return state._replace(data=state.data._replace(world=world))

    def _sense(self, bodies: Any, intent: Intent) -> Seen:
        """Return what the engine senses: poses and light."""
        emits = self._for_engine(intent.is_emitting)
        all_run = self._for_engine(jnp.ones(self._axes, bool))
        light = self._engine.sense(bodies, emits, all_run)

        poses = jnp.asarray(self._engine.poses(bodies), jnp.float32)
        boxes = boxes_of(self._engine, bodies)
        if boxes is not None:
            boxes = jnp.asarray(boxes, jnp.float32)
        return Seen(poses, boxes, light)

    def _stage(self, name: str) -> Callable[..., Any]:
        """Return a method of `Core` for all worlds that `reset` and `step` take."""
        if self._on_host:
            arrays, structure = jax.tree.flatten(self.core)
            return partial(_host_program(structure, name), arrays)
        method = getattr(self.core, name)
        return method if self.n_worlds is None else jax.vmap(method)

    def _for_engine(self, values: Any) -> Any:
        """Return values as the engine takes them: NumPy arrays on the host."""
        return jax.tree.map(np.asarray, values) if self._on_host else values

    def _committed(self, values: Any) -> Any:
        """Return values on the device; of uncommitted ones `jax.jit` compiles a second program."""
        return jax.device_put(values, self._device) if self._on_host else values

    @property
    def _axes(self) -> tuple[int, ...]:
        """Leading axes of all arrays: that of the worlds, or none."""
        return () if self.n_worlds is None else (self.n_worlds,)

    def _check_keys(self, key: Any) -> jax.Array:
        """Return random keys, also of their data in arrays of two words.

        Raises:
            UserError: these are no random keys, or not as many as worlds.
        """
        is_array = isinstance(key, jax.Array)
        if is_array and key.dtype == jnp.uint32 and key.shape == (*self._axes, 2):
            return jax.random.wrap_key_data(key)
        is_key = is_array and jnp.issubdtype(key.dtype, jax.dtypes.prng_key)
        if is_key and key.shape == self._axes:
            return key
        if self.n_worlds is None:
            raise UserError("reset needs a random key; make them by jax.random.key(0)")
        raise UserError(
            f"reset needs {self.n_worlds} random keys, one for each world; "
            f"make them by jax.random.split(jax.random.key(0), {self.n_worlds})"
        )


@lru_cache(maxsize=64)
def _host_program(structure: Any, name: str) -> Callable[..., Any]:
    """Return a method of `Core` for B worlds, compiled once for all values of its arrays."""

    def of_worlds(arrays: list[Any], *arguments: Any) -> Any:
        core = jax.tree.unflatten(structure, arrays)
        method = jax.vmap(getattr(core, name))
        return pad_singleton_batch(method)(*arguments)

    return jax.jit(of_worlds)
