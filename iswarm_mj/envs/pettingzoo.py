"""A swarm as a PettingZoo environment: robots act in parallel."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from iswarm_mj.envs.actions import checked
from iswarm_mj.envs.adapters import FPS, MODES, Worlds, installed
from iswarm_mj.utils.errors import UserError

with installed():
    from gymnasium.spaces import Box, Space
    from pettingzoo import ParallelEnv


class SwarmParallelEnv(ParallelEnv[str, np.ndarray, np.ndarray]):
    """One world of N robots, called robot_0 and so on; all of them stay until the episode ends for all."""

    metadata = {  # noqa: RUF012
        "name": "iswarm_v0",
        "render_modes": [*MODES],
        "render_fps": FPS,
        "is_parallelizable": True,
    }

    def __init__(self, task: Any = "cleaning", n_robots: int = 20, **settings: Any):
        """Make the world, see `make_env`, and `adapters.Worlds` for `render_mode` and `record`."""
        self._worlds = Worlds(1, task=task, n_robots=n_robots, **settings)
        self.render_mode = settings.get("render_mode")
        self.possible_agents = [f"robot_{robot}" for robot in range(self._worlds.env.n_robots)]
        self.agents: list[str] = []
        spaces = [self._worlds.spaces(Box) for _ in self.possible_agents]
        self.observation_spaces = {agent: seen for agent, (seen, _) in zip(self.possible_agents, spaces, strict=True)}
        self.action_spaces = {agent: done for agent, (_, done) in zip(self.possible_agents, spaces, strict=True)}

    def observation_space(self, agent: str) -> Space:
        """Return what a robot observes, see `Env.observations`."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space:
        """Return what a robot does, see `Env.actions`."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """Begin an episode, which the seed determines.

        Raises:
            UserError: the seed is none.
        """
        obs = self._worlds.reset(seed)
        self.agents = list(self.possible_agents)
        return self._each(obs[0]), {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, np.ndarray]) -> tuple[dict, dict, dict, dict, dict]:
        """Take a control step; `infos` has the metrics of the task.

        Raises:
            UserError: actions are missing or of others, or are no numbers between -1 and 1.
        """
        if not self.agents:
            raise UserError("step needs an episode; call reset first")
        given = actions.keys() if isinstance(actions, Mapping) else {type(actions).__name__}
        if wrong := sorted(map(str, set(self.agents) ^ set(given))):
            raise UserError(f"step needs an action of each agent and no others (differing: {', '.join(wrong[:5])})")
        shape = self._worlds.shape[1:]
        done = self._worlds.step(np.stack([checked(actions[agent], shape) for agent in self.agents])[None])
        terminated, truncated, agents = bool(done.terminated[0]), bool(done.truncated[0]), self.agents
        self.agents = [] if terminated or truncated else agents
        return (
            self._each(done.obs[0]),
            {agent: float(reward) for agent, reward in zip(agents, done.reward[0], strict=True)},
            dict.fromkeys(agents, terminated),
            dict.fromkeys(agents, truncated),
            {agent: {name: value[0] for name, value in done.info.items()} for agent in agents},
        )

    def state(self) -> np.ndarray:
        """Return what a critic of all robots may know, as one array: all observations, then x, y [rd] and yaw [rad].

        Raises:
            UserError: no episode has begun.
        """
        return self._worlds.everything()[0]

    def render(self) -> Any:
        """See `Worlds.render`."""
        return self._worlds.render()

    def close(self) -> None:
        """See `Worlds.close`."""
        self._worlds.close()

    def _each(self, obs: np.ndarray) -> dict[str, np.ndarray]:
        return {agent: row.copy() for agent, row in zip(self.possible_agents, obs, strict=True)}
