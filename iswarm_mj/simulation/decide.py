"""The decisions of the robots of one world in a control step: perceive, act, actuate. Pure JAX."""

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
from iswarm_mj.simulation.actuate import DriveInputs, DriveOutput, actuate
from iswarm_mj.simulation.packed import Packed, pack
from iswarm_mj.simulation.perceive import (
    HeldOutputs,
    Perceived,
    StepInputs,
    perceive,
    with_conditions,
)
from iswarm_mj.simulation.state import SwarmState, WorldParams
from iswarm_mj.simulation.streams import StepKeys, step_keys
from iswarm_mj.strategy.attributes import led_power, payload_of
from iswarm_mj.strategy.base import Strategy, is_batch_invariant, overrides
from iswarm_mj.strategy.interface import Observation
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError

Tree = TypeVar("Tree")


class Decision(NamedTuple):
    """Outcome of `decide`."""

    swarm: SwarmState
    """State after the step, but for what the motion changes."""
    drive: DriveOutput
    """Motion that the drives carry out; energy and shortfall are None, since `swarm` has them."""
    progress: Int[Array, "*B"]
    """Progress of the task, see `Task.progress`."""
    has_priority: Bool[Array, "*B N"]
    """Robots that send the flag `priority` as the step begins; none without such a flag."""
    links: Links | None
    """Links over which messages arrived; None where they are those of the inputs."""
    received: Received
    """Messages that the sides received, see `Perceived`."""
    box_targets: Float[Array, "*B M 3"] | None = None
    """Poses to which the task drives boxes, see `Task.drive_boxes`; None where it drives none."""


def decide(
    config: StaticConfig,
    robot: Robots,
    params: WorldParams,
    swarm: SwarmState,
    inputs: StepInputs,
) -> Decision:
    """Take a world's control step up to the motion; a world that does not run keeps its state.

    Args:
        config: settings that control steps are compiled for (`shared_settings.static_config`).
        robot: geometry of the robots.
        params: parameters of the world.
        swarm: state after the previous step.
        inputs: bodies, light and time, without a leading axis.

    Raises:
        UserError: updates are sequential, and the strategy cannot pass on what its robots have just
            heard.
    """
    params = with_conditions(params, swarm)
    strategy = params.strategy
    keys = step_keys(params.key, inputs.step)

    # Perceive: messages of the previous step arrive, and the task advances.
    outputs = _held_outputs(strategy, swarm)
    perceived = perceive(config, robot, params, swarm, inputs, outputs, keys)
    observation = perceived.observation
    if config.strategy.update_order == "sequential" and outputs.payload:
        observation = _observe_in_turn(strategy, swarm.memory, perceived, keys)

    # Act: the strategy turns what the robots know into memories and commands.
    memory, command = strategy.act(swarm.memory, observation, keys.policy)

    # Actuate: drives limit the commands and add errors; robots know what they could not walk.
    drive_inputs = DriveInputs(
        swarm=perceived.swarm,
        waits=observation.waits,
        poses=inputs.poses,
        is_present=params.is_present,
        tool_voltage_squared=perceived.sensed.tool_voltage_squared,
    )
    drive = actuate(config, params.conditions, command, drive_inputs, keys.actuators)
    memory = strategy.correct_odometry(memory, drive.shortfall)
    decided = perceived.swarm._replace(
        memory=memory, energy=drive.energy, led_power=led_power(strategy, memory)
    )

    # Worlds that do not run keep their state.
    kept = jax.tree.map(lambda new, old: jnp.where(inputs.is_running, new, old), decided, swarm)
    no_flags = jnp.zeros(len(inputs.poses), bool)
    return Decision(
        swarm=kept,
        has_priority=outputs.payload.get(PRIORITY, no_flags) & swarm.is_alive,
        progress=params.task.progress(kept.task),
        links=perceived.links if config.optics.baud_rate else None,
        box_targets=params.task.drive_boxes(kept.task),
        drive=drive._replace(shortfall=None, energy=None),
        received=perceived.received,
    )


def _held_outputs(strategy: Strategy, swarm: SwarmState) -> HeldOutputs:
    """Return what robots say and what their tools do, by their memories as the step begins."""
    payload = {}
    if payload_of(strategy).fields:
        payload = strategy.say(swarm.memory, swarm.is_loaded)
    return HeldOutputs(
        payload=payload,
        picks=strategy.picks(swarm.memory) & swarm.is_alive,
        releases=strategy.releases(swarm.memory),
    )


def _observe_in_turn(
    strategy: Strategy, memory: Any, perceived: Perceived, keys: StepKeys
) -> Observation:
    """Return the observation of robots that hear and speak one after the other, in random order.

    Raises:
        UserError: the strategy cannot pass on what its robots have just heard.
    """
    if not overrides(strategy, Strategy, "listen"):
        raise UserError(
            f"strategy.update_order is sequential, but {type(strategy).__name__} has no method "
            "listen; add one (see Strategy.listen), or use synchronous updates."
        )

    def relay(observation: Observation) -> Message:
        """Return the messages that arrive if all robots have heard this, and say so."""
        memory_after = strategy.listen(memory, observation, keys.policy)
        content = strategy.say(memory_after, observation.is_loaded)
        return perceived.transmit(content).message

    observation = perceived.observation
    turns = draw_turns(keys.turns, len(observation.waits))
    return hear_in_turn(observation, turns, perceived.links.sender, relay)


def draw_turns(key: Array, n_robots: int) -> Float[Array, "N"]:
    """Return random numbers in [0, 1) by which robots take their turns: the smallest first.

    Two robots with equal numbers, which occur once in 2^23 pairs, take their turns at the same
    time.
    """
    return jax.random.uniform(key, (n_robots,))


def hear_in_turn(
    observation: Observation,
    turns: Float[Array, "N"],
    sender: Int[Array, "N S"],
    relay: Callable[[Observation], Message],
) -> Observation:
    """Return what robots hear that take their turns one after the other.

    The paper does not state their order.

    A robot hears what those before it have just learned, and what those after it said at the end of
    the previous step. All robots are updated at once, repeatedly, until no message changes. Since
    nobody hears anything new from the robots after it, k sweeps settle all robots that news reaches
    through at most k others: in the end all have heard what they would have heard one by one. That
    takes one sweep more than the longest path of news has links.

    Args:
        observation: observation of N robots, with the messages that were sent at the end of the
            previous step.
        turns: order of each robot's turn (`draw_turns`).
        sender: sender of each side, where something is heard.
        relay: function of an observation; returns the messages (N, S) that arrive if all robots
            have heard it, and pass it on.
    """
    old_messages = Message(observation.led, observation.payload)
    is_new = observation.is_heard & (turns[sender] < turns[:, None])
    choose_new = partial(jax.vmap(jax.vmap(jnp.where)), is_new)

    def sweep(state: tuple[Message, Array]) -> tuple[Message, Array]:
        """Update all messages once; no sweeps are left when nothing changes."""
        before, sweeps_left = state
        relayed = relay(observation._replace(**before._asdict()))
        after = jax.tree.map(choose_new, relayed, old_messages)
        leaves = zip(jax.tree.leaves(after), jax.tree.leaves(before), strict=True)
        changed = jnp.stack([(new != old).any() for new, old in leaves])
        return after, jnp.where(changed.any(), sweeps_left - 1, 0)

    def is_unsettled(state: tuple[Message, Array]) -> Array:
        """Return whether sweeps are left."""
        _, sweeps_left = state
        return sweeps_left > 0

    max_sweeps = jnp.int32(len(turns))
    settled, _ = jax.lax.while_loop(is_unsettled, sweep, (old_messages, max_sweeps))
    return observation._replace(**settled._asdict())


def decide_worlds(
    config: StaticConfig,
    robot: Robots,
    params: WorldParams,
    swarm: SwarmState,
    inputs: StepInputs,
) -> Decision:
    """Return the decisions of B worlds at once, all at the same step; see `decide`."""
    decide_world = partial(decide, config, robot)
    # The step is one number for all worlds, and `vmap` takes an axis of worlds of each input.
    steps = jnp.broadcast_to(inputs.step, inputs.is_running.shape)
    return jax.vmap(decide_world)(params, swarm, inputs._replace(step=steps))


@partial(jax.jit, static_argnames=("config", "robot"))
def decide_packed(
    config: StaticConfig,
    robot: Robots,
    packed_params: Packed,
    swarm: SwarmState,
    inputs: StepInputs,
) -> Decision:
    """Return the decisions of B worlds, each to the last bit as if it were alone; see `decide`.

    Args:
        config: settings that control steps are compiled for.
        robot: geometry of the robots.
        packed_params: the `WorldParams` of the worlds, packed.
        swarm: state after the previous step, in which `memory` and `task` are packed. They are
            packed in the state that is returned, too, which the next step takes as it is.
        inputs: bodies and light of the worlds, and one time for all.
    """
    params = packed_params.tree
    swarm = swarm._replace(memory=swarm.memory.tree, task=swarm.task.tree)

    decide_all = partial(decide_worlds, config, robot)
    if not _rounds_alike_in_any_batch(config, params):
        decide_all = pad_singleton_batch(decide_all)
    decision = decide_all(params, swarm, inputs)

    packed_swarm = decision.swarm._replace(
        memory=pack(decision.swarm.memory), task=pack(decision.swarm.task)
    )
    return decision._replace(swarm=packed_swarm)


def _rounds_alike_in_any_batch(config: StaticConfig, params: WorldParams) -> bool:
    """Return whether the program for one world is known to round as those for more worlds do.

    Strategies and tasks of which that was measured state it (`Strategy.batch_invariant`). For the
    rest a single world is computed as two.
    """
    is_stated = is_batch_invariant(params.strategy) and is_batch_invariant(params.task)
    return is_stated and config.gripper.resolution == "quasi-static"


def pad_singleton_batch(function: Callable[..., Tree]) -> Callable[..., Tree]:
    """Return a function of B worlds whose results for a world do not depend on B, to the last bit.

    XLA drops a batch axis of size one. It then fuses the loops of the program in another way, so
    that results are rounded in another way, too. Programs for two worlds and for more round alike.
    A single world is therefore computed twice, as a batch of two, and one result is returned.

    Args:
        function: takes and returns trees whose arrays have a first axis of B worlds. It may take
            scalars, too, which hold for all worlds.
    """

    def double(values: Array) -> Array:
        is_scalar = values.ndim == 0
        return values if is_scalar else jnp.concatenate([values, values])

    def padded(*trees: Any) -> Tree:
        n_worlds = next(len(leaf) for leaf in jax.tree.leaves(trees) if leaf.ndim > 0)
        if n_worlds > 1:
            return function(*trees)

        # The barriers hide from XLA that both worlds are equal and that one result is dropped:
        # otherwise it could simplify the batch to a single world again.
        doubled = jax.lax.optimization_barrier(jax.tree.map(double, trees))
        results = jax.lax.optimization_barrier(function(*doubled))
        return jax.tree.map(lambda values: values[:1], results)

    return padded
