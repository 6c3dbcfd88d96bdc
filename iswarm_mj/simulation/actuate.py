"""What the drives make of commands: errors, limits, robots that stand still, and the energy that all of it takes."""

import math
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from iswarm_mj.config.static import StaticConfig, StaticDrive
from iswarm_mj.engines.base import Phase
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.simulation import power
from iswarm_mj.simulation.state import SwarmState
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.fusion import fusion_barrier
from iswarm_mj.utils.rng import draw
from iswarm_mj.utils.units import mm_from_rd

CELLS = 2048
"""Cells of 1 rd in a row, more than in the largest arena."""


class DriveOutput(NamedTuple):
    """Commands of N robots as their drives carry them out."""

    command: Command
    """With the actuators' errors, within the limits; zero for robots that are dead or wait."""
    shortfall: Float[Array, "*B N"]
    """Distance commanded that the drive does not walk, but for the actuators' errors; the robot knows it [mm]."""
    is_blocked: Bool[Array, "*B N"]
    """The robot stays where it is since another one is in its way."""
    is_refused: Bool[Array, "*B N"]
    """The command was not finite."""
    energy: Float[Array, "*B N"] | None
    """Left in the capacitors after the step [J]; None where robots have none."""


def actuate(
    config: StaticConfig,
    conditions: Conditions,
    command: Command,
    swarm: SwarmState,
    waits: Bool[Array, "N"],
    poses: Float[Array, "N 3"],
    is_present: Bool[Array, "N"],
    tool_voltage_squared: Float[Array, "N"],
    key: Array,
) -> DriveOutput:
    """Carry out what N robots of a world command.

    Args:
        config: longest step, largest turn, costs.
        conditions: errors of the actuators.
        command: turns [rad] and distances [mm].
        swarm: which robots live, and what their capacitors have.
        waits: robots that stand still.
        poses: where robots are as the step begins: x, y [mm] and yaw [rad].
        is_present: the other places are empty.
        tool_voltage_squared: see `tasks.base.Sensed` [V^2].
        key: of the errors.
    """
    acts = swarm.is_alive & ~waits
    turn, step = math.radians(config.drive.max_turn), mm_from_rd(config.step_length)
    is_refused = acts & ~(jnp.isfinite(command.turn) & jnp.isfinite(command.forward))
    moves = (command.turn != 0.0) | (command.forward != 0.0)
    share = 1.0 - conditions.turn_share * jnp.minimum(jnp.abs(command.turn) / turn, 1.0)
    reach = step * share * jnp.where(swarm.is_loaded, conditions.loaded_speed, 1.0)
    wanted = command.forward
    command = Command(jnp.clip(command.turn, -turn, turn), jnp.clip(wanted, -reach, reach))
    is_blocked = jnp.zeros(len(wanted), bool)
    if config.drive.locations == "cells":
        is_blocked = acts & enters_taken_cell(poses, is_present, command)
        command = command._replace(forward=jnp.where(is_blocked, 0.0, command.forward))
    turning, walking = fusion_barrier(partial(_errors, len(wanted)), conditions.error_turn, conditions.error_step, key)
    turned, walked = command.turn + jnp.where(moves, turning, 0.0), command.forward * walking
    turned, walked = (jnp.where(acts, part, 0.0) for part in (turned, walked))
    done = Command(jnp.clip(turned, -turn, turn), jnp.clip(walked, -step, step))
    energy = swarm.energy
    if energy is not None:
        lit = swarm.is_alive if swarm.led_power is None else swarm.is_alive * swarm.led_power
        energy = power.energy_after_step(config, energy, done, tool_voltage_squared, lit)
    return DriveOutput(done, wanted - jnp.where(acts, command.forward, 0.0), is_blocked, is_refused, energy)


def _errors(n_robots: int, error_turn: Array, error_step: Array, key: Array) -> tuple[Array, Array]:
    """What actuators add to turns [rad], and by what they multiply distances."""
    (turning,), (walking,) = draw(key, (n_robots,), n_normal=1).normal
    return jnp.deg2rad(error_turn) * turning, 1.0 + error_step * walking


def enters_taken_cell(poses: Float[Array, "N 3"], is_present: Bool[Array, "N"], command: Command) -> Bool[Array, "N"]:
    """Whether a robot's step would end in another cell of 1 rd than it begins in, where a robot stands as it begins."""
    yaw = poses[:, 2] + command.turn
    step = command.forward[:, None] * jnp.stack([jnp.cos(yaw), jnp.sin(yaw)], axis=-1)

    def cells(xy: Array) -> Array:
        column, row = jnp.round(xy / mm_from_rd(1.0)).astype(jnp.int32).T
        return column * CELLS + row

    now, then = cells(poses[:, :2]), cells(poses[:, :2] + step)
    taken = jnp.sort(jnp.where(is_present, now, -(CELLS**2)))
    found = taken[jnp.minimum(jnp.searchsorted(taken, then), len(taken) - 1)] == then
    return found & (then != now)


FASTEST = (5.0, 5.0, 0.5)
"""Velocities of driven boxes at most [mm/s, mm/s, rad/s], so that they run through no robot."""


def velocity_towards(
    drive: StaticDrive, is_driven: Bool[Array, "*B M"], wanted: Array | None, boxes: Array | None
) -> Array | None:
    """Return the velocities (*B, M, 3) with which driven boxes get to poses in a control step, as far as they can.

    Args:
        drive: duration of a control step.
        is_driven: boxes of mass 0; the others have no velocity of their own.
        wanted: where the boxes are to be (*B, M, 3), x, y [mm] and yaw [rad]; None if the task drives none. A pose that
            is not finite gives a velocity that is not finite, which is a fault.
        boxes: where they are; None if there are none.
    """
    if wanted is None or boxes is None:
        return None
    xp = array_module(boxes)
    largest = np.array(FASTEST)
    duration = (drive.turn_substeps + drive.walk_substeps) * drive.timestep

    target = xp.where(xp.isfinite(wanted), wanted, xp.nan)
    way = xp.where(xp.asarray(is_driven)[..., None], target - boxes, 0.0)
    return xp.clip(way / duration, -largest, largest).astype(boxes.dtype)


def drive_phases(drive: StaticDrive, command: Command, boxes: Array | None = None) -> tuple[Phase, Phase]:
    """Turn on the spot, then walk ahead, along the heading as it is then.

    A robot that a contact turns while it walks keeps its direction over the ground until the next control step.

    Args:
        drive: durations of the phases.
        command: turns [rad] and distances [mm] (*B, N).
        boxes: see `Phase.boxes`.
    """
    xp = array_module(command.turn)

    def spin(poses: Array) -> Array:
        rate = command.turn / (drive.turn_substeps * drive.timestep)
        still = xp.zeros_like(rate)
        return xp.stack([still, still, rate], axis=-1)

    def walk(poses: Array) -> Array:
        speed, yaw = command.forward / (drive.walk_substeps * drive.timestep), poses[..., 2]
        return xp.stack([speed * xp.cos(yaw), speed * xp.sin(yaw), xp.zeros_like(yaw)], axis=-1)

    return Phase(drive.turn_substeps, spin, boxes), Phase(drive.walk_substeps, walk, boxes)
