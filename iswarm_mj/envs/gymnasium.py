"""Swarms as Gymnasium environments: the robots of a world as one agent, one world or many at once."""

from typing import Any

import numpy as np

from iswarm_mj.envs.actions import checked
from iswarm_mj.envs.adapters import FPS, MODES, Worlds, installed
from iswarm_mj.utils.constraints import check, is_whole

with installed():
    import gymnasium
    from gymnasium.spaces import Box
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space


class SwarmVectorEnv(VectorEnv):
    """B worlds: observations (B, N, D), actions (B, N, A), the rewards of a world's robots summed (B,)."""

    metadata = {"render_modes": [*MODES], "render_fps": FPS, "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, task: Any = "cleaning", n_robots: int = 20, num_envs: int = 1, **settings: Any):
        """Make the worlds, see `make_env`, and `adapters.Worlds` for `render_mode` and `record`.

        Raises:
            UserError: `num_envs` is no number of worlds, or of more than fit into the memory; or see `make_env`.
        """
        check("num_envs", num_envs, "a whole number, at least 1", is_whole(num_envs) and num_envs >= 1)
        self._worlds, self.num_envs = Worlds(num_envs, task=task, n_robots=n_robots, **settings), int(num_envs)
        self.render_mode = settings.get("render_mode")
        self.single_observation_space, self.single_action_space = self._worlds.spaces(Box, self._worlds.env.n_robots)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """Begin all episodes, which the seed determines.

        Raises:
            UserError: the seed is none.
        """
        obs = self._worlds.reset(seed)
        super().reset(seed=None if seed is None else int(seed))
        return obs, {}

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict]:
        """Take a control step; a world whose episode has ended begins a new one instead. See `adapters.Outcome`."""
        done = self._worlds.step(actions)
        return done.obs, done.reward.sum(axis=1), done.terminated, done.truncated, done.info

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture of each world, see `Worlds.render`; the window shows the first one."""
        pictures = tuple(self._worlds.render(world) for world in range(self.num_envs if self._is_drawn else 1))
        return pictures if self._is_drawn else None

    @property
    def _is_drawn(self) -> bool:
        return self.render_mode == "rgb_array"

    def close_extras(self, **_: Any) -> None:
        """See `Worlds.close`."""
        self._worlds.close()


class SwarmEnv(gymnasium.Env):
    """One world: observations (N, D), actions (N, A), the rewards of its robots summed."""

    metadata = {"render_modes": [*MODES], "render_fps": FPS}  # noqa: RUF012

    def __init__(self, task: Any = "cleaning", n_robots: int = 20, **settings: Any):
        """Make the world, see `make_env`, and `adapters.Worlds` for `render_mode` and `record`."""
        self._worlds = Worlds(1, task=task, n_robots=n_robots, **settings)
        self.render_mode = settings.get("render_mode")
        self.observation_space, self.action_space = self._worlds.spaces(Box, self._worlds.env.n_robots)

    def reset(self, *, seed: int | None = None, options: dict | None = None) -> tuple[np.ndarray, dict]:
        """Begin an episode, which the seed determines.

        Raises:
            UserError: the seed is none.
        """
        obs = self._worlds.reset(seed)
        super().reset(seed=None if seed is None else int(seed))
        return obs[0], {}

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Take a control step, see `adapters.Outcome`."""
        done = self._worlds.step(checked(action, self._worlds.shape)[None])
        info = {name: value[0] for name, value in done.info.items()}
        return done.obs[0], float(done.reward.sum()), bool(done.terminated[0]), bool(done.truncated[0]), info

    def render(self) -> Any:
        """See `Worlds.render`."""
        return self._worlds.render()

    def close(self) -> None:
        """See `Worlds.close`."""
        self._worlds.close()


# As `gymnasium.make("iswarm/Cleaning-v0", n_robots=20)`, once this module is imported.
gymnasium.register(
    "iswarm/Cleaning-v0", entry_point=f"{__name__}:SwarmEnv", vector_entry_point=f"{__name__}:SwarmVectorEnv"
)
