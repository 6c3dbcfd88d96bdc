"""A swarm as a PettingZoo environment: robots act in parallel."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Space
from pettingzoo import ParallelEnv

from iswarm_mj.envs.gymnasium import RENDERING, SwarmVectorEnv, box_of
from iswarm_mj.envs.tables import check_action
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

_MAX_LISTED = 5
"""Largest number of agents that a message lists."""


class SwarmParallelEnv(ParallelEnv[str, np.ndarray, np.ndarray]):
    """One world of N robots, called robot_0 and so on; all stay until the episode ends for all.

    Whoever steps it calls `reset` after the end of an episode: it has no `agents` until then, and
    `step` raises an error.
    """

    metadata = {**RENDERING, "name": "iswarm_v0", "is_parallelizable": True}  # noqa: RUF012

    def __init__(self, scenario: Scenario | None = None, **settings: Any):
        """Make the world, see `SwarmVectorEnv`."""
        self._vector_env = SwarmVectorEnv(scenario, num_envs=1, **settings)
        self.render_mode = self._vector_env.render_mode
        prepared = self._vector_env.prepared
        self.possible_agents = [f"robot_{robot}" for robot in range(prepared.n_robots)]
        self.agents: list[str] = []

        # Each agent has spaces of its own, since spaces hold random generators.
        self.observation_spaces = {
            agent: box_of(prepared.observations) for agent in self.possible_agents
        }
        self.action_spaces = {agent: box_of(prepared.actions) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Space:
        """Return the space of a robot's observations, whose rows `Env.observations` describes."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space:
        """Return the space of a robot's actions, see `Env.actions`."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """Begin an episode, see `SwarmVectorEnv.reset`.

        Args:
            seed: seed of the episode; None draws one.
            options: ignored: PettingZoo demands the parameter, and an episode has no options.
        """
        obs, _ = self._vector_env.reset(seed=seed)
        self.agents = list(self.possible_agents)
        return self._by_agent(obs[0]), {agent: {} for agent in self.agents}

    def step(self, actions: dict[str, np.ndarray]) -> tuple[dict, dict, dict, dict, dict]:
        """Take a control step; `infos` has the metrics of the task.

        Raises:
            UserError: actions are missing or are those of other agents, or are no numbers between
                -1 and 1.
        """
        if not self.agents:
            raise UserError("step needs an episode; call reset first")
        self._check_agents(actions)
        shape = (self._vector_env.env.action_size,)
        rows = np.stack([check_action(actions[agent], shape) for agent in self.agents])
        obs, reward, terminated, truncated, info = self._vector_env.step_robots(rows[None])

        agents = self.agents
        is_terminated = bool(terminated[0])
        is_truncated = bool(truncated[0])
        if is_terminated or is_truncated:
            self.agents = []
        info = {name: value[0] for name, value in info.items()}
        return (
            self._by_agent(obs[0]),
            dict(zip(agents, reward[0].tolist(), strict=True)),
            dict.fromkeys(agents, is_terminated),
            dict.fromkeys(agents, is_truncated),
            {agent: dict(info) for agent in agents},
        )

    def _check_agents(self, actions: Any) -> None:
        """Raise a UserError unless there is an action of each agent and of no others."""
        if not isinstance(actions, Mapping):
            kind = type(actions).__name__
            raise UserError(f"step needs a dictionary of actions by agent (got a {kind})")
        differing = sorted(str(name) for name in set(self.agents) ^ set(actions))
        if differing:
            listed = ", ".join(differing[:_MAX_LISTED])
            raise UserError(
                f"step needs an action of each agent and no others (differing: {listed})"
            )

    def state(self) -> np.ndarray:
        """Return an array for a critic of all robots: observations, then x, y [rd] and yaw [rad].

        Raises:
            UserError: no episode has begun.
        """
        state = self._vector_env.current_state(method="state")
        poses = np.array(self._vector_env.env.poses(state), np.float32) / (RD, RD, 1)
        return np.concatenate([np.ravel(state.obs), poses.ravel()], dtype=np.float32)

    def render(self) -> Any:
        """Return a picture (height, width, 3); None without a `render_mode`."""
        pictures = self._vector_env.render()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Complete the recording, and release OpenGL."""
        self._vector_env.close()

    def _by_agent(self, obs: np.ndarray) -> dict[str, np.ndarray]:
        """Return the rows of an array by the names of the robots."""
        return {agent: row.copy() for agent, row in zip(self.possible_agents, obs, strict=True)}


parallel_env = SwarmParallelEnv
"""The environment of one world, by the name that PettingZoo gives it: `parallel_env(scenario)`."""
