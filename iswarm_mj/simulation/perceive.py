"""Perception of one world in pure JAX: robots communicate, and the task advances."""

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
from iswarm_mj.sensors.message_time import draw_first_slots, sides_on, understood_links
from iswarm_mj.simulation import power
from iswarm_mj.simulation.state import SwarmState, WorldParams
from iswarm_mj.simulation.streams import StepKeys
from iswarm_mj.strategy.attributes import payload_of
from iswarm_mj.strategy.interface import Observation
from iswarm_mj.strategy.teams import team_numbers
from iswarm_mj.tasks.base import Sensed, TaskInputs
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.rng import draw


class StepInputs(NamedTuple):
    """Bodies, light and time of a world as its control step begins."""

    poses: Float[Array, "*B N 3"]
    """Poses of the robots: x, y [mm] and yaw [rad]."""
    sight: LightReading
    """Light that the robots receive."""
    step: Int[Array, ""]
    """Number of the control step, from 0."""
    is_running: Bool[Array, "*B"]
    """Worlds that take this step."""
    boxes: Float[Array, "*B M 3"] | None = None
    """Poses of the boxes: x, y [mm] and yaw [rad]; None where there are none."""


class HeldOutputs(NamedTuple):
    """Outputs of N robots that hold from the previous step: messages and tools."""

    payload: dict[str, Any]
    """Content of each robot's message, by the names of its fields."""
    picks: Bool[Array, "N"]
    """Robots that pick up what their tools reach."""
    releases: Bool[Array, "N"] | None = None
    """Robots that release what they hold wherever they are; None: over the dump alone."""


class Perceived(NamedTuple):
    """Perception of N robots as a control step begins, after they communicated and gripped."""

    observation: Observation
    """All that the robots may know."""
    swarm: SwarmState
    """State with task advanced and capacitors charged; the memory is that of the previous step."""
    sensed: Sensed
    """Quantities that the task let the robots sense."""
    task_inputs: TaskInputs
    """Inputs of the task."""
    links: Links
    """Sender whose message each side (N, S) receives unless noise spoils it."""
    received: Received
    """Messages that the sides received; `message` is None, since the observation has it."""
    transmit: Callable[[dict[str, Any]], Received]
    """Sends other messages over the same links with the same noise, as sequential updates need."""


def perceive(
    config: StaticConfig,
    robot: Robots,
    params: WorldParams,
    swarm: SwarmState,
    inputs: StepInputs,
    outputs: HeldOutputs,
    keys: StepKeys,
) -> Perceived:
    """Take a world's control step up to what robots know: communicate, and advance the task.

    Args:
        config: settings that control steps are compiled for (`shared_settings.static_config`).
        robot: geometry of the robots.
        params: parameters of the world, with the conditions of this step (`with_conditions`).
        swarm: state after the previous step.
        inputs: bodies, light and time, without a leading axis.
        outputs: messages and tools, as the robots left them in the previous step.
        keys: random keys of the step.
    """
    # Communicate: the previous step's messages go through the noisy channel.
    sight = _receivable(config, robot, inputs, keys.slots)
    payload = payload_of(params.strategy)

    def transmit(content: dict[str, Any]) -> Received:
        return exchange(params.conditions, payload, content, sight.links, keys.channel)

    received = transmit(outputs.payload)

    # Charge: robots whose capacitors are empty wait for light.
    swarm, supply = _charge(config, swarm, len(inputs.poses))

    # Advance the task: balls are carried, released and picked up.
    (stop_draw,), (sensing_draw,) = draw(keys.stops, (len(inputs.poses),), n_uniform=1).uniform
    notices = sensing_draw >= params.conditions.error_in_sensing
    task_inputs = _task_inputs(config, robot, params, swarm, inputs, outputs, supply, notices)
    swarm, sensed = _advance_task(params, swarm, task_inputs, inputs.step, keys.task)

    # Sense: this is all that robots may know.
    stops_to_emit = stop_draw < params.conditions.stop_share
    waits = supply.is_empty | sensed.is_busy | stops_to_emit
    return Perceived(
        observation=_observation(sight, received, sensed, waits),
        swarm=swarm,
        sensed=sensed,
        task_inputs=task_inputs,
        links=sight.links,
        received=received._replace(message=None),
        transmit=transmit,
    )


def with_conditions(params: WorldParams, swarm: SwarmState) -> WorldParams:
    """Return the parameters of a world with the conditions that its task gives this step."""
    conditions = params.task.conditions(swarm.task, params.conditions)
    return params._replace(conditions=conditions)


def decider_of(config: StaticConfig) -> Decider:
    """Return the function that decides attempts at balls: a force balance, or trials."""
    if config.gripper.resolution == "quasi-static":
        return by_balance
    # Imported here, since the bench is large and other runs need not load it.
    if config.gripper.bench == "mjx":
        from iswarm_mj.gripper.bench.batch_trials import by_batch

        return by_batch
    from iswarm_mj.gripper.bench.swarm_trials import by_host

    return by_host


class _Supply(NamedTuple):
    """Voltage of the robots' capacitors as a step begins."""

    voltage: Float[Array, "N"] | None
    """Voltage [V]; None where robots have no capacitors."""
    is_empty: Bool[Array, "N"]
    """Robots without the energy of one control step; they wait."""


def _receivable(
    config: StaticConfig, robot: Robots, inputs: StepInputs, key: Array
) -> LightReading:
    """Return the light that sides can use; where messages take time, they miss some."""
    sight = inputs.sight
    optics = config.optics
    if not optics.baud_rate:
        return sight
    first_slot = draw_first_slots(optics, key, len(inputs.poses))
    links = understood_links(optics, sight.links, first_slot, robot.sides)
    return LightReading(links, sight.sees_wall & sides_on(optics, robot.sides))


def _charge(config: StaticConfig, swarm: SwarmState, n_robots: int) -> tuple[SwarmState, _Supply]:
    """Return the state with capacitors, if any, charged by light, and what they supply."""
    if swarm.energy is None or swarm.steps_without_energy is None:
        return swarm, _Supply(voltage=None, is_empty=jnp.zeros(n_robots, bool))
    energy = power.charged(config, swarm.energy)
    voltage = power.voltage(config.energy, energy)
    is_empty = ~power.can_act(config, energy)
    steps_without_energy = swarm.steps_without_energy + (is_empty & swarm.is_alive)
    charged = swarm._replace(energy=energy, steps_without_energy=steps_without_energy)
    return charged, _Supply(voltage, is_empty)


def _task_inputs(
    config: StaticConfig,
    robot: Robots,
    params: WorldParams,
    swarm: SwarmState,
    inputs: StepInputs,
    outputs: HeldOutputs,
    supply: _Supply,
    notices: Bool[Array, "N"],
) -> TaskInputs:
    """Return the world as its task sees it; robots without energy neither pick up nor release."""
    n_robots = len(inputs.poses)
    releases = outputs.releases
    if releases is not None:
        releases = releases & swarm.is_alive & ~supply.is_empty
    return TaskInputs(
        poses=inputs.poses,
        is_present=params.is_present,
        is_alive=swarm.is_alive,
        picks=outputs.picks & ~supply.is_empty,
        team=jnp.asarray(team_numbers(params.strategy, n_robots)),
        kind=jnp.asarray(robot.kind_of(n_robots), jnp.int32),
        conditions=params.conditions,
        arena=params.arena,
        config=config,
        robot=robot,
        decide_attempts=decider_of(config),
        voltage=supply.voltage,
        releases=releases,
        notices=notices,
        boxes=jnp.zeros((0, 3)) if inputs.boxes is None else inputs.boxes,
    )


def _advance_task(
    params: WorldParams,
    swarm: SwarmState,
    task_inputs: TaskInputs,
    step: Int[Array, ""],
    key: Array,
) -> tuple[SwarmState, Sensed]:
    """Return the state with the task advanced, and what robots sense; they may die or fail."""
    task, sensed = params.task.advance(swarm.task, task_inputs, key)
    is_alive = swarm.is_alive
    survives = params.task.survives(task)
    if survives is not None:
        is_alive = is_alive & survives
    if params.fails_at is not None:
        is_alive = is_alive & (params.fails_at != step)
    return swarm._replace(task=task, is_loaded=sensed.is_loaded, is_alive=is_alive), sensed


def _observation(
    sight: LightReading, received: Received, sensed: Sensed, waits: Bool[Array, "N"]
) -> Observation:
    """Return what robots hear, see and sense."""
    message = received.message
    return Observation(
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
        waits=waits,
    )
