"""The vector-based strategy with scouts: what robots say and do, given what they sense.

Source: Valdastri et al. (2006), section 4. All functions are pure, over an axis of N robots. A
robot knows its own memory, what its photodiodes receive, and what lies under it; it knows neither
its position nor its heading. S is the number of its sides, 4 in the paper. Settings state lengths
in robot diameters [rd], and genomes the distances of avoidance in sensory radii [sr]; vectors are
in mm.
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
from iswarm_mj.strategy.vectors import adopt, mark_arrival, side_of_best_offer, to_receiver_frame
from iswarm_mj.utils import rng
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import mm_from_rd

_STRAIGHT = 1e-4
"""Tangent of the angle to the axis below which a direction counts as along it."""
_TINY = 1e-6
"""Length below which a vector has no direction; keeps divisions finite [mm]."""


class RobotMemory(NamedTuple):
    """Memory of N robots between control steps."""

    dust: VectorMemory
    """Vector to dust."""
    dump: VectorMemory
    """Vector to the dump."""
    is_scout: Bool[Array, "N"]
    """Scouts explore at random and never follow a vector."""


class Draws(NamedTuple):
    """Random numbers of N robots for one control step, in [0, 1) unless stated otherwise."""

    forget: Float[Array, "N"]
    """Decides whether the robot forgets its vectors."""
    follow: Float[Array, "N"]
    """Decides whether the robot follows the vector that it needs."""
    direction: Float[Array, "N"]
    """Direction of a random move."""
    side: Float[Array, "N"]
    """Decides whether a robot that is pushed straight back turns left or right."""
    dust_tie: Float[Array, "N S"]
    """Decides between equally good vectors to dust."""
    dump_tie: Float[Array, "N S"]
    """Decides between equally good vectors to the dump."""
    odometry: Float[Array, "N 2"]
    """Errors with which a robot measures its turn and its step, standard normal."""


class Target(NamedTuple):
    """Directions and distances that N robots want to go."""

    direction: Float[Array, "N 2"]
    """Unit vectors in the robots' frames."""
    limit: Float[Array, "N"]
    """Largest distance to go [mm]."""
    follows: Bool[Array, "N"]
    """The robot follows a vector; otherwise it moves at random."""


def draw(n_robots: int, n_sides: int, key: Array) -> Draws:
    """Draw the random numbers of a control step."""
    # The generator returns two arrays of each kind, (numbers, N), as its words come in pairs. Of
    # uniform numbers each has two decisions of each robot and the ties of one kind of place.
    n_uniform = 2 + n_sides
    uniform, normal = rng.draw(key, (n_robots,), n_uniform=n_uniform, n_normal=1)
    first, second = uniform
    turn_error, step_error = normal
    return Draws(
        forget=first[0],
        follow=second[0],
        direction=first[1],
        side=second[1],
        dust_tie=first[2:].T,
        dump_tie=second[2:].T,
        odometry=jnp.stack([turn_error[0], step_error[0]], axis=-1),
    )


def learn(
    rules: Rules,
    memory: RobotMemory,
    observation: Observation,
    draws: Draws,
    sides: Sides = PAPER_SIDES,
) -> RobotMemory:
    """Return the memories after forgetting, listening, and sensing the floor."""
    forgets = draws.forget < rules.p_vector_forget
    rows = jnp.arange(len(forgets))

    def listen(own: VectorMemory, sent: VectorMemory, tie: Array) -> VectorMemory:
        """Return one kind of vectors after each robot adopted the best that it heard."""
        sent = sent._replace(known=sent.known & observation.is_heard)
        side = side_of_best_offer(sent.hop, sent.known, tie, use_hop_count=rules.use_hop_count)
        sent = jax.tree.map(lambda each_side: each_side[rows, side], sent)
        offer = to_receiver_frame(
            sent,
            bearing=observation.bearing[rows, side],
            distance=observation.distance[rows, side],
            led=observation.led[rows, side],
            sides=sides,
        )
        return adopt(own.where(~forgets), offer, use_hop_count=rules.use_hop_count)

    dust = listen(memory.dust, observation.payload["dust"], draws.dust_tie)
    dump = listen(memory.dump, observation.payload["dump"], draws.dump_tie)
    return memory._replace(
        dust=mark_arrival(dust, observation.at_dust),
        dump=mark_arrival(dump, observation.on_dump),
    )


def forget_unconfirmed(
    config: StaticConfig, rules: Rules, memory: VectorMemory, is_there: Bool[Array, "N"]
) -> VectorMemory:
    """Return the memories without vectors that robots followed to their end and found nothing.

    With `strategy.forget_on_arrival` only; otherwise all vectors stay.

    Args:
        config: length of a step.
        rules: interpretations of the paper.
        memory: vectors to one kind of place.
        is_there: the robot senses the place.
    """
    leads_on = _can_be_followed(config, _length(memory.vector))
    # Rules are arrays also where they are switches: `~` of Python's True is -2.
    return memory.where(is_there | leads_on | ~rules.forget_on_arrival)


def choose_target(
    config: StaticConfig, rules: Rules, memory: RobotMemory, observation: Observation, draws: Draws
) -> Target:
    """Return where the robots want to go.

    Empty workers follow their vector to dust and loaded robots theirs to the dump, with the
    genome's weights as probabilities. Otherwise robots move at random, and scouts always do. A
    vector shorter than half a step is not followed: its robot has arrived.
    """
    is_loaded = observation.is_loaded

    # The vector that each robot needs, and whether it follows it in this step.
    vector = jnp.where(is_loaded[:, None], memory.dump.vector, memory.dust.vector)
    length = _length(vector)
    knows_way = jnp.where(is_loaded, memory.dump.known, memory.dust.known)
    weight = jnp.where(is_loaded, rules.weight_find_dump, rules.weight_find_dust)
    follows = knows_way & _can_be_followed(config, length) & ~memory.is_scout
    follows &= draws.follow < weight

    # A random direction for all others.
    angle = jnp.deg2rad(rules.random_turn) * (2.0 * draws.direction - 1.0)
    random_direction = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)

    along_vector = vector / jnp.maximum(length, _TINY)[:, None]
    return Target(
        direction=jnp.where(follows[:, None], along_vector, random_direction),
        limit=jnp.where(follows, length, jnp.inf),
        follows=follows,
    )


def approaches_ball(picks: Bool[Array, "N"], observation: Observation) -> Bool[Array, "N"]:
    """Return which robots approach the ball that they sense.

    A robot does so if it picks up balls, carries none, and did not just fail to pick one up.

    Args:
        picks: the robot picks up balls within reach of its tool.
        observation: what the robots sense.
    """
    return observation.at_dust & picks & ~observation.is_loaded & ~observation.grasp_failed


def target_ball(
    target: Target,
    approaches: Bool[Array, "N"],
    ball_vector: Float[Array, "N 2"],
) -> Target:
    """Return the targets with the ball as that of robots that approach one.

    Args:
        target: directions and distances that the robots want to go.
        approaches: the robot approaches a ball.
        ball_vector: vector from the robot to the ball, in the robot's frame [mm].
    """
    length = _length(ball_vector)
    to_ball = ball_vector / jnp.maximum(length, _TINY)[:, None]
    return target._replace(
        direction=jnp.where(approaches[:, None], to_ball, target.direction),
        limit=jnp.where(approaches, length, target.limit),
    )


def avoidance_push(
    config: StaticConfig,
    rules: Rules,
    observation: Observation,
    follows: Bool[Array, "N"],
    sides: Sides = PAPER_SIDES,
) -> Float[Array, "N 2"]:
    """Return the push away from neighbours that are too near, and from walls.

    Robots that follow a vector ignore walls.

    Args:
        config: range of the robots' light.
        rules: distances to keep, gains, and interpretations of the paper.
        observation: neighbours and walls in sight.
        follows: the robot follows a vector.
        sides: directions of the robots' LEDs and photodiodes.
    """
    # Neighbours, whose distances the rules state in sensory radii.
    sensory_radius = mm_from_rd(config.optics.communication_radius)
    distance_in_sr = observation.distance / sensory_radius
    priority = observation.payload["priority"]
    distances_to_keep = kept_distances(rules, observation.is_loaded, priority)
    is_obstacle = observation.is_heard & is_avoided(rules, observation.led, sides)
    weight = jnp.where(priority, rules.priority_factor, 1.0) * is_obstacle
    push = repulsion(observation.bearing, distance_in_sr, distances_to_keep, weight)

    # Walls, which lie in the direction of the LED whose light they reflect. The paper's robots have
    # the cosines of right angles in single precision, which are not quite 0 (-4e-8), in place of
    # the exact `SIDES`: recorded runs were made so, and are repeated bit by bit.
    if sides.leds == SIDES:
        angle = jnp.arange(len(sides)) * (math.pi / 2)
        outward = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)
    else:
        outward = jnp.asarray(sides.leds)
    is_wall = observation.sees_wall & listening_sides(rules, sides) & ~follows[:, None]
    into_wall = is_wall.astype(jnp.float32) @ outward

    return rules.avoidance_gain * push - rules.wall_gain * into_wall


def steer(
    config: StaticConfig,
    direction: Float[Array, "N 2"],
    limit: Float[Array, "N"],
    prefers_left: Bool[Array, "N"],
) -> Command:
    """Return the commands that turn robots towards a direction, then move them.

    Robots move slower along a shorter direction, and while the turn is not yet complete.

    A direction straight back is no rare case: bearings are known by sectors only, and so a
    neighbour ahead is often avoided exactly backwards. Which way round a robot then turns is
    decided by `prefers_left`, and not by a rounding error.

    Args:
        config: limits of the drive.
        direction: direction in the robots' frames, a sum of what attracts and repels them; a length
            of 1 or more is full speed.
        limit: largest distance to move [mm].
        prefers_left: turn left rather than right where both are equally far.
    """
    x, y = direction[:, 0], direction[:, 1]
    is_straight_back = (x < 0) & (jnp.abs(y) < -_STRAIGHT * x)
    half_turn = jnp.where(prefers_left, jnp.pi, -jnp.pi)
    angle = jnp.where(is_straight_back, half_turn, jnp.arctan2(y, x))
    turn = _limit_turn(config, angle)

    wanted_share = jnp.clip(_length(direction), 0.0, 1.0)
    share_of_step = wanted_share * jnp.clip(jnp.cos(angle - turn), 0.0, 1.0)
    return Command(turn, jnp.minimum(share_of_step * mm_from_rd(config.step_length), limit))


def approach_ball(
    config: StaticConfig,
    probe_tip: Float[np.ndarray, "N 2"],
    approaches: Bool[Array, "N"],
    ball_vector: Float[Array, "N 2"],
    command: Command,
) -> Command:
    """Return commands that bring the probe's tip over the ball; other robots keep their `command`.

    Args:
        config: limits of the drive.
        probe_tip: position of each probe's tip ahead of and to the left of its robot's centre [mm].
        approaches: the robot approaches a ball.
        ball_vector: vector from the robot to the ball, in the robot's frame [mm].
        command: commands of robots that approach no ball.
    """
    angle = jnp.arctan2(ball_vector[:, 1], ball_vector[:, 0])
    ahead = _length(ball_vector)
    tip_ahead, tip_left = probe_tip.T

    # A tip beside the axis is reached by turning until the ball is as far aside as the tip is, a
    # tip behind the centre by turning the back to the ball. Tips are NumPy arrays, known as the
    # program is compiled, so that robots without such tips do not pay for it.
    if (tip_left != 0).any() or (tip_ahead < 0).any():
        askew = jnp.arcsin(jnp.clip(tip_left / jnp.maximum(ahead, _TINY), -1.0, 1.0))
        angle = wrapped(angle - jnp.where(tip_ahead >= 0, askew, jnp.pi - askew))
        along_axis = jnp.sqrt(jnp.maximum(ahead**2 - tip_left**2, 0.0))
        ahead = along_axis * jnp.where(tip_ahead >= 0, 1.0, -1.0)

    # Move only once the turn is complete: an angle within the limit is returned as it is.
    turn = _limit_turn(config, angle)
    step = mm_from_rd(config.step_length)
    forward = jnp.where(turn == angle, jnp.clip(ahead - tip_ahead, -step, step), 0.0)
    return Command(
        turn=jnp.where(approaches, turn, command.turn),
        forward=jnp.where(approaches, forward, command.forward),
    )


def _length(vector: Float[Array, "N 2"]) -> Float[Array, "N"]:
    """Return the lengths of vectors."""
    return jnp.hypot(vector[:, 0], vector[:, 1])


def _can_be_followed(config: StaticConfig, length: Float[Array, "N"]) -> Bool[Array, "N"]:
    """Return whether vectors of this length [mm] end more than half a step away."""
    return length > 0.5 * mm_from_rd(config.step_length)


def _limit_turn(config: StaticConfig, angle: Float[Array, "N"]) -> Float[Array, "N"]:
    """Return turns of at most `drive.max_turn` towards an angle [rad]."""
    limit = math.radians(config.drive.max_turn)
    return jnp.clip(angle, -limit, limit)
