"""The first half of a control step: robots communicate, and the task advances. Pure JAX, of one world."""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.engines.base import LightReading
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.gripper.attempts import Decider, by_balance
from iswarm_mj.sensors.channel import Received, exchange
from iswarm_mj.sensors.links import Links
from iswarm_mj.sensors.message_time import draw_first_slots, sides_on, understood
from iswarm_mj.simulation import power
from iswarm_mj.simulation.state import SwarmState, WorldParams
from iswarm_mj.simulation.streams import StepKeys
from iswarm_mj.strategy.declared import payload_of
from iswarm_mj.strategy.interface import Observation
from iswarm_mj.strategy.teams import team_numbers
from iswarm_mj.tasks.base import Sensed, TaskInputs
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.rng import draw


class StepInputs(NamedTuple):
    """What a world's control step begins with, beside its state."""

    poses: Float[Array, "*B N 3"]
    """x, y [mm] and yaw [rad]."""
    sight: LightReading
    """Light that the robots receive."""
    step: Int[Array, ""]
    """Number of the control step, from 0."""
    is_running: Bool[Array, "*B"]
    """Whether the world takes this step."""
    boxes: Float[Array, "*B M 3"] | None = None
    """x, y [mm] and yaw [rad] of the boxes; None where there are none."""


class Perceived(NamedTuple):
    """What N robots of a world perceive as a control step begins, after what they said and gripped."""

    observation: Observation
    swarm: SwarmState
    """With the task advanced and the capacitors charged; the memory is that of the step before."""
    sensed: Sensed
    """What the task let the robots sense."""
    inputs: TaskInputs
    """What the task found."""
    links: Links
    """Of each side (N, S), the sender whose message it receives unless noise spoils it."""
    received: Received
    """Its message is None, since the observation has it."""
    transmit: Callable[[dict[str, Any]], Received]
    """Messages as received, with the same noise at whatever time within this step they are sent."""


def perceive(
    config: StaticConfig,
    robot: Robots,
    params: WorldParams,
    swarm: SwarmState,
    begin: StepInputs,
    keys: StepKeys,
    payload: dict[str, Any],
    picks: Bool[Array, "N"],
    releases: Bool[Array, "N"] | None = None,
) -> Perceived:
    """Take a world's control step up to what robots know: communicate, and advance the task.

    Args:
        config: what control steps are compiled for (`shared_settings.static_config`).
        robot: its geometry.
        params: of the world.
        swarm: after the step before.
        begin: poses, light and time, without a leading axis.
        keys: of the step.
        payload: what each robot says.
        picks: which robots pick up what their tools reach.
        releases: which robots release what they hold wherever they are; None: over the dump alone.
    """
    poses, sight, *_ = begin
    if config.optics.baud_rate:
        first_slot = draw_first_slots(config.optics, keys.slots, len(poses))
        links = understood(config.optics, sight.links, first_slot, robot.sides)
        sight = LightReading(links, sight.sees_wall & sides_on(config.optics, robot.sides))
    declared = payload_of(params.strategy)

    def transmit(payload: dict[str, Any]) -> Received:
        return exchange(params.conditions, declared, payload, sight.links, keys.channel)

    received = transmit(payload)
    voltage, is_empty = None, jnp.zeros(len(poses), bool)
    if swarm.energy is not None and swarm.steps_without_energy is not None:
        energy = power.charged(config, swarm.energy)
        voltage, is_empty = power.voltage(config.energy, energy), ~power.can_act(config, energy)
        swarm = swarm._replace(
            energy=energy, steps_without_energy=swarm.steps_without_energy + (is_empty & swarm.is_alive)
        )
    (stop,), (misses,) = draw(keys.stops, (len(poses),), n_uniform=1).uniform
    inputs = TaskInputs(
        poses=poses,
        is_present=params.is_present,
        is_alive=swarm.is_alive,
        picks=picks & ~is_empty,
        team=jnp.asarray(team_numbers(params.strategy, len(poses))),
        kind=jnp.asarray(robot.kind_of(len(poses)), jnp.int32),
        conditions=params.conditions,
        arena=params.arena,
        config=config,
        robot=robot,
        decide_attempts=decider_of(config),
        voltage=voltage,
        releases=None if releases is None else releases & swarm.is_alive & ~is_empty,
        notices=misses >= params.conditions.error_in_sensing,
        boxes=jnp.zeros((0, 3)) if begin.boxes is None else begin.boxes,
    )
    task, sensed = params.task.advance(swarm.task, inputs, keys.task)
    survives = params.task.survives(task)
    is_alive = swarm.is_alive if survives is None else swarm.is_alive & survives
    swarm = swarm._replace(task=task, is_loaded=sensed.is_loaded, is_alive=is_alive)
    message = received.message
    observation = Observation(
        is_heard=received.is_heard,
        bearing=sight.links.measured_bearing,
        distance=received.distance,
        led=message.led,
        payload=message.payload,
        sees_wall=sight.sees_wall,
        at_dust=sensed.at_dust,
        ball_vector=sensed.ball_vector,
        on_dump=sensed.on_dump,
        is_loaded=sensed.is_loaded,
        grasp_failed=sensed.grasp_failed,
        sensed=sensed.own,
        waits=is_empty | sensed.is_busy | (stop < params.conditions.stop_share),
    )
    return Perceived(observation, swarm, sensed, inputs, sight.links, received._replace(message=None), transmit)


def with_conditions(params: WorldParams, swarm: SwarmState) -> WorldParams:
    """Return the parameters of a world with the conditions of this step, which its task may change."""
    return params._replace(conditions=params.task.conditions(swarm.task, params.conditions))


def decider_of(config: StaticConfig) -> Decider:
    """Return what decides whether attempts to pick up and to release succeed: the forces' balance, or the bench."""
    if config.gripper.resolution == "quasi-static":
        return by_balance
    # Here, since the bench is a large part of the package that other runs need not load.
    if config.gripper.bench == "mjx":
        from iswarm_mj.gripper.bench.batch_trials import by_batch

        return by_batch
    from iswarm_mj.gripper.bench.swarm_trials import by_host

    return by_host
