"""One control step of the swarm: sense, act, drive."""

from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from iswarm_mj.config import Conditions, SwarmConfig
from iswarm_mj.engines.base import Engine
from iswarm_mj.gripper.handling import Balls, carry, handle, loaded
from iswarm_mj.sensors.channel import Channel, exchange
from iswarm_mj.sensors.floor import probe_tips, sense
from iswarm_mj.sensors.links import Links, find_links
from iswarm_mj.sensors.messages import Message
from iswarm_mj.sensors.optics import led_positions, outward_normals
from iswarm_mj.strategy.controller import Command, Observation
from iswarm_mj.strategy.protocol import RelayingStrategy, Strategy
from iswarm_mj.strategy.turns import draw_turns, heard_in_turn
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import mm_from_rd


class SwarmState(NamedTuple):
    """Everything about one world that is not rigid-body physics."""

    memory: Any
    """What the robots remember, the strategy's memory."""
    balls: Balls
    """Where the balls are and who holds them."""
    is_alive: Array
    """(N,) bool; the others neither sense, nor send, nor move."""


def decide(
    config: SwarmConfig, probe: tuple[float, float], conditions: Conditions, strategy: Strategy, state: SwarmState,
    poses: Array, links: Links, sees_wall: Array, step: Array, key: Array,
) -> tuple[SwarmState, Command, Array]:  # fmt: skip
    """Hear, feel the floor, grip, think: one world's control step up to the commands. Pure.

    Args:
        config: everything that is not evolved.
        probe: the probe's tip ahead of and beside a robot's centre [mm].
        conditions: noise and voltages of this world; those in `config` do not count.
        strategy: what the robots say and do.
        state: of the step before.
        poses: (N, 3) x, y [mm] and yaw [rad].
        links: who hears whom, without the world axis.
        sees_wall: (N, 4) bool.
        step: number of the control step.
        key: random key of the world.

    Returns:
        The new state, the commands, and which robots send the priority flag (N,) bool as the step begins.

    Raises:
        UserError: updates are sequential, and the strategy cannot pass on what its robots have just heard.
    """
    n_robots = len(poses)
    step_key = jax.random.fold_in(key, step)
    channel_key, fall_key, memory_key = jax.random.split(step_key, 3)
    memory, balls, is_alive = state
    content = strategy.say(memory, loaded(balls, n_robots))
    content = content._replace(priority=content.priority & is_alive)
    channel = Channel(conditions, config.optics.independent_bit_errors, mm_from_rd(config.strategy.message_range))
    message, is_heard, distance = exchange(channel, content, links, channel_key)

    tips = probe_tips(poses, jnp.asarray(probe))
    balls = carry(balls, tips)
    reach = mm_from_rd(config.strategy.dust_range)
    view = sense(poses, tips, balls.position, balls.is_lying, mm_from_rd(config.arena.dump_size), reach)
    falls = jax.random.bernoulli(fall_key, conditions.drop_rate, balls.is_held.shape)
    picks = strategy.picks(memory) & is_alive
    balls, grasp_failed = handle(config.gripper, conditions, balls, tips, view, picks, falls)

    observation = Observation(
        is_heard=is_heard, bearing=links.bearing, distance=distance, led=message.led, priority=message.priority,
        dust=message.dust, dump=message.dump, sees_wall=sees_wall, at_dust=view.at_dust,
        ball_vector=view.ball_vector, on_dump=view.on_dump, is_loaded=loaded(balls, n_robots),
        grasp_failed=grasp_failed,
    )  # fmt: skip
    if config.strategy.update_order == "sequential":
        relaying = _relaying(strategy)

        def relay(observation: Observation) -> Message:
            """Messages as received, with the same noise at whatever time within this step they are sent."""
            said = relaying.say(relaying.listen(memory, observation, memory_key), observation.is_loaded)
            return exchange(channel, said._replace(priority=said.priority & is_alive), links, channel_key).message

        turns = draw_turns(jax.random.fold_in(step_key, 3), n_robots)
        observation = heard_in_turn(observation, turns, links.sender, relay)
    memory, command = strategy.act(memory, observation, memory_key)
    command = jax.tree.map(lambda a: jnp.where(is_alive, a, 0.0), command)
    return SwarmState(memory, balls, is_alive), command, content.priority


def _relaying(strategy: Strategy) -> RelayingStrategy:
    if isinstance(strategy, RelayingStrategy):
        return strategy
    raise UserError(
        f"--strategy.update-order was sequential, but {type(strategy).__name__} has no method listen; give it one "
        "(see RelayingStrategy), or let updates be synchronous."
    )


@partial(jax.jit, static_argnames=("config", "probe"))
def decide_worlds(config, probe, conditions, strategy, state, poses, links, sees_wall, step, key, is_running):
    """`decide` for B worlds at once; those that do not run keep their state."""
    one_world = partial(decide, config, probe)
    new, command, priority = jax.vmap(one_world, in_axes=(0, 0, 0, 0, 0, 0, None, 0))(
        conditions, strategy, state, poses, links, sees_wall, step, key
    )

    def keep(new: Array, old: Array) -> Array:
        return jnp.where(is_running.reshape(-1, *[1] * (new.ndim - 1)), new, old)

    return jax.tree.map(keep, new, state), command, priority


def see(config: SwarmConfig, engine: Engine, poses: np.ndarray, sends: np.ndarray) -> tuple[Links, np.ndarray]:
    """Light of this control step: the links (B, N, 4) and which sides see a wall (B, N, 4) bool.

    Of N robots at `poses` (B, N, 3), those that send light are `sends` (B, N) bool.
    """

    def reaches(world, origin, target, receiver, sender):
        share, hit = engine.cast_rays(world, origin, target - origin, receiver)
        return (hit == sender) | (share >= 1.0)

    return find_links(poses, engine.robot, config.optics, reaches, sends), find_walls(config, engine, poses)


def find_walls(config: SwarmConfig, engine: Engine, poses: np.ndarray) -> np.ndarray:
    """Whether a wall reflects the light of each LED (B, N, 4): the first thing on its axis, within range.

    A LED that a robot presses a little into a wall sees it too.
    """
    length = mm_from_rd(config.optics.wall_range)
    edge = mm_from_rd(config.arena.size) / 2
    leds = led_positions(poses, engine.robot)
    outward = outward_normals(poses) * length
    beyond = np.abs(leds + outward).max(axis=-1) > edge
    world, robot, _ = np.nonzero(beyond)
    origin, vector = leds[beyond], outward[beyond]
    share, hit = engine.cast_rays(world, origin, vector, robot)
    sees = np.abs(leds).max(axis=-1) > edge
    sees[beyond] |= (share <= 1.0) & (hit >= poses.shape[1])
    return sees


def drive(config: SwarmConfig, engine: Engine, command: Command, worlds: np.ndarray) -> list[np.ndarray]:
    """Turn on the spot, then walk ahead, along the heading as it is then.

    A robot that a contact turns while it walks keeps its direction over the ground until the next control step.

    Args:
        config: durations of the phases.
        engine: moves the robots.
        command: turns and distances (B, N).
        worlds: (W,) indices of the worlds that move.

    Returns:
        For each of these worlds, the pairs of robots (P,) that touch after the turn or after the walk, as
        `Engine.contacts` numbers them.
    """
    options = config.drive
    velocity = np.zeros((*np.shape(command.turn), 3))
    velocity[..., 2] = np.asarray(command.turn) / (options.turn_substeps * options.timestep)
    engine.advance(velocity, options.turn_substeps, worlds)
    turned = [engine.contacts(w) for w in worlds]
    yaw = engine.poses()[..., 2]
    speed = np.asarray(command.forward) / (options.walk_substeps * options.timestep)
    velocity = np.stack([speed * np.cos(yaw), speed * np.sin(yaw), np.zeros_like(yaw)], axis=-1)
    engine.advance(velocity, options.walk_substeps, worlds)
    return [np.unique(np.concatenate([t, engine.contacts(w)])) for t, w in zip(turned, worlds, strict=True)]


def ball_centres(state: SwarmState, poses: np.ndarray, probe: np.ndarray, tip_height: float) -> np.ndarray:
    """World positions (B, K, 3) of the balls' centres after the robots moved to `poses` (B, N, 3) [mm]."""
    balls = state.balls
    radius = np.asarray(balls.radius) * 1e3
    held, holder = np.asarray(balls.is_held), np.asarray(balls.holder)
    at = np.take_along_axis(poses, holder[..., None], axis=1)
    c, s = np.cos(at[..., 2]), np.sin(at[..., 2])
    tip = np.stack([at[..., 0] + c * probe[0] - s * probe[1], at[..., 1] + s * probe[0] + c * probe[1]], axis=-1)
    xy = np.where(held[..., None], tip, np.asarray(balls.position))
    return np.concatenate([xy, np.where(held, tip_height - radius, radius)[..., None]], axis=-1)
