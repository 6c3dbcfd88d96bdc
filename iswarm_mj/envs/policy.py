"""A policy that was learned on an environment, as a strategy: runs, recordings and comparisons take it."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.envs import tables
from iswarm_mj.envs.make import as_payload
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.base import Strategy, StrategyFactory
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.signatures import usable_task
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError


class PolicyStrategy(StrategyFactory):
    """Robots that act by a policy, as those of `make_env` with the same task and payload.

    Each robot's observation is a row of `Env.observations`, and the policy's output a row of `Env.actions`.
    """

    def __init__(
        self,
        apply: Callable[..., Any],
        params: Any,
        payload: Any = None,
        task: Any = CLEANING,
        memory: Callable[[int], Any] | None = None,
    ):
        """Keep the policy.

        Args:
            apply: pure JAX; of the weights and the observations (N, D) it returns actions (N, A) from -1 to 1. Of a
                policy with memory, it takes that as a third argument, and returns actions and the next memory.
            params: weights, a pytree of arrays.
            payload: of the environment, see `make_env`.
            task: of the environment; it names what robots sense beside balls and dump.
            memory: returns the first memory of N robots, a pytree of arrays with the robots as first axis.

        Raises:
            UserError: the task or the payload is none.
        """
        self.apply, self.params, self.memory = apply, params, memory
        self.payload, self.task = as_payload(payload), usable_task(task)

    def for_world(self, config: SwarmConfig, robot: Robots, n_robots: int) -> "Policy":
        """Return the policy of robots in this configuration."""
        del n_robots
        return Policy(
            params=self.params,
            dust_range=config.strategy.dust_range,
            apply=self.apply,
            initial=self.memory,
            payload=self.payload,
            config=config.static,
            robot=robot,
            task=self.task,
        )


@dataclass(frozen=True)
class Policy(Strategy):
    """The `Strategy` of a policy; see `PolicyStrategy` for what its fields are."""

    params: Any
    dust_range: float
    """Range of the sense of dust in this world [rd]."""
    apply: Callable[..., Any] = field(metadata={"static": True})
    initial: Callable[[int], Any] | None = field(metadata={"static": True})
    payload: Payload
    config: StaticConfig = field(metadata={"static": True})
    robot: Robots = field(metadata={"static": True})
    task: Any = field(metadata={"static": True})

    def init(self, n_robots: int, key: Array) -> dict[str, Any]:
        """Return the policy's memory, and what robots say before their first action."""
        own = () if self.initial is None else self.initial(n_robots)
        return {"own": own, "said": tables.silence(self.payload, n_robots), "picks": jnp.ones(n_robots, bool)}

    def say(self, memory: dict[str, Any], is_loaded: Bool[Array, "N"]) -> dict[str, Any]:
        """Return what the last action said."""
        return memory["said"]

    def picks(self, memory: dict[str, Any]) -> Bool[Array, "N"]:
        """All robots pick up balls."""
        return memory["picks"]

    def act(self, memory: dict[str, Any], observation: Observation, key: Array) -> tuple[dict[str, Any], Command]:
        """Return what the policy does, and remember what it says; an action that is not finite is a fault."""
        sizes = {name: int(np.prod(value.shape[1:], dtype=int)) for name, value in observation.sensed.items()}
        senses = {name: (self.task.senses[name], size) for name, size in sizes.items()}
        rows = tables.observation_rows(self.config, self.robot, self.payload, senses, dust_range=self.dust_range)
        obs = tables.encode(rows, observation)
        found = self.apply(self.params, obs, *([] if self.initial is None else [memory["own"]]))
        action, own = (found, ()) if self.initial is None else found
        table = tables.action_rows(self.config, self.payload)
        shape = len(obs), sum(row.size for row in table)
        if jnp.shape(action) != shape:
            got = jnp.shape(action)
            raise UserError(f"a policy must return actions {shape}, of robots and their numbers (got {got})")
        command, said, is_bad = tables.decode(table, action)
        command = Command(*(jnp.where(is_bad, jnp.nan, part) for part in command))
        return memory | {"own": own, "said": said}, command
