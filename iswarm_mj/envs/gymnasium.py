"""Swarms as Gymnasium environments, in which the robots of a world are one agent."""

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import gymnasium
import jax
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from iswarm_mj.envs.core import State
from iswarm_mj.envs.env import Env
from iswarm_mj.envs.make import prepare_env, scenario_of
from iswarm_mj.envs.tables import Row, bounds, check_action
from iswarm_mj.envs.watch import EnvRecording, Pictures
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.constraints import check, is_whole
from iswarm_mj.utils.errors import UserError

RENDERING = {"render_modes": ["rgb_array"], "render_fps": 10}
"""Metadata of pictures, which show 10 control steps a second."""

MAX_SEED = 2**32 - 1
"""Largest seed, since keys of JAX take no more bits."""

_ACTION_TOLERANCE = 1e-6
"""Amount by which rounding may take an action beyond -1 and 1."""


def box_of(table: list[Row], *n_robots: int) -> Box:
    """Return the space of the numbers of a table, for one robot (D,) or for N robots (N, D)."""
    low, high = bounds(table)
    shape = (*n_robots, len(low))
    return Box(np.broadcast_to(low, shape), np.broadcast_to(high, shape), dtype=np.float32)


def _with_worlds(scenario: Scenario, num_envs: Any) -> Scenario:
    """Return a scenario with `num_envs` worlds, its own number for None.

    Raises:
        UserError: it is no number of worlds, or the scenario has another one.
    """
    if num_envs is None:
        return scenario
    is_number = is_whole(num_envs) and num_envs >= 1
    check("num_envs", num_envs, "a whole number, at least 1", is_number)
    if scenario.worlds not in (1, num_envs):
        raise UserError(
            f"`num_envs` is {num_envs}, but the scenario has {scenario.n_worlds} worlds; "
            "leave out one of them"
        )
    return replace(scenario, worlds=int(num_envs))


class SwarmVectorEnv(VectorEnv):
    """B worlds: observations (B, N, D), actions (B, N, A), rewards (B,) summed over robots.

    Copies and pickles are made again from the same settings: their first episode begins with
    `reset`.
    """

    metadata = {**RENDERING, "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(
        self,
        scenario: Scenario | None = None,
        num_envs: int | None = None,
        render_mode: str | None = None,
        record: Path | str | None = None,
        payload: Any = None,
        n_starts: int = 64,
        **fields: Any,
    ):
        """Make the worlds.

        Args:
            scenario: see `make_env`.
            num_envs: number of worlds B, by default that of the scenario.
            render_mode: `rgb_array`: `render` returns pictures.
            record: file for Rerun, `*.rrd`, to which world 0 is recorded; copies of the environment
                record nothing.
            payload: see `make_env`.
            n_starts: see `make_env`.
            fields: fields of the scenario, in its place.

        Raises:
            UserError: `num_envs` is no number of worlds, or another than the scenario's; there is
                no such mode; or see `make_env`.
        """
        check("render_mode", render_mode, "rgb_array, or None", render_mode in ("rgb_array", None))
        scenario = _with_worlds(scenario_of(scenario, fields), num_envs)
        self._arguments = {
            "scenario": scenario,
            "render_mode": render_mode,
            "payload": payload,
            "n_starts": n_starts,
        }
        self.prepared = prepare_env(scenario, payload=payload, n_starts=n_starts)
        self.num_envs = scenario.n_worlds
        self.render_mode = render_mode

        n_robots = self.prepared.n_robots
        self.single_observation_space = box_of(self.prepared.observations, n_robots)
        self.single_action_space = box_of(self.prepared.actions, n_robots)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

        self._state: State | None = None
        self._pictures: Pictures | None = None
        self._recording = None if record is None else EnvRecording(self.env, record)

    @cached_property
    def env(self) -> Env:
        """The environment of JAX, made when it is first used, so that Gymnasium may fork before."""
        return self.prepared.make()

    @cached_property
    def _reset(self) -> Callable[[Any], State]:
        """The function that begins episodes in all worlds."""
        return self._of_all_worlds(self.env.reset)

    @cached_property
    def _step(self) -> Callable[[State, Any], State]:
        """The function that takes a control step in all worlds."""
        return self._of_all_worlds(self.env.step)

    def _of_all_worlds(self, method: Callable[..., State]) -> Callable[..., State]:
        """Return a method of `Env` that takes all worlds, also where it takes one."""
        return jax.jit(jax.vmap(method)) if self.env.n_worlds is None else method

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what makes another one."""
        return partial(type(self), **self._arguments), ()

    def reset(self, *, seed: Any = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """Begin all episodes, which the seed determines; None draws one.

        Raises:
            ConfigError: the seed is no whole number, or out of range.
        """
        is_seed = seed is None or (is_whole(seed) and 0 <= int(seed) <= MAX_SEED)
        constraint = f"a whole number from 0 to {MAX_SEED}, or None for one by chance"
        check("seed", seed, constraint, is_seed)

        # Later episodes follow from the seed, too.
        super().reset(seed=None if seed is None else int(seed))
        number = int(self.np_random.integers(2**31)) if seed is None else int(seed)
        keys = jax.random.split(jax.random.key(number), self.num_envs)
        self._state = self._reset(keys)
        self._record(self._state)
        return np.array(self._state.obs), {}

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        """Take a control step; a world whose episode has ended begins a new one instead.

        Returns:
            Observations; rewards; worlds that reached their goal; worlds whose time is up or that
            have a fault; metrics of the task with `is_finished`, and `fault`: bits of `FaultKind`,
            0 for no fault.

        Raises:
            UserError: no episode has begun, or an action is not finite, lies beyond -1 and 1, or
                has another shape.
        """
        obs, reward, terminated, truncated, info = self.step_robots(actions)
        return obs, reward.sum(axis=1), terminated, truncated, info

    def step_robots(
        self, actions: Any
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        """Take a control step, and return what `step` does with the reward of each robot (B, N)."""
        state = self.current_state("step")
        shape = (self.num_envs, self.env.n_robots, self.env.action_size)
        values = np.asarray(check_action(actions, shape))
        self._check_range(values)
        self._state = self._step(state, values)
        self._record(self._state)

        # Copies, since clients change observations in place.
        after: State = jax.tree.map(np.array, self._state._replace(data=None))
        is_finished = after.info["is_finished"]
        info = {**after.metrics, "is_finished": is_finished, "fault": after.info["fault"]}
        truncated = after.done & ~is_finished
        return np.asarray(after.obs), np.asarray(after.reward), is_finished, truncated, info

    @staticmethod
    def _check_range(actions: np.ndarray) -> None:
        """Raise a UserError if an action lies beyond -1 and 1, or is not finite."""
        is_bad = ~(np.abs(actions) <= 1.0 + _ACTION_TOLERANCE)
        if is_bad.any():
            place = tuple(int(index) for index in np.argwhere(is_bad)[0])
            raise UserError(
                f"an action must lie between -1 and 1 (got {actions[place]} at {place}); clip it"
            )

    def current_state(self, method: str) -> State:
        """Return the state of the episodes.

        Args:
            method: name of the method that needs it, for the message.

        Raises:
            UserError: no episode has begun.
        """
        if self._state is None:
            raise UserError(f"{method} needs an episode; call reset first")
        return self._state

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture (height, width, 3) of each world; None without a `render_mode`.

        Raises:
            UserError: no episode has begun, or there is no off-screen OpenGL.
        """
        if self.render_mode is None:
            return None
        state = self.current_state("render")
        if self._pictures is None:
            self._pictures = Pictures(self.env, state)
        return tuple(self._pictures.show(state, world) for world in range(self.num_envs))

    def close_extras(self, **_: Any) -> None:
        """Complete the recording, and release OpenGL."""
        if self._recording is not None:
            self._recording.close()
            self._recording = None
        if self._pictures is not None:
            self._pictures.close()
            self._pictures = None

    def _record(self, state: State) -> None:
        """Record a state, if there is a recording."""
        if self._recording is not None:
            self._recording.add(state)


class SwarmEnv(gymnasium.Env):
    """One world: observations (N, D), actions (N, A), the rewards of its robots summed."""

    metadata = RENDERING

    def __init__(self, scenario: Scenario | None = None, **settings: Any):
        """Make the world, see `SwarmVectorEnv`."""
        self._vector_env = SwarmVectorEnv(scenario, num_envs=1, **settings)
        self.render_mode = self._vector_env.render_mode
        self.observation_space = self._vector_env.single_observation_space
        self.action_space = self._vector_env.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict | None = None
    ) -> tuple[np.ndarray, dict]:
        """Begin an episode, see `SwarmVectorEnv.reset`."""
        obs, _ = self._vector_env.reset(seed=seed)
        super().reset(seed=None if seed is None else int(seed))
        return obs[0], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Take a control step, see `SwarmVectorEnv.step`."""
        env = self._vector_env.env
        of_robots = check_action(action, (env.n_robots, env.action_size))
        obs, reward, terminated, truncated, info = self._vector_env.step(of_robots[None])
        info = {name: value[0] for name, value in info.items()}
        return obs[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def render(self) -> Any:
        """Return a picture (height, width, 3); None without a `render_mode`."""
        pictures = self._vector_env.render()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Complete the recording, and release OpenGL."""
        self._vector_env.close()


single_env = SwarmEnv
"""The environment of one world: `single_env(scenario)`."""
vector_env = SwarmVectorEnv
"""The environment of many worlds: `vector_env(scenario, num_envs=64)`."""

# As `gymnasium.make("iswarm/Cleaning-v0", robots=20)`, once this module is imported.
gymnasium.register(
    "iswarm/Cleaning-v0",
    entry_point=f"{__name__}:SwarmEnv",
    vector_entry_point=f"{__name__}:SwarmVectorEnv",
)
