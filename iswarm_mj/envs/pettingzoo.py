"""A swarm as a PettingZoo environment: robots act in parallel."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Space
from pettingzoo import ParallelEnv

from iswarm_mj.envs.adapters import Worlds, stacked
from iswarm_mj.utils.constraints import check
from iswarm_mj.utils.errors import UserError


class SwarmParallelEnv(ParallelEnv[str, np.ndarray, np.ndarray]):
    """One world of N robots, called robot_0 and so on; all of them stay until the episode ends for all."""

    metadata = {"name": "iswarm_v0", "render_modes": [], "is_parallelizable": True}  # noqa: RUF012
    render_mode = None

    def __init__(self, **settings: Any):
        """Make the world, see `make_env`."""
        self._worlds = Worlds(1, **settings)
        self.possible_agents = [f"robot_{robot}" for robot in range(self._worlds.env.n_robots)]
        self.agents: list[str] = []
        seen, done = self._worlds.spaces()
        self.observation_spaces = {agent: Box(seen[0], seen[1], dtype=np.float32) for agent in self.possible_agents}
        self.action_spaces = {agent: Box(done[0], done[1], dtype=np.float32) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Space:
        """Return what a robot observes, see `Env.observations`.

        Raises:
            UserError: there is no such robot.
        """
        return self._of(agent, self.observation_spaces)

    def action_space(self, agent: str) -> Space:
        """Return what a robot does, see `Env.actions`.

        Raises:
            UserError: there is no such robot.
        """
        return self._of(agent, self.action_spaces)

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
        check("actions", type(actions).__name__, "a dict of each agent's action", isinstance(actions, Mapping))
        wrong = sorted(map(str, set(self.agents) ^ set(actions)))
        if wrong:
            raise UserError(f"step needs an action of each agent and no others (differing: {', '.join(wrong[:5])})")
        shape = self.action_spaces[self.possible_agents[0]].shape
        given = [stacked(actions[agent]) for agent in self.agents]
        for agent, action in zip(self.agents, given, strict=True):
            if action.shape != shape:
                raise UserError(f"the action of {agent} must have the shape {shape} (got {action.shape})")
        done, agents = self._worlds.step(np.stack(given)[None]), self.agents
        info = {name: value[0] for name, value in done.info.items()}
        terminated, truncated = bool(done.terminated[0]), bool(done.truncated[0])
        self.agents = [] if terminated or truncated else agents
        return (
            self._each(done.obs[0]),
            {agent: float(reward) for agent, reward in zip(agents, done.reward[0], strict=True)},
            dict.fromkeys(agents, terminated),
            dict.fromkeys(agents, truncated),
            {agent: dict(info) for agent in agents},
        )

    def render(self) -> None:
        """Nothing; recordings are made by `iswarm run`."""

    def close(self) -> None:
        """Nothing is open."""

    def _of(self, agent: Any, spaces: Mapping[str, Space]) -> Space:
        known = f"{self.possible_agents[0]} to {self.possible_agents[-1]}"
        is_known = isinstance(agent, str) and agent in spaces
        check("agent", agent, f"one of `possible_agents`, {known}", is_known)
        return spaces[agent]

    def _each(self, obs: np.ndarray) -> dict[str, np.ndarray]:
        return {agent: row.copy() for agent, row in zip(self.possible_agents, obs, strict=True)}
