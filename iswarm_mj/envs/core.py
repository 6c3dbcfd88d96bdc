"""Environments without their engine, as pure JAX functions of one world.

It begins episodes, carries out actions, and computes observations and rewards. A step of an
environment is half a control step later than one of a run: robots that have perceived act, move,
and perceive again. The stages are those of `simulation.step.control_step`, so that the same worlds
do the same in both.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.base import LightReading, Motion
from iswarm_mj.envs import tables
from iswarm_mj.envs.tables import Row
from iswarm_mj.geometry.robot import RobotFile, Robots
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.sensors.messages import Payload
from iswarm_mj.simulation.actuate import DriveInputs, DriveOutput, actuate
from iswarm_mj.simulation.perceive import (
    HeldOutputs,
    Perceived,
    StepInputs,
    perceive,
    with_conditions,
)
from iswarm_mj.simulation.power import is_emitting
from iswarm_mj.simulation.state import SwarmState, WorldParams, WorldState
from iswarm_mj.simulation.step import account_for_motion, account_for_task
from iswarm_mj.simulation.streams import step_keys
from iswarm_mj.strategy.base import overrides
from iswarm_mj.tasks.base import Quantity, Task
from iswarm_mj.utils.arrays import Array


class Episode(NamedTuple):
    """State of a world in an episode; robots do not know it."""

    world: WorldState
    """State of the world."""
    key: Array
    """Random key of the world's noise."""
    next_key: Array
    """Random key of the next episode."""
    step: Int[Array, "*B"]
    """Number of control steps taken."""
    waits: Bool[Array, "*B N"]
    """Robots that stay where they are in the next step, see `Observation.waits`."""
    tool_voltage_squared: Float[Array, "*B N"]
    """Sum of V^2 over each robot's attempts in the next step, see `tasks.base.Sensed` [V^2]."""
    conditions: Conditions | None
    """Conditions of the step that the robots have begun to perceive.

    None where the task changes none (`Task.conditions`)."""


class State(NamedTuple):
    """State of an environment with N robots; B worlds are a leading axis of all arrays."""

    data: Episode
    """State of the world, which robots do not know."""
    obs: Float[Array, "*B N D"]
    """Observation of each robot, see `Env.observations`."""
    reward: Float[Array, "*B N"]
    """Reward of each robot for the last step, from its task."""
    done: Bool[Array, "*B"]
    """Worlds whose episode has ended: the goal is reached, the time is up, or there is a fault.

    The next `step` begins a new one, whatever the action."""
    metrics: dict[str, Array]
    """Metrics and `progress` of the task, and `collisions` so far."""
    info: dict[str, Any]
    """More about the step, by name.

    `step` of the episode; `is_finished`, the goal is reached; `truncated`, the time is up; `fault`,
    bits of `FaultKind`, 0 for no fault."""


class Intent(NamedTuple):
    """Outcome of the actions of a step, before the motion."""

    drive: DriveOutput
    """Motion that the drives carry out; actions that are not finite are refused, too."""
    payload: dict[str, Any]
    """Content of the robots' messages."""
    is_running: Bool[Array, "*B"]
    """Worlds that move."""
    is_emitting: Bool[Array, "*B N"]
    """Robots that light their LEDs after the step."""
    box_targets: Float[Array, "*B M 3"] | None
    """Poses to which the task drives boxes; None where it drives none."""


class Seen(NamedTuple):
    """Bodies and light of a world after the motion, as its engine reports them."""

    poses: Float[Array, "*B N 3"]
    """Poses of the robots: x, y [mm] and yaw [rad]."""
    boxes: Float[Array, "*B M 3"] | None
    """Poses of the boxes; None where there are none."""
    sight: LightReading
    """Light that the robots receive."""


@jax.tree_util.register_static
@dataclass(frozen=True)
class Speaker:
    """Stand-in for a strategy, whose only part that a control step reads is the payload."""

    payload: Payload


_ARRAYS = ("params", "poses", "worlds")
_STATIC = (
    "static_config",
    "config",
    "robot",
    "robot_file",
    "steps",
    "payload",
    "senses",
)


@partial(jax.tree_util.register_dataclass, data_fields=_ARRAYS, meta_fields=_STATIC)
@dataclass(frozen=True)
class Core:
    """The part of an environment that does not depend on the engine.

    It is a pytree of the arrays in which environments of the same programs may differ.

    Attributes:
        static_config: settings that control steps are compiled for.
        config: configuration.
        robot: geometry of the robots.
        robot_file: MJCF file of the robots, as an absolute path, or several; None for
            `models/robot.xml`.
        params: parameters of all worlds; each episode has a key of its own.
        poses: (K, N + M, 3) x, y [mm] and yaw [rad] of robots and boxes in K layouts.
        worlds: state of a world in each of them, without bodies.
        steps: largest number of control steps of an episode.
        payload: fields of the messages.
        senses: quantities that robots sense beside balls and dump, by name, and how many numbers
            each has.
    """

    static_config: StaticConfig
    config: SwarmConfig
    robot: Robots
    robot_file: RobotFile
    params: WorldParams
    poses: Float[Array, "K NM 3"]
    worlds: WorldState
    steps: int
    payload: Payload
    senses: tuple[tuple[str, tuple[Quantity, int]], ...]

    @property
    def observations(self) -> list[Row]:
        """Rows of an observation, see `tables.observation_rows`."""
        return tables.observation_rows(self.config, self.robot, self.payload, dict(self.senses))

    @property
    def actions(self) -> list[Row]:
        """Rows of an action, see `tables.action_rows`."""
        return tables.action_rows(self.config, self.payload)

    @property
    def n_robots(self) -> int:
        """Number of robots N."""
        return self.params.is_present.shape[-1]

    def begin(self, key: Array) -> tuple[Episode, Float[Array, "NM 3"]]:
        """Return a new episode in a layout picked by the key, and poses of its robots and boxes."""
        layout_key, key, next_key = jax.random.split(key, 3)
        layout = jax.random.randint(layout_key, (), 0, len(self.poses))
        poses, world = jax.tree.map(lambda a: a[layout], (self.poses, self.worlds))

        conditions = None
        if overrides(self.params.task, Task, "conditions"):
            conditions = self.params.conditions
        episode = Episode(
            world=world,
            key=key,
            next_key=next_key,
            step=jnp.int32(0),
            waits=jnp.zeros(self.n_robots, bool),
            tool_voltage_squared=jnp.zeros(self.n_robots),
            conditions=conditions,
        )
        return episode, poses

    def auto_reset(
        self, episode: Episode, is_new: Bool[Array, ""]
    ) -> tuple[Episode, Float[Array, "NM 3"]]:
        """Return the episode, or a new one if it is over, and the poses of the new one."""
        new_episode, poses = self.begin(episode.next_key)
        return jax.tree.map(partial(jnp.where, is_new), new_episode, episode), poses

    def act(
        self,
        episode: Episode,
        is_new: Bool[Array, ""],
        action: Float[Array, "N A"],
        poses: Float[Array, "N 3"],
    ) -> Intent:
        """Return the outcome of the robots' actions; in an episode that begins they have none.

        Args:
            episode: state of the world.
            is_new: the episode begins with this step.
            action: actions of the robots (`tables.action_rows`).
            poses: poses of the robots.
        """
        # A barrier, so that XLA rounds commands as it does those of a strategy.
        decoded = jax.lax.optimization_barrier(tables.decode_action(self.actions, action))
        command, payload, is_bad = decoded

        swarm = episode.world.swarm
        inputs = DriveInputs(
            swarm=swarm,
            waits=episode.waits,
            poses=poses,
            is_present=self.params.is_present,
            tool_voltage_squared=episode.tool_voltage_squared,
        )
        conditions = self.params.conditions
        if episode.conditions is not None:
            conditions = episode.conditions
        key = step_keys(episode.key, episode.step).actuators
        drive = actuate(self.static_config, conditions, command, inputs, key)

        # An episode that begins has neither said anything nor used energy.
        either = partial(jnp.where, is_new)
        payload = jax.tree.map(either, tables.silence(self.payload, len(action)), payload)
        drive = drive._replace(
            is_refused=drive.is_refused | is_bad,
            energy=jax.tree.map(either, swarm.energy, drive.energy),
        )
        return Intent(
            drive=drive,
            payload=payload,
            is_running=~is_new & ~drive.is_refused.any(),
            is_emitting=is_emitting(self.static_config, swarm.is_alive, drive.energy),
            box_targets=self.params.task.drive_boxes(swarm.task),
        )

    def observe(
        self,
        episode: Episode,
        is_new: Bool[Array, ""],
        intent: Intent,
        motion: Motion,
        seen: Seen,
    ) -> State:
        """Return the state after a step, without its bodies.

        Args:
            episode: state of the world before the step.
            is_new: the episode begins with this step, and nothing has moved.
            intent: outcome of the actions.
            motion: motion of the robots.
            seen: bodies and light after the motion.
        """
        has_run = ~is_new
        step_taken = episode.step
        step = step_taken + has_run.astype(jnp.int32)
        swarm = episode.world.swarm._replace(energy=intent.drive.energy)

        # Account for the motion, then perceive: messages arrive, and the task advances.
        motion = motion._replace(bodies=None, touching=motion.touching * has_run)
        world = account_for_motion(episode.world, motion, intent.drive, step_taken, has_run)
        params = with_conditions(self.params._replace(key=episode.key), swarm)
        perceived = self._perceive(params, swarm, intent, seen, step)

        progress = params.task.progress(perceived.swarm.task)
        world = world._replace(swarm=perceived.swarm)
        world = account_for_task(params, world, progress, step_taken, has_run)

        is_faulty = world.fault.bits != 0
        is_late = step >= self.steps
        reward = self._reward(params.task, swarm.task, perceived, intent)
        metrics = {
            name: jnp.asarray(value)
            for name, value in params.task.metrics(perceived.swarm.task).items()
        }
        next_episode = Episode(
            world=world,
            key=episode.key,
            next_key=episode.next_key,
            step=step,
            waits=perceived.observation.waits,
            tool_voltage_squared=perceived.sensed.tool_voltage_squared,
            conditions=None if episode.conditions is None else params.conditions,
        )
        return State(
            data=next_episode,
            obs=tables.encode_observation(self.observations, perceived.observation),
            reward=jnp.where(is_new | is_faulty, 0.0, reward),
            done=world.is_finished | is_faulty | is_late,
            metrics=metrics | {"progress": world.progress, "collisions": world.collisions},
            info={
                "step": step,
                "is_finished": world.is_finished,
                "truncated": is_late & ~world.is_finished & ~is_faulty,
                "fault": world.fault.bits,
            },
        )

    def _perceive(
        self,
        params: WorldParams,
        swarm: SwarmState,
        intent: Intent,
        seen: Seen,
        step: Int[Array, ""],
    ) -> Perceived:
        """Return what robots perceive as the next step begins; all that live pick up balls."""
        inputs = StepInputs(
            poses=seen.poses,
            sight=seen.sight,
            step=step,
            is_running=jnp.ones((), bool),
            boxes=seen.boxes,
        )
        outputs = HeldOutputs(payload=intent.payload, picks=swarm.is_alive)
        keys = step_keys(params.key, step)
        return perceive(self.static_config, self.robot, params, swarm, inputs, outputs, keys)

    def _reward(
        self, task: Task, task_before: Any, perceived: Perceived, intent: Intent
    ) -> Float[Array, "N"]:
        """Return each robot's reward for the change of the task, and for what it did and said."""
        task_inputs = perceived.task_inputs._replace(
            command=intent.drive.command, message=perceived.received.bits[:, 0]
        )
        return task.reward(task_before, perceived.swarm.task, task_inputs)
