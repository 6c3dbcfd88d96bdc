"""The vector-based strategy with scouts: what robots say and do, given what they sense (section 4 of the paper).

Pure functions over an axis of N robots. A robot knows its own memory, what its photodiodes receive, and what lies
under it; it knows neither its position nor its heading. S is the number of its sides, 4 in the paper.
"""

import math
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.geometry.directions import wrapped
from iswarm_mj.geometry.robot import PAPER_SIDES, SIDES, Sides
from iswarm_mj.sensors.memory import VectorMemory
from iswarm_mj.strategy.avoidance import is_avoided, kept_distances, listening_sides, repulsion
from iswarm_mj.strategy.interface import Command, Observation
from iswarm_mj.strategy.rules import Rules
from iswarm_mj.strategy.vectors import adopt, arrived, best_offer, heard
from iswarm_mj.utils import rng
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import mm_from_rd


class RobotMemory(NamedTuple):
    """What N robots carry over from one control step to the next."""

    dust: VectorMemory
    """Vector to dust."""
    dump: VectorMemory
    """Vector to the dump."""
    is_scout: Bool[Array, "N"]
    """Scouts explore at random and never follow a vector."""


class Draws(NamedTuple):
    """Random numbers in [0, 1) for one control step of N robots."""

    forget: Float[Array, "N"]
    """Whether the robot forgets its vectors."""
    follow: Float[Array, "N"]
    """Whether it follows the one that it needs."""
    direction: Float[Array, "N"]
    """Where it goes if it moves at random."""
    side: Float[Array, "N"]
    """Which way round it turns when pushed straight back."""
    dust_tie: Float[Array, "N S"]
    """Which of several equally good vectors to dust it adopts."""
    dump_tie: Float[Array, "N S"]
    """The same for the dump."""
    odometry: Float[Array, "N 2"]
    """Errors of the turn and of the step that it believes it made, standard normal."""


class Target(NamedTuple):
    """Where N robots want to go."""

    direction: Float[Array, "N 2"]
    """Unit vectors in the robots' frames."""
    limit: Float[Array, "N"]
    """Distance to go at most [mm]."""
    follows: Bool[Array, "N"]
    """The robot follows a vector, and does not move at random."""


def draw(n_robots: int, n_sides: int, key: Array) -> Draws:
    """Draw the random numbers of a step."""
    (one, other), (turn, step) = rng.draw(key, (n_robots,), n_uniform=2 + n_sides, n_normal=1)
    return Draws(one[0], other[0], one[1], other[1], one[2:].T, other[2:].T, jnp.stack([turn[0], step[0]], axis=-1))


def learn(
    rules: Rules, memory: RobotMemory, observation: Observation, draws: Draws, sides: Sides = PAPER_SIDES
) -> RobotMemory:
    """Memories after forgetting, listening, and sensing the floor."""
    forgets = draws.forget < rules.p_vector_forget

    def listen(own: VectorMemory, sent: VectorMemory, tie: Array) -> VectorMemory:
        sent = sent._replace(known=sent.known & observation.is_heard)
        side = best_offer(sent.hop, sent.known, rules.use_hop_count, tie)
        message = sent, observation.bearing, observation.distance, observation.led
        vector, bearing, distance, led = jax.tree.map(lambda a: a[jnp.arange(len(side)), side], message)
        return adopt(own.where(~forgets), heard(vector, bearing, distance, led, sides), rules.use_hop_count)

    return memory._replace(
        dust=arrived(listen(memory.dust, observation.payload["dust"], draws.dust_tie), observation.at_dust),
        dump=arrived(listen(memory.dump, observation.payload["dump"], draws.dump_tie), observation.on_dump),
    )


def forget_unconfirmed(
    config: StaticConfig, rules: Rules, memory: VectorMemory, is_there: Bool[Array, "N"]
) -> VectorMemory:
    """Memories without the vectors that are too short to follow although the target `is_there` not, if so ruled."""
    return memory.where(is_there | _can_be_followed(config, _length(memory.vector)) | ~rules.forget_on_arrival)


def choose(config: StaticConfig, rules: Rules, memory: RobotMemory, observation: Observation, draws: Draws) -> Target:
    """Where the robots want to go.

    Empty workers follow their vector to dust, loaded robots theirs to the dump, with the genome's weights as
    probabilities; otherwise, and always as scouts, robots move at random. A vector shorter than half a step is not
    followed: its robot has arrived.
    """
    loaded = observation.is_loaded
    vector = jnp.where(loaded[:, None], memory.dump.vector, memory.dust.vector)
    length = _length(vector)
    known = jnp.where(loaded, memory.dump.known, memory.dust.known) & _can_be_followed(config, length)
    weight = jnp.where(loaded, rules.weight_find_dump, rules.weight_find_dust)
    follows = known & ~memory.is_scout & (draws.follow < weight)
    angle = jnp.deg2rad(rules.random_turn) * (2.0 * draws.direction - 1.0)
    at_random = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
    direction = jnp.where(follows[:, None], vector / jnp.maximum(length, 1e-6)[:, None], at_random)
    return Target(direction, jnp.where(follows, length, jnp.inf), follows)


def approaching(picks: Bool[Array, "N"], observation: Observation) -> Bool[Array, "N"]:
    """Which robots approach the ball that they sense: empty ones that may pick it up and have not failed to."""
    return observation.at_dust & picks & ~observation.is_loaded & ~observation.grasp_failed


def towards_ball(target: Target, approaches: Bool[Array, "N"], ball_vector: Float[Array, "N 2"]) -> Target:
    """The target, but for robots that approach a ball: they want to go there, `ball_vector` [mm]."""
    length = _length(ball_vector)
    direction = jnp.where(approaches[:, None], ball_vector / jnp.maximum(length, 1e-6)[:, None], target.direction)
    return Target(direction, jnp.where(approaches, length, target.limit), target.follows)


def avoid(
    config: StaticConfig, rules: Rules, observation: Observation, follows: Bool[Array, "N"], sides: Sides = PAPER_SIDES
) -> Float[Array, "N 2"]:
    """Push away from neighbours that are too near, and from walls unless the robot `follows` a vector."""
    distance = observation.distance / mm_from_rd(config.optics.communication_radius)
    priority = observation.payload["priority"]
    kept = kept_distances(rules, observation.is_loaded, priority)
    heeded = observation.is_heard & is_avoided(rules, observation.led, sides)
    weight = jnp.where(priority, rules.priority_factor, 1.0) * heeded
    push = repulsion(observation.bearing, distance, kept, weight)
    outward = jnp.asarray(sides.leds)
    if sides.leds == SIDES:
        side = jnp.arange(len(sides)) * (math.pi / 2)
        outward = jnp.stack([jnp.cos(side), jnp.sin(side)], axis=-1)
    in_sight = observation.sees_wall & listening_sides(rules, sides) & ~follows[:, None]
    return rules.avoidance_gain * push - rules.wall_gain * (in_sight.astype(jnp.float32) @ outward)


def steer(
    config: StaticConfig, direction: Float[Array, "N 2"], limit: Float[Array, "N"], prefers_left: Bool[Array, "N"]
) -> Command:
    """Turn towards a direction, then move; slower where pushes cancel or the turn is not yet complete.

    A neighbour straight ahead, as sectors report it, pushes a robot exactly backwards. Which way round it then turns
    is decided by `prefers_left`, and not by a rounding error.

    Args:
        config: limits of the drive.
        direction: in the robots' frames; a length of 1 or more is full speed.
        limit: distance to move at most [mm].
        prefers_left: turn left rather than right where both are equally far.
    """
    x, y = direction[:, 0], direction[:, 1]
    straight_back = (x < 0) & (jnp.abs(y) < -1e-4 * x)
    angle = jnp.where(straight_back, jnp.where(prefers_left, jnp.pi, -jnp.pi), jnp.arctan2(y, x))
    turn = _limited_turn(config, angle)
    pace = jnp.clip(_length(direction), 0.0, 1.0) * jnp.clip(jnp.cos(angle - turn), 0.0, 1.0)
    return Command(turn, jnp.minimum(pace * mm_from_rd(config.step_length), limit))


def approach(
    config: StaticConfig,
    probe_tip: Float[np.ndarray, "N 2"],
    approaches: Bool[Array, "N"],
    ball_vector: Float[Array, "N 2"],
    command: Command,
) -> Command:
    """Move the probe's tip over the ball that a robot approaches; the other robots keep their `command`.

    Args:
        config: limits of the drive.
        probe_tip: position of each probe's tip ahead of and to the left of its robot's centre [mm].
        approaches: the robot approaches a ball.
        ball_vector: from the robot to the ball, in the robot's frame [mm].
        command: without the ball.
    """
    angle = jnp.arctan2(ball_vector[:, 1], ball_vector[:, 0])
    reach, aside = probe_tip.T
    ahead = _length(ball_vector)
    if (aside != 0).any() or (reach < 0).any():  # the ball is to be as far aside as the tip, and behind if the tip is
        askew = jnp.arcsin(jnp.clip(aside / jnp.maximum(ahead, 1e-6), -1.0, 1.0))
        angle = wrapped(angle - jnp.where(reach >= 0, askew, jnp.pi - askew))
        ahead = jnp.sqrt(jnp.maximum(ahead**2 - aside**2, 0.0)) * jnp.where(reach >= 0, 1.0, -1.0)
    turn = _limited_turn(config, angle)
    step = mm_from_rd(config.step_length)
    forward = jnp.where(turn == angle, jnp.clip(ahead - reach, -step, step), 0.0)
    return Command(jnp.where(approaches, turn, command.turn), jnp.where(approaches, forward, command.forward))


def _length(vector: Array) -> Array:
    """Lengths (N,) of vectors (N, 2)."""
    return jnp.hypot(vector[:, 0], vector[:, 1])


def _can_be_followed(config: StaticConfig, length: Array) -> Array:
    """Whether vectors of this length (N,) [mm] are worth following: they end more than half a step away."""
    return length > 0.5 * mm_from_rd(config.step_length)


def _limited_turn(config: StaticConfig, angle: Array) -> Array:
    """Turn of at most `drive.max_turn` towards `angle` (N,) [rad]."""
    limit = math.radians(config.drive.max_turn)
    return jnp.clip(angle, -limit, limit)
