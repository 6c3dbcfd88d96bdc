"""What the robots of one world decide in a control step: communicate, advance the task, observe, act. Pure JAX."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int, UInt32

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.base import Sight
from iswarm_mj.gripper.handling import loaded, working
from iswarm_mj.sensors.channel import Received, exchange
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.sensors.links import Links
from iswarm_mj.sensors.message_time import draw_first_slots, sides_on, understood
from iswarm_mj.sensors.messages import PRIORITY, Message
from iswarm_mj.simulation import power
from iswarm_mj.simulation.state import SwarmState, WorldParams
from iswarm_mj.strategy.declared import payload_of, said
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.protocol import RelayingStrategy, Strategy
from iswarm_mj.strategy.threefry import unrolled
from iswarm_mj.strategy.turns import draw_turns, heard_in_turn
from iswarm_mj.strategy.vector_strategy import VectorStrategy
from iswarm_mj.tasks.cleaning import Cleaning
from iswarm_mj.tasks.protocol import Around, Sensed, Things
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.robot import Robot
from iswarm_mj.utils.units import mm_from_rd

Tree = TypeVar("Tree")
TURNS_STREAM, SLOTS_STREAM, ACTUATORS_STREAM = 3, 4, 5
"""Of the random numbers of a control step: the order of the robots, slots of messages, errors of the actuators."""


class Situation(NamedTuple):
    """What a world's control step begins with, beside its state."""

    poses: Float[Array, "*B N 3"]
    """x, y [mm] and yaw [rad]."""
    sight: Sight
    """Light that the robots receive."""
    step: Int[Array, ""]
    """Number of the control step, from 0."""
    is_running: Bool[Array, "*B"]
    """Whether the world takes this step."""


class Spoken(NamedTuple):
    """What robots sent as the step began, and what became of it."""

    message: UInt32[Array, "*B N"]
    """The 32 bits that a robot's first LED sent; those of the other LEDs differ in number and check."""
    is_heard: Bool[Array, "*B N S"]
    """A message arrived on this side, and its check is right, if that is looked at."""
    measured_distance: Float[Array, "*B N S"]
    """Of the sender of a link [mm]."""


class Decision(NamedTuple):
    """Outcome of `decide`."""

    swarm: SwarmState
    command: Command
    """As the strategy gave it, with the errors of the actuators; zero for the dead."""
    has_priority: Bool[Array, "*B N"]
    """The robot sends the flag `priority` as the step begins; never where the payload has none."""
    links: Links
    """Of each side (*B, N, S), the sender whose message it receives unless noise spoils it."""
    spoken: Spoken
    progress: Int[Array, "*B"]
    """Of the task, see `Task.progress`."""


def decide(config: SwarmConfig, robot: Robot, params: WorldParams, swarm: SwarmState, situation: Situation) -> Decision:
    """Take a world's control step up to the commands; a world that does not run keeps its state.

    Args:
        config: what worlds of one run have in common (`common.Common`); all else is in `params`.
        robot: its geometry.
        params: of the world.
        swarm: after the step before.
        situation: poses, light and time, without a leading axis.

    Raises:
        UserError: updates are sequential, and the strategy cannot pass on what its robots have just heard.
    """
    n_robots, is_alive, strategy = len(situation.poses), swarm.is_alive, params.strategy
    payload = said(strategy, swarm.memory, loaded(swarm.balls, n_robots))
    picks = strategy.picks(swarm.memory) & is_alive
    seen = perceive(config, robot, params, swarm, situation, payload, picks)
    observation, policy_key = seen.observation, seen.policy_key
    if config.strategy.update_order == "sequential" and payload:
        relaying = _relaying(strategy)

        def relay(observation: Observation) -> Message:
            heard = relaying.listen(swarm.memory, observation, policy_key)
            return seen.transmit(relaying.say(heard, observation.is_loaded)).message

        turns = draw_turns(jax.random.fold_in(seen.step_key, TURNS_STREAM), n_robots)
        observation = heard_in_turn(observation, turns, seen.links.sender, relay)
    memory, command = strategy.act(swarm.memory, observation, policy_key)
    command = executed(config, params.conditions, command, jax.random.fold_in(seen.step_key, ACTUATORS_STREAM))
    acts = is_alive if observation.waits is None else is_alive & ~observation.waits
    command = jax.tree.map(lambda a: jnp.where(acts, a, 0.0), command)
    energy = seen.energy
    if energy is not None:
        energy = power.after(config, energy, command, (swarm.balls, seen.things.balls), params.conditions, is_alive)
    decided = SwarmState(memory, seen.things.balls, is_alive, seen.things.own, energy, seen.starved)
    kept = jax.tree.map(lambda new, old: jnp.where(situation.is_running, new, old), decided, swarm)
    flag = payload.get(PRIORITY, jnp.zeros(n_robots, bool)) & is_alive
    return Decision(kept, command, flag, seen.links, seen.spoken, params.task.progress(kept.things))


class Perceived(NamedTuple):
    """What N robots of a world perceive as a control step begins, after what they said and gripped."""

    observation: Observation
    things: Things
    """What became of the task."""
    around: Around
    """What the task found."""
    links: Links
    """See `Decision`."""
    spoken: Spoken
    transmit: Callable[[dict[str, Any]], Received]
    """Messages as received, with the same noise at whatever time within this step they are sent."""
    step_key: Array
    policy_key: Array
    """Random keys of the world and step, the second of its strategy."""
    energy: Any = None
    """In the robots' capacitors (N,), with what light put in [J]; None where they have none."""
    starved: Any = None
    """Control steps in which each robot waited for energy (N,), this one included; None likewise."""


def perceive(
    config: SwarmConfig,
    robot: Robot,
    params: WorldParams,
    swarm: SwarmState,
    situation: Situation,
    payload: dict[str, Any],
    picks: Bool[Array, "N"],
) -> Perceived:
    """Take a world's control step up to what robots know: communicate, and advance the task.

    Args:
        config: what worlds of one run have in common.
        robot: its geometry.
        params: of the world.
        swarm: after the step before.
        situation: poses, light and time, without a leading axis.
        payload: what each robot says.
        picks: which robots pick up what their tools reach.
    """
    poses, sight, step, _ = situation
    n_robots, optics = len(poses), config.optics
    step_key = jax.random.fold_in(unrolled(params.key), step)
    channel_key, task_key, policy_key = jax.random.split(step_key, 3)

    if optics.baud_rate:
        first_slot = draw_first_slots(optics, jax.random.fold_in(step_key, SLOTS_STREAM), n_robots)
        sight = Sight(
            understood(optics, sight.links, first_slot, robot.sides), sight.sees_wall & sides_on(optics, robot.sides)
        )
    declared = payload_of(params.strategy)

    def transmit(payload: dict[str, Any]) -> Received:
        return exchange(params.conditions, declared, payload, sight.links, channel_key)

    received = transmit(payload)
    energy, starved, volts, waits = None, None, None, jnp.zeros(n_robots, bool)
    if swarm.energy is not None:
        energy = power.charged(config, swarm.energy)
        volts, waits = power.voltage(config.energy, energy), ~power.can_act(config, energy)
        starved = swarm.starved + (waits & swarm.is_alive)
    around = Around(poses, params.is_present, swarm.is_alive, picks & ~waits, params.conditions, config, robot, volts)
    things, sensed = params.task.advance(swarm.things, around, task_key)
    waits = waits | working(things.balls, n_robots)
    observation = _observe(sight, received, sensed, loaded(things.balls, n_robots))
    if takes_time(config):
        observation = observation._replace(waits=waits)
    spoken = Spoken(received.bits[:, 0], received.is_heard, received.distance)
    return Perceived(observation, things, around, sight.links, spoken, transmit, step_key, policy_key, energy, starved)


@partial(jax.jit, static_argnames=("config", "robot"))
def decide_worlds(
    config: SwarmConfig, robot: Robot, params: WorldParams, swarm: SwarmState, situation: Situation
) -> Decision:
    """`decide` for B worlds at once, all at the same step."""
    of_one = partial(decide, config, robot)
    steps = jnp.broadcast_to(situation.step, situation.is_running.shape)
    return jax.vmap(of_one)(params, swarm, situation._replace(step=steps))


def takes_time(config: SwarmConfig) -> bool:
    """Whether robots ever wait: for an attempt to end, for room among the trials of a step, or for energy."""
    gripper = config.gripper
    is_slow = gripper.grasp_time > 0 or gripper.release_time > 0 or gripper.resolution == "dynamic"
    return is_slow or config.energy.model != "none"


@partial(jax.jit, static_argnames=("config", "robot"))
def decide_alike(
    config: SwarmConfig, robot: Robot, params: WorldParams, swarm: SwarmState, situation: Situation
) -> Decision:
    """`decide_worlds`, where what a world decides does not depend on how many there are, to the last bit.

    The program of the paper's strategy and task rounds alike for one world and for more; of others, see `alike`.
    """
    step = situation.step

    def of_all(params: WorldParams, swarm: SwarmState, situation: Situation) -> Decision:
        return decide_worlds(config, robot, params, swarm, situation._replace(step=step))

    is_papers = isinstance(params.strategy, VectorStrategy) and isinstance(params.task, Cleaning)
    known = is_papers and config.gripper.resolution == "quasi-static"
    return (of_all if known else alike(of_all))(params, swarm, situation._replace(step=situation.is_running))


def alike(function: Callable[..., Tree]) -> Callable[..., Tree]:
    """Return a function of trees of B worlds whose results for a world do not depend on B, to the last bit.

    Programs for two worlds and more round alike, but from that for one world an axis of size one vanishes, after which
    other loops may be fused. One world is therefore computed twice.

    Args:
        function: of such trees.
    """

    def of_worlds(*trees: Any) -> Tree:
        if len(jax.tree.leaves(trees)[0]) > 1:
            return function(*trees)
        twice = jax.lax.optimization_barrier(jax.tree.map(lambda a: jnp.concatenate([a, a]), trees))
        return jax.tree.map(lambda a: a[:1], jax.lax.optimization_barrier(function(*twice)))

    return of_worlds


def executed(config: SwarmConfig, conditions: Conditions, command: Command, key: Array) -> Command:
    """Commands of N robots with the errors of their actuators, where they move at all; these may exceed the limits."""
    error = jax.random.normal(key, (len(command.turn), 2))
    moves = (command.turn != 0.0) | (command.forward != 0.0)
    turn = command.turn + jnp.where(moves, jnp.deg2rad(conditions.error_turn) * error[:, 0], 0.0)
    step = mm_from_rd(config.step_length)
    slip = conditions.error_step * error[:, 1] * jnp.clip(command.forward, -step, step)
    return Command(turn, command.forward + slip)


def _observe(sight: Sight, received: Received, sensed: Sensed, is_loaded: Array) -> Observation:
    """Everything that the robots may know of this step."""
    message = received.message
    return Observation(
        is_heard=received.is_heard,
        bearing=sight.links.bearing,
        distance=received.distance,
        led=message.led,
        payload=message.payload,
        sees_wall=sight.sees_wall,
        at_dust=sensed.at_dust,
        ball_vector=sensed.ball_vector,
        on_dump=sensed.on_dump,
        is_loaded=is_loaded,
        grasp_failed=sensed.grasp_failed,
        sensed=sensed.own,
    )


def _relaying(strategy: Strategy) -> RelayingStrategy:
    if isinstance(strategy, RelayingStrategy):
        return strategy
    raise UserError(
        f"strategy.update_order is sequential, but {type(strategy).__name__} has no method listen; add one (see "
        "RelayingStrategy), or use synchronous updates."
    )
