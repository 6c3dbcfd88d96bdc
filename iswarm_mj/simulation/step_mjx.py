"""The control step of one world in MJX: sense, decide, drive, count. Pure; `vmap` makes it a batch."""

from typing import NamedTuple

import jax
import jax.numpy as jnp

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.mjx.api import mjx
from iswarm_mj.engines.mjx.arena import MjxArena
from iswarm_mj.engines.mjx.motion import Bodies, Phase, advance, overlapping
from iswarm_mj.engines.mjx.sight import see
from iswarm_mj.sensors.links import Links
from iswarm_mj.simulation import step as swarm
from iswarm_mj.simulation.step import SwarmState
from iswarm_mj.simulation.worlds import Given
from iswarm_mj.strategy.controller import Command
from iswarm_mj.utils.arrays import Array

NOT_FINITE, OUTSIDE = 4, 8
"""Bits of a fault, beside those of `engines.mjx_motion`."""


class Fault(NamedTuple):
    """The first thing that went wrong in a world, and stays."""

    bits: Array
    """int32, 0 for nothing."""
    step: Array
    """int32, the control step."""
    robot: Array
    """int32, the first robot concerned; meaningless where there was no room for contacts."""


class WorldState(NamedTuple):
    """Everything that changes in one world."""

    bodies: Bodies
    swarm: SwarmState
    touching: Array
    """(N, N) bool, pairs in contact, upper triangle."""
    collisions: Array
    """int32, counted so far."""
    is_finished: Array
    """bool, the goal is reached."""
    finished_at: Array
    """int32, at this control step, if so."""
    fault: Fault


class StepRecord(NamedTuple):
    """What is kept of one step of one world that is recorded."""

    poses: Array
    """(N, 3) after the step."""
    swarm: SwarmState
    links: Links
    has_priority: Array
    """(N,) bool."""
    collisions: Array
    """So far."""
    speed: Array
    """Mean distance of the robots in this step, per second [mm/s]."""
    is_running: Array
    """bool, the world took this step."""


def control_step(
    config: SwarmConfig, arena: MjxArena, model: mjx.Model, given: Given, state: WorldState, step: Array, last: Array
) -> tuple[WorldState, StepRecord]:
    """Take one control step, unless the world is finished or faulty, or the run over.

    Args:
        config: everything that is not evolved.
        arena: compiled.
        model: `arena.model`, or one without the robots that are absent.
        given: strategy, conditions and random key of this world.
        state: before.
        step: number of this step, from 0.
        last: number of steps of the run.
    """
    bodies, swarm_state = state.bodies, state.swarm
    is_running = ~state.is_finished & (state.fault.bits == 0) & (step < last)
    links, sees_wall = see(config, arena, bodies.poses, swarm_state.is_alive, given.is_present)
    swarm_state, command, priority = swarm.decide(
        config,
        arena.probe,
        given.conditions,
        given.strategy,
        swarm_state,
        bodies.poses,
        links,
        sees_wall,
        step,
        given.key,
    )
    bodies, touching, overflow = drive(config, arena, model, bodies, command)
    touching &= given.is_present & given.is_present[:, None]
    reached = swarm_state.balls.is_delivered.sum() >= given.goal
    new = WorldState(
        bodies, swarm_state, touching,
        state.collisions + (touching & ~state.touching).sum(dtype=jnp.int32),
        reached, jnp.where(reached, step + 1, 0).astype(jnp.int32),
        _fault(arena, bodies.poses, overflow, given.is_present, step + 1),
    )  # fmt: skip
    moved = jnp.sqrt(((bodies.poses - state.bodies.poses)[:, :2] ** 2).sum(axis=-1))
    speed = jnp.where(given.is_present, moved, 0).sum() / given.is_present.sum() / config.drive.control_period
    new = jax.tree.map(lambda new, old: jnp.where(is_running, new, old), new, state)
    return new, StepRecord(new.bodies.poses, new.swarm, links, priority, new.collisions, speed, is_running)


def drive(
    config: SwarmConfig, arena: MjxArena, model: mjx.Model, bodies: Bodies, command: Command
) -> tuple[Bodies, Array, Array]:
    """Turn on the spot, then walk ahead, along the heading as it is then; see `swarm.drive`.

    Returns:
        The bodies; which pairs of robots touch after the turn or after the walk (N, N) bool; bits of overflow.
    """
    options = config.drive

    def spin(poses: Array) -> Array:
        rate = command.turn / (options.turn_substeps * options.timestep)
        return jnp.zeros_like(poses).at[:, 2].set(rate)

    def walk(poses: Array) -> Array:
        speed, yaw = command.forward / (options.walk_substeps * options.timestep), poses[:, 2]
        return jnp.stack([speed * jnp.cos(yaw), speed * jnp.sin(yaw), jnp.zeros_like(yaw)], axis=-1)

    phases = Phase(options.turn_substeps, spin), Phase(options.walk_substeps, walk)
    bodies, motion = advance(arena, model, bodies, phases)
    return (
        bodies,
        overlapping(motion.before[0], arena.robot) | overlapping(motion.before[1], arena.robot),
        motion.overflow,
    )


def _fault(arena: MjxArena, poses: Array, overflow: Array, is_present: Array, step: Array) -> Fault:
    not_finite = ~jnp.isfinite(poses).all(axis=-1) & is_present
    outside = (jnp.abs(poses[:, :2]).max(axis=-1) >= arena.edge) & is_present & ~not_finite
    bits = overflow | jnp.where(not_finite.any(), NOT_FINITE, 0) | jnp.where(outside.any(), OUTSIDE, 0)
    robot = jnp.argmax(not_finite | outside)
    return Fault(bits.astype(jnp.int32), jnp.where(bits != 0, step, 0).astype(jnp.int32), robot.astype(jnp.int32))
