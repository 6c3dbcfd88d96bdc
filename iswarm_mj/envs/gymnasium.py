"""Swarms as Gymnasium environments: the robots of a world as one agent, one world or many at once."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import jax
import numpy as np

from iswarm_mj.envs.core import State
from iswarm_mj.envs.env import Env
from iswarm_mj.envs.make import prepare_env, scenario_of
from iswarm_mj.envs.tables import Row, bounds, checked
from iswarm_mj.envs.watch import EnvRecording, Pictures
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.constraints import check, is_whole
from iswarm_mj.utils.errors import UserError


@contextmanager
def installed() -> Iterator[None]:
    """Raise a UserError where a package that is imported inside is missing."""
    try:
        yield
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        raise UserError(f"this environment needs {package}; run pip install 'iswarm-mj[marl]'") from None


with installed():
    import gymnasium
    from gymnasium.spaces import Box
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space

RENDERING = {"render_modes": ["rgb_array"], "render_fps": 10}
"""Metadata of pictures, which show 10 control steps a second."""
MOST_SEED = 2**32 - 1
"""Keys of JAX take no more bits of a seed."""


def box_of(table: list[Row], *n_robots: int) -> Box:
    """Space of the numbers of a table, of one robot (D,) or of N robots (N, D)."""
    low, high = (np.broadcast_to(end, (*n_robots, len(end))) for end in bounds(table))
    return Box(low, high, dtype=np.float32)


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
            f"`num_envs` is {num_envs}, but the scenario has {scenario.n_worlds} worlds; leave out one of them"
        )
    return replace(scenario, worlds=int(num_envs))


class SwarmVectorEnv(VectorEnv):
    """B worlds: observations (B, N, D), actions (B, N, A), the rewards of a world's robots summed (B,).

    Copies and pickles are made anew from the same settings: their first episode begins with `reset`.
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
            num_envs: B, by default the number of worlds of the scenario.
            render_mode: `rgb_array`: `render` returns pictures.
            record: file for Rerun, `*.rrd`, to which world 0 is recorded; copies of the environment record nothing.
            payload: see `make_env`.
            n_starts: see `make_env`.
            fields: fields of the scenario, in its place.

        Raises:
            UserError: `num_envs` is no number of worlds, or another than the scenario's; there is no such mode; or see
                `make_env`.
        """
        check("render_mode", render_mode, "rgb_array, or None", render_mode in ("rgb_array", None))
        scenario = _with_worlds(scenario_of(scenario, fields), num_envs)
        self._arguments = {
            "scenario": scenario,
            "render_mode": render_mode,
            "payload": payload,
            "n_starts": n_starts,
        }
        self.prepared = prepared = prepare_env(scenario, payload=payload, n_starts=n_starts)
        self.num_envs = scenario.n_worlds
        self.render_mode = render_mode
        self.single_observation_space = box_of(prepared.observations, prepared.n_robots)
        self.single_action_space = box_of(prepared.actions, prepared.n_robots)
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
        """What begins episodes in all worlds."""
        return jax.jit(jax.vmap(self.env.reset)) if self.env.n_worlds is None else self.env.reset

    @cached_property
    def _step(self) -> Callable[[State, Any], State]:
        """What takes a control step in all worlds."""
        return jax.jit(jax.vmap(self.env.step)) if self.env.n_worlds is None else self.env.step

    def __reduce__(self) -> tuple[Any, ...]:
        """Return what makes another one."""
        return partial(type(self), **self._arguments), ()

    def reset(self, *, seed: Any = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """Begin all episodes, which the seed determines; None draws one.

        Raises:
            ConfigError: the seed is no whole number, or lies beyond what keys take.
        """
        is_seed = seed is None or (is_whole(seed) and 0 <= int(seed) <= MOST_SEED)
        check("seed", seed, f"a whole number from 0 to {MOST_SEED}, or None for one by chance", is_seed)
        super().reset(seed=None if seed is None else int(seed))  # from which later episodes follow, too
        number = int(self.np_random.integers(2**31)) if seed is None else int(seed)
        self._state = self._reset(jax.random.split(jax.random.key(number), self.num_envs))
        self._record(self._state)
        return np.array(self._state.obs), {}

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        """Take a control step; a world whose episode has ended begins a new one instead.

        Returns:
            Observations; rewards; whether each world reached its goal; whether its time is up or something went wrong;
            metrics of the task with `is_finished`, and `fault`: bits of `FaultKind`, 0 if nothing went wrong.

        Raises:
            UserError: no episode has begun, or an action is not finite, lies beyond -1 and 1, or does not fit.
        """
        obs, reward, terminated, truncated, info = self.step_robots(actions)
        return obs, reward.sum(axis=1), terminated, truncated, info

    def step_robots(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        """As `step`, with the reward of each robot (B, N)."""
        state, env = self.begun("step"), self.env
        values = np.asarray(checked(actions, (self.num_envs, env.n_robots, env.action_size)))
        is_bad = ~(np.abs(values) <= 1.0 + 1e-6)
        if is_bad.any():
            place = tuple(map(int, np.argwhere(is_bad)[0]))
            raise UserError(f"an action must lie between -1 and 1 (got {values[place]} at {place}); clip it")
        self._state = self._step(state, values)
        self._record(self._state)
        # Copies: clients change observations in place.
        found: State = jax.tree.map(np.array, self._state._replace(data=None))
        is_finished = found.info["is_finished"]
        info = {**found.metrics, "is_finished": is_finished, "fault": found.info["fault"]}
        return np.asarray(found.obs), np.asarray(found.reward), is_finished, found.done & ~is_finished, info

    def begun(self, method: str) -> State:
        """Return the present state.

        Raises:
            UserError: no episode has begun.
        """
        if self._state is None:
            raise UserError(f"{method} needs an episode; call reset first")
        return self._state

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture (height, width, 3) of each world, or None by the mode.

        Raises:
            UserError: no episode has begun, or there is no off-screen OpenGL.
        """
        if self.render_mode is None:
            return None
        state = self.begun("render")
        self._pictures = self._pictures or Pictures(self.env, state)
        return tuple(self._pictures.show(state, world) for world in range(self.num_envs))

    def close_extras(self, **_: Any) -> None:
        """Complete the recording, and release OpenGL."""
        for part in (self._recording, self._pictures):
            if part is not None:
                part.close()
        self._recording = self._pictures = None

    def _record(self, state: State) -> None:
        if self._recording is not None:
            self._recording.add(state)


class SwarmEnv(gymnasium.Env):
    """One world: observations (N, D), actions (N, A), the rewards of its robots summed."""

    metadata = RENDERING

    def __init__(self, scenario: Scenario | None = None, **settings: Any):
        """Make the world, see `SwarmVectorEnv`."""
        self._one = SwarmVectorEnv(scenario, num_envs=1, **settings)
        self.render_mode = self._one.render_mode
        self.observation_space, self.action_space = self._one.single_observation_space, self._one.single_action_space

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """See `SwarmVectorEnv.reset`."""
        obs, _ = self._one.reset(seed=seed)
        super().reset(seed=None if seed is None else int(seed))
        return obs[0], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """See `SwarmVectorEnv.step`."""
        actions = checked(action, (self._one.env.n_robots, self._one.env.action_size))[None]
        obs, reward, terminated, truncated, info = self._one.step(actions)
        info = {name: value[0] for name, value in info.items()}
        return obs[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), info

    def render(self) -> Any:
        """Return a picture (height, width, 3), or None by the mode."""
        pictures = self._one.render()
        return pictures and pictures[0]

    def close(self) -> None:
        """See `SwarmVectorEnv.close_extras`."""
        self._one.close()


single_env = SwarmEnv
"""The environment of one world: `single_env(scenario)`."""
vector_env = SwarmVectorEnv
"""The environment of many worlds: `vector_env(scenario, num_envs=64)`."""

# As `gymnasium.make("iswarm/Cleaning-v0", robots=20)`, once this module is imported.
gymnasium.register(
    "iswarm/Cleaning-v0", entry_point=f"{__name__}:SwarmEnv", vector_entry_point=f"{__name__}:SwarmVectorEnv"
)
