"""The vector-based strategy with scouts: what a robot says and does, from what it senses (section 4 of the paper).

One pure function over a robot axis. A robot knows its own memory, what its photodiodes received, and what lies
under it; it knows neither where it is nor which way it looks.
"""

import math
from collections import namedtuple
from dataclasses import astuple, fields
from typing import NamedTuple

import jax
import jax.numpy as jnp

from iswarm_mj.config import SwarmConfig
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.strategy.avoidance import kept_distance, repulsion
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.strategy.vectors import after_motion, heard, standing_on, take_over
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import mm_from_rd

Rules = namedtuple("Rules", [f.name for f in fields(Genome)])  # the genome's values, as JAX scalars


class RobotMemory(NamedTuple):
    """What N robots carry from one control step to the next."""

    dust: VectorMemory
    """Way to dust."""
    dump: VectorMemory
    """Way to the dump."""
    is_scout: Array
    """(N,) bool."""


class Observation(NamedTuple):
    """All that N robots sense in one control step, each with S = 4 sides."""

    is_heard: Array
    """(N, S) bool, a message arrived on this side and its parity was right."""
    bearing: Array
    """(N, S) direction it came from, in the robot's frame [rad]."""
    distance: Array
    """(N, S) measured distance of its sender [mm]."""
    led: Array
    """(N, S) int32, LED number in the message."""
    priority: Array
    """(N, S) bool, priority flag in the message."""
    dust: VectorMemory
    """(N, S) vectors to dust in the messages, in their senders' frames."""
    dump: VectorMemory
    """(N, S) vectors to the dump in the messages."""
    sees_wall: Array
    """(N, 4) bool, a wall reflects the light of this side's LED."""
    at_dust: Array
    """(N,) bool, a ball lies beside or beneath the robot."""
    ball_vector: Array
    """(N, 2) where it lies, in the robot's frame [mm]."""
    on_dump: Array
    """(N,) bool, the robot stands on the dump."""
    is_loaded: Array
    """(N,) bool, the robot holds a ball."""
    grasp_failed: Array
    """(N,) bool, the robot tried to lift a ball in this step and the ball stayed."""


class Command(NamedTuple):
    """What N robots do in one control step: first turn, then walk."""

    turn: Array
    """(N,) anticlockwise [rad]."""
    forward: Array
    """(N,) [mm], negative backwards."""


def rules_of(genome: Genome) -> Rules:
    """Return the genome's values as JAX scalars, so that another genome needs no compilation."""
    return Rules(*(jnp.asarray(v, bool if isinstance(v, bool) else jnp.float32) for v in astuple(genome)))


def init(n_robots: int, n_scouts: Array) -> RobotMemory:
    """Return the memories at the start: no vectors, the first `n_scouts` robots are scouts."""
    return RobotMemory(VectorMemory.empty(n_robots), VectorMemory.empty(n_robots), jnp.arange(n_robots) < n_scouts)


def priority_flag(rules: Rules, memory: RobotMemory, is_loaded: Array) -> Array:
    """Whether each robot sends the priority flag (N,)."""
    return (memory.is_scout & rules.priority_signal_scouts) | (is_loaded & rules.priority_signal_loaded)


def may_pick(config: SwarmConfig, memory: RobotMemory) -> Array:
    """Whether each robot picks up dust (N,)."""
    return ~memory.is_scout | config.strategy.scouts_pick


def act(
    config: SwarmConfig, probe_reach: float, rules: Rules, memory: RobotMemory, observation: Observation, key: Array
) -> tuple[RobotMemory, Command]:
    """Advance the memories of N robots by one control step, and decide what they do.

    Args:
        config: limits of the drive, open parameters of the strategy.
        probe_reach: distance of the probe's tip ahead of the robot's centre [mm].
        rules: the genome.
        memory: memories from the step before.
        observation: what the robots sense now.
        key: random key of this world and step.
    """
    draw = _chances(memory, observation, key)
    memory = _remember(config, rules, memory, observation, draw)
    desired_direction, limit, follows = choose(config, rules, memory, observation, draw[:, 1], draw[:, 2])
    command = steer(
        config, desired_direction + avoid(config, rules, observation, follows), limit, leftwards=draw[:, 3] < 0.5
    )
    command = approach(config, probe_reach, may_pick(config, memory), observation, command)
    moved = (command.turn, command.forward)
    return memory._replace(dust=after_motion(memory.dust, *moved), dump=after_motion(memory.dump, *moved)), command


def listen(config: SwarmConfig, rules: Rules, memory: RobotMemory, observation: Observation, key: Array) -> RobotMemory:
    """Advance the memories as `act` does, up to what the robots know before they move."""
    return _remember(config, rules, memory, observation, _chances(memory, observation, key))


def _chances(memory: RobotMemory, observation: Observation, key: Array) -> Array:
    """Draw a step's random numbers (N, 4 + 2 S) in [0, 1)."""
    n_sides = observation.is_heard.shape[1]
    return jax.random.uniform(key, (len(memory.is_scout), 4 + 2 * n_sides))


def _remember(
    config: SwarmConfig, rules: Rules, memory: RobotMemory, observation: Observation, draw: Array
) -> RobotMemory:
    """Memories after forgetting, listening, feeling the floor and, if so configured, finding nothing."""
    memory = learn(rules, memory, observation, forgets=draw[:, 0] < rules.p_vector_forget, choice=draw[:, 4:])
    if config.strategy.forget_on_arrival:
        memory = memory._replace(
            dust=forget_unconfirmed(config, memory.dust, observation.at_dust),
            dump=forget_unconfirmed(config, memory.dump, observation.on_dump),
        )
    return memory


def learn(rules: Rules, memory: RobotMemory, observation: Observation, forgets: Array, choice: Array) -> RobotMemory:
    """Memories after forgetting, listening, and feeling the floor.

    Args:
        forgets: (N,) bool, the robot forgets both vectors first.
        choice: (N, 2 S) random numbers that settle which of several equal offers is taken.
    """
    n_sides = observation.is_heard.shape[1]

    def listen(own: VectorMemory, sent: VectorMemory, choice: Array) -> VectorMemory:
        offers = heard(sent, observation.bearing, observation.distance, observation.led).where(observation.is_heard)
        return take_over(own.where(~forgets), offers, rules.use_hop_count, choice)

    return memory._replace(
        dust=standing_on(listen(memory.dust, observation.dust, choice[:, :n_sides]), observation.at_dust),
        dump=standing_on(listen(memory.dump, observation.dump, choice[:, n_sides:]), observation.on_dump),
    )


def forget_unconfirmed(config: SwarmConfig, memory: VectorMemory, is_there: Array) -> VectorMemory:
    """Memories without the vectors that led to nothing: too short to follow, and the target is not there."""
    return memory.where(is_there | _leads_on(config, _length(memory.vector)))


def choose(
    config: SwarmConfig, rules: Rules, memory: RobotMemory, observation: Observation, whim: Array, wander: Array
) -> tuple[Array, Array, Array]:
    """Where the robots want to go, as unit vectors (N, 2); how far at most (N,) [mm]; whether they follow a vector.

    Empty workers follow their vector to dust, loaded robots theirs to the dump, with the genome's weights as
    probabilities; otherwise, and always as scouts, robots move at random. A vector shorter than half a step leads
    nowhere: its robot has arrived.

    Args:
        whim: (N,) in [0, 1), follow the vector or not.
        wander: (N,) in [0, 1), the direction of a random move.
    """
    loaded = observation.is_loaded
    vector = jnp.where(loaded[:, None], memory.dump.vector, memory.dust.vector)
    length = _length(vector)
    known = jnp.where(loaded, memory.dump.known, memory.dust.known) & _leads_on(config, length)
    weight = jnp.where(loaded, rules.weight_find_dump, rules.weight_find_dust)
    follows = known & ~memory.is_scout & (whim < weight)
    angle = jnp.deg2rad(config.strategy.random_turn) * (2.0 * wander - 1.0)
    at_random = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
    desired_direction = jnp.where(follows[:, None], vector / jnp.maximum(length, 1e-6)[:, None], at_random)
    return desired_direction, jnp.where(follows, length, jnp.inf), follows


def avoid(config: SwarmConfig, rules: Rules, observation: Observation, follows: Array) -> Array:
    """Push (N, 2) away from neighbours that are heard too near, and from walls unless a vector is followed."""
    options = config.strategy
    near = observation.distance / mm_from_rd(config.optics.communication_radius)
    weight = jnp.where(observation.priority, options.priority_factor, 1.0) * observation.is_heard
    push = repulsion(
        observation.bearing, near, kept_distance(rules, observation.is_loaded, observation.priority), weight
    )
    side = jnp.arange(observation.sees_wall.shape[1]) * (math.pi / 2)
    outward = jnp.stack([jnp.cos(side), jnp.sin(side)], axis=-1)
    walls = -(observation.sees_wall & ~follows[:, None]).astype(jnp.float32) @ outward
    return options.avoidance_gain * push + options.wall_gain * walls


def steer(config: SwarmConfig, direction: Array, limit: Array, leftwards: Array) -> Command:
    """Turn towards `direction` (N, 2), then walk; slower where pushes cancel or the turn is not yet complete.

    A neighbour straight ahead, as sectors tell it, pushes a robot exactly backwards. Which way round it then turns
    is its own choice, `leftwards` (N,) bool, and not that of a rounding error.
    """
    x, y = direction[:, 0], direction[:, 1]
    straight_back = (x < 0) & (jnp.abs(y) < -1e-4 * x)
    angle = jnp.where(straight_back, jnp.where(leftwards, jnp.pi, -jnp.pi), jnp.arctan2(y, x))
    turn = _limited_turn(config, angle)
    pace = jnp.clip(_length(direction), 0.0, 1.0) * jnp.clip(jnp.cos(angle - turn), 0.0, 1.0)
    return Command(turn, jnp.minimum(pace * mm_from_rd(config.drive.step_length), limit))


def approach(
    config: SwarmConfig, probe_reach: float, picks: Array, observation: Observation, command: Command
) -> Command:
    """Bring the probe's tip over the ball that an empty robot senses; others go on with `command`."""
    approaches = observation.at_dust & picks & ~observation.is_loaded & ~observation.grasp_failed
    x, y = observation.ball_vector[:, 0], observation.ball_vector[:, 1]
    angle = jnp.arctan2(y, x)
    turn = _limited_turn(config, angle)
    step = mm_from_rd(config.drive.step_length)
    forward = jnp.where(turn == angle, jnp.clip(_length(observation.ball_vector) - probe_reach, -step, step), 0.0)
    return Command(jnp.where(approaches, turn, command.turn), jnp.where(approaches, forward, command.forward))


def _length(vector: Array) -> Array:
    """Lengths (N,) of vectors (N, 2)."""
    return jnp.hypot(vector[:, 0], vector[:, 1])


def _leads_on(config: SwarmConfig, length: Array) -> Array:
    """Whether a vector of this length (N,) [mm] is worth following: its end is more than half a step away."""
    return length > 0.5 * mm_from_rd(config.drive.step_length)


def _limited_turn(config: SwarmConfig, angle: Array) -> Array:
    """Turn of at most `drive.max_turn` towards `angle` [rad]."""
    limit = math.radians(config.drive.max_turn)
    return jnp.clip(angle, -limit, limit)
