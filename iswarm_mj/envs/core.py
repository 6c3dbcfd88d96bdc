"""A step of an environment in one world, before and after the engine moves: pure JAX.

An environment takes its steps half a control step later than a run: robots that have perceived act, move, and perceive
anew. The same worlds do the same in both.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.base import Motion, Sight
from iswarm_mj.envs import actions, observations
from iswarm_mj.envs.observations import Row
from iswarm_mj.envs.state import Episode, State
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.simulation import power
from iswarm_mj.simulation.decide import ACTUATORS_STREAM, Decision, Perceived, Situation, executed, perceive, takes_time
from iswarm_mj.simulation.state import Fault, SwarmState, WorldParams, WorldState
from iswarm_mj.simulation.step import account, limited
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.threefry import unrolled
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.robot import Robot


@jax.tree_util.register_static
@dataclass(frozen=True)
class Speaker:
    """In place of a strategy: what the messages of robots carry that are told what to say."""

    payload: Payload


class Beginnings(NamedTuple):
    """How episodes begin, one of K."""

    poses: Float[Array, "K N 3"]
    """x, y [mm] and yaw [rad]."""
    swarm: SwarmState
    """(K, ...)"""


class Plan(NamedTuple):
    """What robots are to do in a step."""

    command: Command
    said: dict[str, Any]
    refused: Bool[Array, "*B N"]
    """Robots whose actions are not finite."""
    is_running: Bool[Array, "*B"]
    """The world moves."""
    energy: Any
    """What is left in the capacitors (*B, N) [J]; None where there are none."""
    poses: Float[Array, "*B N 3"]
    """Where robots begin the next episode."""
    swarm: SwarmState
    """And how."""
    key: Array
    next_key: Array


@dataclass(frozen=True)
class Core:
    """An environment but for its engine.

    Attributes:
        config: what worlds of one run have in common.
        robot: its geometry.
        params: of all worlds, but for their keys.
        beginnings: of episodes.
        steps: of an episode at most.
        payload: what messages carry.
        observations: see `observations.rows`.
        actions: see `actions.rows`.
    """

    config: SwarmConfig
    robot: Robot
    params: WorldParams
    beginnings: Beginnings
    steps: int
    payload: Payload
    observations: list[Row]
    actions: list[Row]

    def ended(self, key: Array) -> tuple[Episode, Bool[Array, ""]]:
        """Return an episode that is over, and after which one of this key begins; and that it is over."""
        n = self.beginnings.poses.shape[1]
        swarm = jax.tree.map(lambda a: a[0], self.beginnings.swarm)
        zero, no = jnp.int32(0), jnp.zeros((), bool)
        fault = Fault(zero, zero, zero)
        world = WorldState(None, swarm, jnp.zeros((n, n), bool), zero, no, zero, zero, fault)
        waits = jnp.zeros(n, bool) if takes_time(self.config) else None
        return Episode(world, key, key, zero, swarm.balls, waits), jnp.ones((), bool)

    def prepare(self, data: Episode, done: Bool[Array, ""], action: Float[Array, "N A"]) -> Plan:
        """Return what robots are to do, and how the next episode begins."""
        decoded = actions.decode(self.config, self.payload, action)
        command, said, is_bad = jax.lax.optimization_barrier(decoded)  # rounded as a strategy's
        step_key = jax.random.fold_in(unrolled(data.key), data.step)
        command = executed(self.config, self.params.conditions, command, jax.random.fold_in(step_key, ACTUATORS_STREAM))
        command, refused = limited(self.config, command)
        swarm = data.world.swarm
        acts = swarm.is_alive if data.waits is None else swarm.is_alive & ~data.waits
        command = Command(*(jnp.where(acts, part, 0.0) for part in command))
        refused = (refused | is_bad) & ~done
        energy = swarm.energy
        if energy is not None:
            balls, conditions = (data.before, swarm.balls), self.params.conditions
            energy = power.after(self.config, energy, command, balls, conditions, swarm.is_alive)
        start_key, key, next_key = jax.random.split(data.next_key, 3)
        index = jax.random.randint(start_key, (), 0, len(self.beginnings.poses))
        poses, swarm = jax.tree.map(lambda a: a[index], self.beginnings)
        return Plan(command, said, refused, ~done & ~refused.any(), energy, poses, swarm, key, next_key)

    def talks(self, done: Bool[Array, "*B"], plan: Plan) -> Bool[Array, "*B N"]:
        """Robots that light their LEDs after a step, or as the next episode begins."""
        energy = plan.energy if plan.energy is None else jnp.where(done[..., None], plan.swarm.energy, plan.energy)
        return power.talks(self.config, plan.swarm.is_alive, energy)

    def finish(
        self,
        data: Episode,
        done: Bool[Array, ""],
        plan: Plan,
        motion: Motion,
        poses: Float[Array, "N 3"],
        sight: Sight,
    ) -> State:
        """Return the state after a step, but for its bodies.

        Args:
            data: before.
            done: the episode was over, and a new one begins.
            plan: of the step.
            motion: of the robots, without bodies.
            poses: after it, or at the beginning.
            sight: what they then receive.
        """
        choose = partial(jax.tree.map, lambda new, old: jnp.where(done, new, old))
        swarm = choose(plan.swarm, data.world.swarm._replace(energy=plan.energy))
        said = choose(actions.silence(self.payload, len(poses)), plan.said)
        key, next_key = choose((plan.key, plan.next_key), (data.key, data.next_key))
        step = jnp.where(done, 0, data.step + 1)
        params = self.params._replace(key=key)
        situation = Situation(poses, sight, step, jnp.ones((), bool))
        seen = perceive(self.config, self.robot, params, swarm, situation, said, swarm.is_alive)
        after = SwarmState(None, seen.things.balls, swarm.is_alive, seen.things.own, seen.energy, seen.starved)
        progress = params.task.progress(seen.things)
        decision = Decision(after, plan.command, plan.refused, seen.links, seen.spoken, progress)
        ran = Situation(poses, sight, data.step, ~done)
        zero, no = jnp.int32(0), jnp.zeros((), bool)
        fault = Fault(zero, zero, zero)
        fresh = WorldState(None, after, jnp.zeros_like(motion.touching), zero, no, zero, progress, fault)
        went_on = account(params, data.world, decision, motion, plan.refused, ran)
        world, waits = choose(fresh, went_on), seen.observation.waits
        episode = Episode(world, key, next_key, step, swarm.balls, waits)
        return self._state(episode, seen, swarm, params, done)

    def _state(self, data: Episode, seen: Perceived, swarm: SwarmState, params: WorldParams, is_new: Array) -> State:
        world, task = data.world, params.task
        is_faulty, truncated = world.fault.bits != 0, data.step >= self.steps
        reward = task.reward(swarm.things, seen.things, seen.around)
        own = {name: jnp.asarray(value) for name, value in task.metrics(seen.things).items()}
        return State(
            data=data,
            obs=observations.encode(self.observations, self.payload, seen.observation),
            reward=jnp.where(is_new | is_faulty, 0.0, reward),
            done=world.is_finished | is_faulty | truncated,
            metrics=own | {"progress": world.progress, "collisions": world.collisions},
            info={
                "step": data.step,
                "is_finished": world.is_finished,
                "truncated": truncated & ~world.is_finished & ~is_faulty,
                "fault": world.fault.bits,
            },
        )
