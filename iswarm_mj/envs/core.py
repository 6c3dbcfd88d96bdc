"""An environment but for its engine: its state, how episodes begin, what robots do and observe. Pure JAX, of one world.

An environment takes its steps half a control step later than a run: robots that have perceived act, move, and perceive
again. The stages are those of `simulation.step.control_step`, so that the same worlds do the same in both.
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
from iswarm_mj.simulation.actuate import DriveOutput, actuate
from iswarm_mj.simulation.perceive import StepInputs, perceive, with_conditions
from iswarm_mj.simulation.power import is_emitting
from iswarm_mj.simulation.state import WorldParams, WorldState
from iswarm_mj.simulation.step import after_motion, after_task
from iswarm_mj.simulation.streams import step_keys
from iswarm_mj.strategy.base import overrides
from iswarm_mj.tasks.base import Quantity, Task
from iswarm_mj.utils.arrays import Array


class Episode(NamedTuple):
    """What goes on in a world; robots do not know it."""

    world: WorldState
    key: Array
    """Random key of the world's noise."""
    next_key: Array
    """That begins the next episode."""
    step: Int[Array, "*B"]
    """Control steps taken."""
    waits: Bool[Array, "*B N"]
    """The robot stays where it is in the next step, see `Observation.waits`."""
    tool_voltage_squared: Float[Array, "*B N"]
    """See `tasks.base.Sensed` [V^2]."""
    conditions: Conditions | None
    """Of the step that the robots have begun to perceive; None where the task changes none (`Task.conditions`)."""


class State(NamedTuple):
    """State of an environment with N robots; of B worlds all arrays have a leading axis of worlds."""

    data: Episode
    obs: Float[Array, "*B N D"]
    """What each robot may know, see `Env.observations`."""
    reward: Float[Array, "*B N"]
    """Of each robot for the last step, by its task."""
    done: Bool[Array, "*B"]
    """The episode has ended: the goal is reached, the time is up, or something went wrong. The next `step` begins a new
    one, whatever the action."""
    metrics: dict[str, Array]
    """Those of the task; `progress` of it; `collisions` so far."""
    info: dict[str, Any]
    """`step` of the episode; `is_finished`, the goal is reached; `truncated`, the time is up; `fault`, bits of
    `FaultKind`, 0 if nothing went wrong."""


class Intent(NamedTuple):
    """What robots do in a step."""

    done: DriveOutput
    """By their drives; actions that were not finite are refused, too."""
    said: dict[str, Any]
    is_running: Bool[Array, "*B"]
    """The world moves."""
    is_emitting: Bool[Array, "*B N"]
    """The robot lights its LEDs after the step."""
    boxes: Float[Array, "*B M 3"] | None
    """See `Decision`."""


@jax.tree_util.register_static
@dataclass(frozen=True)
class Speaker:
    """In place of a strategy: what the messages of robots carry that are told what to say."""

    payload: Payload


_ARRAYS = "params", "poses", "worlds"
_STATIC = "config", "given", "robot", "robot_file", "steps", "payload", "senses"


@partial(jax.tree_util.register_dataclass, data_fields=_ARRAYS, meta_fields=_STATIC)
@dataclass(frozen=True)
class Core:
    """An environment but for its engine: a pytree of the arrays in which environments of the same programs may differ.

    Attributes:
        config: what control steps are compiled for.
        given: the configuration as it was given.
        robot: its geometry.
        robot_file: MJCF file of the robots, as an absolute path, or several; None for `models/robot.xml`.
        params: of all worlds, but for their keys.
        poses: (K, N + M, 3) x, y [mm] and yaw [rad] of robots and boxes in K beginnings of an episode.
        worlds: likewise, states without bodies.
        steps: of an episode at most.
        payload: what messages carry.
        senses: what the task lets robots sense beside balls and dump, by name, and how many numbers of each.
    """

    config: StaticConfig
    given: SwarmConfig
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
        """See `tables.observation_rows`."""
        return tables.observation_rows(self.given, self.robot, self.payload, dict(self.senses))

    @property
    def actions(self) -> list[Row]:
        """See `tables.action_rows`."""
        return tables.action_rows(self.given, self.payload)

    @property
    def n_robots(self) -> int:
        """N."""
        return self.params.is_present.shape[-1]

    def begin(self, key: Array) -> tuple[Episode, Float[Array, "NM 3"]]:
        """Return an episode that begins, and where its robots and boxes stand."""
        start_key, key, next_key = jax.random.split(key, 3)
        index = jax.random.randint(start_key, (), 0, len(self.poses))
        poses, world = jax.tree.map(lambda a: a[index], (self.poses, self.worlds))
        no, zero = jnp.zeros(self.n_robots, bool), jnp.zeros(self.n_robots)
        changes = overrides(self.params.task, Task, "conditions")
        conditions = self.params.conditions if changes else None
        return Episode(world, key, next_key, jnp.int32(0), no, zero, conditions), poses

    def auto_reset(self, data: Episode, is_new: Bool[Array, ""]) -> tuple[Episode, Float[Array, "NM 3"]]:
        """Return the episode, or the next one if it is over, and where robots and boxes of the next one stand."""
        fresh, poses = self.begin(data.next_key)
        return jax.tree.map(partial(jnp.where, is_new), fresh, data), poses

    def act(self, data: Episode, is_new: Bool[Array, ""], action: Float[Array, "N A"], poses: Array) -> Intent:
        """Return what robots at `poses` do; those of an episode that begins do nothing."""
        decoded = tables.decode(self.actions, action)
        command, said, is_bad = jax.lax.optimization_barrier(decoded)  # rounded as a strategy's
        swarm, key = data.world.swarm, step_keys(data.key, data.step).actuators
        conditions = self.params.conditions if data.conditions is None else data.conditions
        is_present, charge = self.params.is_present, data.tool_voltage_squared
        done = actuate(self.config, conditions, command, swarm, data.waits, poses, is_present, charge, key)
        said = jax.tree.map(partial(jnp.where, is_new), tables.silence(self.payload, len(action)), said)
        done = done._replace(
            is_refused=done.is_refused | is_bad,
            energy=jax.tree.map(partial(jnp.where, is_new), swarm.energy, done.energy),
        )
        emits = is_emitting(self.config, swarm.is_alive, done.energy)
        boxes = self.params.task.drive_boxes(swarm.task)
        return Intent(done, said, ~is_new & ~done.is_refused.any(), emits, boxes)

    def observe(
        self,
        data: Episode,
        is_new: Bool[Array, ""],
        intent: Intent,
        motion: Motion,
        poses: Float[Array, "N 3"],
        boxes: Float[Array, "M 3"] | None,
        sight: LightReading,
    ) -> State:
        """Return the state after a step, but for its bodies; poses, boxes and light are those after the motion."""
        ran, before = ~is_new, data.world.swarm._replace(energy=intent.done.energy)
        motion = motion._replace(bodies=None, touching=motion.touching * ran)
        moved = after_motion(data.world, motion, intent.done, data.step, ran)
        step = data.step + ran.astype(jnp.int32)
        params, keys = with_conditions(self.params._replace(key=data.key), before), step_keys(data.key, step)
        inputs = StepInputs(poses, sight, step, jnp.ones((), bool), boxes)
        seen = perceive(self.config, self.robot, params, before, inputs, keys, intent.said, before.is_alive)
        progress = params.task.progress(seen.swarm.task)
        world = after_task(params, moved._replace(swarm=seen.swarm), progress, data.step, ran)
        waits, charge = seen.observation.waits, seen.sensed.tool_voltage_squared
        conditions = None if data.conditions is None else params.conditions
        is_faulty, is_late = world.fault.bits != 0, step >= self.steps
        done = seen.inputs._replace(command=intent.done.command, message=seen.received.bits[:, 0])
        reward = params.task.reward(before.task, seen.swarm.task, done)
        metrics = {name: jnp.asarray(value) for name, value in params.task.metrics(seen.swarm.task).items()}
        return State(
            data=Episode(world, data.key, data.next_key, step, waits, charge, conditions),
            obs=tables.encode(self.observations, seen.observation),
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
