"""Policies learned on an environment, as strategies that runs, recordings and comparisons take."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.envs import tables
from iswarm_mj.envs.make import as_payload
from iswarm_mj.envs.tables import Row
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.strategy.base import Strategy, StrategyFactory
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.tasks.validation import usable_task
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError

_STATIC = {"static": True}


class PolicyStrategy(StrategyFactory):
    """Strategy of robots that act by a policy, as in `make_env` with the same task and payload.

    Each robot's observation is a row of `Env.observations`, and the policy's output a row of
    `Env.actions`.
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
            apply: pure JAX function of the weights and the observations (N, D) that returns actions
                (N, A) from -1 to 1. A policy with memory takes that as a third argument, and
                returns actions and the next memory.
            params: weights, a pytree of arrays.
            payload: payload of the environment, see `make_env`.
            task: task of the environment; it names what robots sense beside balls and dump.
            memory: returns the first memory of N robots, a pytree of arrays with the robots as
                first axis.

        Raises:
            UserError: the task or the payload is none.
        """
        self.apply = apply
        self.params = params
        self.memory = memory
        self.payload = as_payload(payload)
        self.task = usable_task(task)

    def for_world(self, config: SwarmConfig, robot: Robots, n_robots: int) -> "Policy":
        """Return the policy of robots in this configuration; it is the same for any number."""
        del n_robots
        return Policy(
            params=self.params,
            # Worlds may differ in it, so that `config.static` does not have it.
            dust_range=config.strategy.dust_range,
            apply=self.apply,
            initial_memory=self.memory,
            payload=self.payload,
            config=config.static,
            robot=robot,
            task=self.task,
        )


@dataclass(frozen=True)
class Policy(Strategy):
    """Policy of the robots of a world; see `PolicyStrategy` for fields without a docstring."""

    params: Any
    dust_range: float
    """Range of the sense of dust in this world [rd]."""
    apply: Callable[..., Any] = field(metadata=_STATIC)
    initial_memory: Callable[[int], Any] | None = field(metadata=_STATIC)
    """Function that returns the first memory of N robots, `memory` of `PolicyStrategy`."""
    payload: Payload
    config: StaticConfig = field(metadata=_STATIC)
    """Settings that all worlds share."""
    robot: Robots = field(metadata=_STATIC)
    task: Any = field(metadata=_STATIC)

    def init(self, n_robots: int, key: Array) -> dict[str, Any]:
        """Return the policy's memory, and what robots say before their first action."""
        return {
            "own": () if self.initial_memory is None else self.initial_memory(n_robots),
            "said": tables.silence(self.payload, n_robots),
            "picks": jnp.ones(n_robots, bool),
        }

    def say(self, memory: dict[str, Any], is_loaded: Bool[Array, "N"]) -> dict[str, Any]:
        """Return the messages of the last action."""
        return memory["said"]

    def picks(self, memory: dict[str, Any]) -> Bool[Array, "N"]:
        """Return that all robots pick up balls."""
        return memory["picks"]

    def act(
        self, memory: dict[str, Any], observation: Observation, key: Array
    ) -> tuple[dict[str, Any], Command]:
        """Return the policy's commands, and remember its messages.

        An action that is not finite is a fault.
        """
        obs = tables.encode_observation(self._observation_rows(observation), observation)
        action_rows = tables.action_rows(self.config, self.payload)
        action, policy_memory = self._apply(obs, memory["own"])
        _check_shape(action, len(obs), action_rows)

        command, payload, is_bad = tables.decode_action(action_rows, action)
        command = Command(
            turn=jnp.where(is_bad, jnp.nan, command.turn),
            forward=jnp.where(is_bad, jnp.nan, command.forward),
        )
        return memory | {"own": policy_memory, "said": payload}, command

    def _observation_rows(self, observation: Observation) -> list[Row]:
        """Return the rows of an observation, with what its task lets robots sense."""
        senses = {}
        for name, values in observation.sensed.items():
            size = int(np.prod(values.shape[1:], dtype=int))
            senses[name] = (self.task.senses[name], size)
        return tables.observation_rows(
            self.config, self.robot, self.payload, senses, dust_range=self.dust_range
        )

    def _apply(self, obs: Float[Array, "N D"], memory: Any) -> tuple[Any, Any]:
        """Return the actions and the next memory of the policy."""
        if self.initial_memory is None:
            return self.apply(self.params, obs), ()
        return self.apply(self.params, obs, memory)


def _check_shape(action: Any, n_robots: int, rows: list[Row]) -> None:
    """Raise a UserError unless a policy's actions are (N, A)."""
    shape = (n_robots, sum(row.size for row in rows))
    if jnp.shape(action) != shape:
        raise UserError(
            f"a policy must return actions {shape}, of robots and their numbers "
            f"(got {jnp.shape(action)})"
        )
