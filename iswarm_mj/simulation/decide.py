"""What the robots of one world decide in a control step: perceive, act. Pure JAX."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.geometry.robot import Robots
from iswarm_mj.sensors.channel import Received
from iswarm_mj.sensors.links import Links
from iswarm_mj.sensors.messages import PRIORITY, Message
from iswarm_mj.simulation.actuate import DriveOutput, actuate
from iswarm_mj.simulation.packed import Packed, pack
from iswarm_mj.simulation.perceive import StepInputs, perceive, with_conditions
from iswarm_mj.simulation.state import SwarmState, WorldParams
from iswarm_mj.simulation.streams import step_keys
from iswarm_mj.strategy.base import Strategy, overrides
from iswarm_mj.strategy.declared import led_power, payload_of
from iswarm_mj.strategy.interface import Observation
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError

Tree = TypeVar("Tree")


class Decision(NamedTuple):
    """Outcome of `decide`."""

    swarm: SwarmState
    done: DriveOutput
    """By the drives; energy and shortfall are None, since `swarm` has them and what robots remember of them."""
    progress: Int[Array, "*B"]
    """Of the task, see `Task.progress`."""
    has_priority: Bool[Array, "*B N"]
    """The robot sends the flag `priority` as the step begins; never where the payload has none."""
    links: Links | None
    """See `Perceived`; None where they are those of the inputs."""
    received: Received
    """See `Perceived`."""
    boxes: Float[Array, "*B M 3"] | None = None
    """See `Task.drive_boxes`; None where the task drives none."""


def decide(config: StaticConfig, robot: Robots, params: WorldParams, swarm: SwarmState, begin: StepInputs) -> Decision:
    """Take a world's control step up to the commands; a world that does not run keeps its state.

    Args:
        config: what control steps are compiled for (`shared_settings.static_config`); all else is in `params`.
        robot: its geometry.
        params: of the world.
        swarm: after the step before.
        begin: poses, light and time, without a leading axis.

    Raises:
        UserError: updates are sequential, and the strategy cannot pass on what its robots have just heard.
    """
    params = with_conditions(params, swarm)
    n_robots, is_alive, strategy = len(begin.poses), swarm.is_alive, params.strategy
    keys = step_keys(params.key, begin.step)
    payload = strategy.say(swarm.memory, swarm.is_loaded) if payload_of(strategy).fields else {}
    picks = strategy.picks(swarm.memory) & is_alive
    releases = strategy.releases(swarm.memory)
    seen = perceive(config, robot, params, swarm, begin, keys, payload, picks, releases)
    observation = seen.observation
    if config.strategy.update_order == "sequential" and payload:
        if not overrides(strategy, Strategy, "listen"):
            raise UserError(
                f"strategy.update_order is sequential, but {type(strategy).__name__} has no method listen; add one "
                "(see Strategy.listen), or use synchronous updates."
            )

        def relay(observation: Observation) -> Message:
            heard = strategy.listen(swarm.memory, observation, keys.policy)
            return seen.transmit(strategy.say(heard, observation.is_loaded)).message

        turns = draw_turns(keys.turns, n_robots)
        observation = heard_in_turn(observation, turns, seen.links.sender, relay)
    memory, command = strategy.act(swarm.memory, observation, keys.policy)
    done = actuate(
        config,
        params.conditions,
        command,
        seen.swarm,
        observation.waits,
        begin.poses,
        params.is_present,
        seen.sensed.tool_voltage_squared,
        keys.actuators,
    )
    memory = strategy.correct_odometry(memory, done.shortfall)
    decided = seen.swarm._replace(memory=memory, energy=done.energy, led_power=led_power(strategy, memory))
    kept = jax.tree.map(lambda new, old: jnp.where(begin.is_running, new, old), decided, swarm)
    flag = payload.get(PRIORITY, jnp.zeros(n_robots, bool)) & is_alive
    progress = params.task.progress(kept.task)
    links = seen.links if config.optics.baud_rate else None
    boxes = params.task.drive_boxes(kept.task)
    done = done._replace(shortfall=None, energy=None)
    return Decision(kept, done, progress, flag, links, seen.received, boxes)


def draw_turns(key: Array, n_robots: int) -> Float[Array, "N"]:
    """Random numbers in [0, 1) by which robots take their turns: the smallest first.

    Two robots with equal numbers, which occur once in 2^23 pairs, take their turns at the same time.
    """
    return jax.random.uniform(key, (n_robots,))


def heard_in_turn(
    observation: Observation,
    turns: Float[Array, "N"],
    sender: Int[Array, "N S"],
    relay: Callable[[Observation], Message],
) -> Observation:
    """What robots hear that take their turns one after the other, in an order that the paper does not state.

    A robot hears what those before it have just learned, and what those after it said at the end of the step before.
    All robots are updated at once, repeatedly, until no message changes. Since nobody hears anything new from the
    robots after it, k sweeps settle all robots that news reaches through at most k others: in the end all have heard
    what they would have heard one by one. That takes one sweep more than the longest path of news has links.

    Args:
        observation: what N robots sense, with the messages that were said at the end of the step before.
        turns: when each robot has its turn.
        sender: who sends to each side, where something is heard.
        relay: messages (N, S) as they arrive if all robots have heard what it is given, and say so.
    """
    old = Message(observation.led, observation.payload)
    is_new = observation.is_heard & (turns[sender] < turns[:, None])

    def sweep(state: tuple[Message, Array]) -> tuple[Message, Array]:
        before, sweeps_left = state
        relayed = relay(observation._replace(**before._asdict()))
        now = jax.tree.map(partial(jax.vmap(jax.vmap(jnp.where)), is_new), relayed, old)
        changes = [(a != b).any() for a, b in zip(jax.tree.leaves(now), jax.tree.leaves(before), strict=True)]
        return now, jnp.where(jnp.stack(changes).any(), sweeps_left - 1, 0)

    settled, _ = jax.lax.while_loop(lambda state: state[1] > 0, sweep, (old, jnp.int32(len(turns))))
    return observation._replace(**settled._asdict())


def decide_worlds(
    config: StaticConfig, robot: Robots, params: WorldParams, swarm: SwarmState, begin: StepInputs
) -> Decision:
    """`decide` for B worlds at once, all at the same step."""
    of_one = partial(decide, config, robot)
    steps = jnp.broadcast_to(begin.step, begin.is_running.shape)
    return jax.vmap(of_one)(params, swarm, begin._replace(step=steps))


@partial(jax.jit, static_argnames=("config", "robot"))
def decide_packed(
    config: StaticConfig, robot: Robots, params: Packed, swarm: SwarmState, begin: StepInputs
) -> Decision:
    """`decide_worlds`, where what a world decides does not depend on how many there are, to the last bit.

    The parameters are packed, and so are memories and the state of the task.
    """
    own, step = params.tree, begin.step
    swarm = swarm._replace(memory=swarm.memory.tree, task=swarm.task.tree)

    def of_all(params: WorldParams, swarm: SwarmState, begin: StepInputs) -> Decision:
        return decide_worlds(config, robot, params, swarm, begin._replace(step=step))

    known = all(getattr(rules, "batch_invariant", False) for rules in (own.strategy, own.task))
    known = known and config.gripper.resolution == "quasi-static"
    decision = (of_all if known else pad_singleton_batch(of_all))(own, swarm, begin._replace(step=begin.is_running))
    memory, task = pack(decision.swarm.memory), pack(decision.swarm.task)
    return decision._replace(swarm=decision.swarm._replace(memory=memory, task=task))


def pad_singleton_batch(function: Callable[..., Tree]) -> Callable[..., Tree]:
    """Return a function of trees of B worlds whose results for a world do not depend on B, to the last bit.

    XLA drops a batch axis of size one and then fuses other loops, while programs for at least two worlds round alike.
    One world is therefore computed twice.

    Args:
        function: of such trees.
    """

    def of_worlds(*trees: Any) -> Tree:
        if len(jax.tree.leaves(trees)[0]) > 1:
            return function(*trees)
        twice = jax.lax.optimization_barrier(jax.tree.map(lambda a: jnp.concatenate([a, a]), trees))
        return jax.tree.map(lambda a: a[:1], jax.lax.optimization_barrier(function(*twice)))

    return of_worlds
