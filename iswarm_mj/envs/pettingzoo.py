"""A swarm as a PettingZoo environment: robots act in parallel."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from iswarm_mj.envs.gymnasium import RENDERING, SwarmVectorEnv, box_of, installed
from iswarm_mj.envs.tables import checked
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

with installed():
    from gymnasium.spaces import Space
    from pettingzoo import ParallelEnv


class SwarmParallelEnv(ParallelEnv[str, np.ndarray, np.ndarray]):
    """One world of N robots, called robot_0 and so on; all of them stay until the episode ends for all."""

    metadata = {**RENDERING, "name": "iswarm_v0", "is_parallelizable": True}  # noqa: RUF012

    def __init__(self, scenario: Scenario | None = None, **settings: Any):
        """Make the world, see `SwarmVectorEnv`."""
        self._one = SwarmVectorEnv(scenario, num_envs=1, **settings)
        self.render_mode = self._one.render_mode
        prepared = self._one.prepared
        self.possible_agents = [f"robot_{robot}" for robot in range(prepared.n_robots)]
        self.agents: list[str] = []
        self.observation_spaces = {agent: box_of(prepared.observations) for agent in self.possible_agents}
        self.action_spaces = {agent: box_of(prepared.actions) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Space:
        """Return what a robot observes, see `Env.observations`."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Space:
        """Return what a robot does, see `Env.actions`."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """See `SwarmVectorEnv.reset`."""
        obs, _ = self._one.reset(seed=seed)
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
        size = self._one.env.action_size
        each = np.stack([checked(actions[agent], (size,)) for agent in self.agents])
        obs, reward, (terminated,), (truncated,), info = self._one.step_robots(each[None])
        agents, own = self.agents, {name: value[0] for name, value in info.items()}
        self.agents = [] if terminated or truncated else agents
        return (
            self._each(obs[0]),
            dict(zip(agents, reward[0].tolist(), strict=True)),
            dict.fromkeys(agents, bool(terminated)),
            dict.fromkeys(agents, bool(truncated)),
            {agent: dict(own) for agent in agents},
        )

    def state(self) -> np.ndarray:
        """Return what a critic of all robots may know, as one array: all observations, then x, y [rd] and yaw [rad].

        Raises:
            UserError: no episode has begun.
        """
        state = self._one.begun("state")
        poses = np.array(self._one.env.poses(state), np.float32) / (RD, RD, 1)
        return np.concatenate([np.ravel(state.obs), poses.ravel()], dtype=np.float32)

    def render(self) -> Any:
        """Return a picture (height, width, 3), or None by the mode."""
        pictures = self._one.render()
        return pictures and pictures[0]

    def close(self) -> None:
        """See `SwarmVectorEnv.close_extras`."""
        self._one.close()

    def _each(self, obs: np.ndarray) -> dict[str, np.ndarray]:
        return {agent: row.copy() for agent, row in zip(self.possible_agents, obs, strict=True)}


parallel_env = SwarmParallelEnv
"""The environment of one world, by the name that PettingZoo gives it: `parallel_env(scenario)`."""
