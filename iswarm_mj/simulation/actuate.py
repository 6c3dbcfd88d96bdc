"""Drives: they limit commands, add errors, keep robots out of taken cells, and draw energy."""

import math
from functools import partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.config.static import StaticConfig, StaticDrive
from iswarm_mj.engines.base import TURN_PARTS, Phase
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.simulation import power
from iswarm_mj.simulation.state import SwarmState
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.fusion import fusion_barrier
from iswarm_mj.utils.rng import draw
from iswarm_mj.utils.units import mm_from_rd

MAX_CELLS = 2048
"""Number of cells of 1 rd in a row, more than in the largest arena."""

MAX_BOX_VELOCITY = (5.0, 5.0, 0.5)
"""Greatest velocities of driven boxes [mm/s, mm/s, rad/s], so that they pass through no robot."""


class DriveInputs(NamedTuple):
    """State of N robots on which the outcome of their commands depends."""

    swarm: SwarmState
    """State with the task advanced and the capacitors charged."""
    waits: Bool[Array, "N"]
    """Robots that stand still in this step."""
    poses: Float[Array, "N 3"]
    """Poses as the step begins: x, y [mm] and yaw [rad]."""
    is_present: Bool[Array, "N"]
    """Places that hold a robot; the others are empty."""
    tool_voltage_squared: Float[Array, "N"]
    """Sum of V^2 over the attempts of each robot in this step, see `tasks.base.Sensed` [V^2]."""


class DriveOutput(NamedTuple):
    """Commands of N robots as their drives carry them out."""

    command: Command
    """Motion with the actuators' errors, within the limits; zero for dead and waiting robots."""
    shortfall: Float[Array, "*B N"]
    """Commanded distance that the drive does not walk [mm], without the actuators' errors.

    The robot knows it."""
    is_blocked: Bool[Array, "*B N"]
    """Robots that stay where they are since another one is in their way."""
    is_refused: Bool[Array, "*B N"]
    """Robots whose command was not finite, which is a fault."""
    energy: Float[Array, "*B N"] | None
    """Energy left in the capacitors after the step [J]; None where robots have none."""


def actuate(
    config: StaticConfig, conditions: Conditions, command: Command, inputs: DriveInputs, key: Array
) -> DriveOutput:
    """Return how the drives of N robots of a world carry out their commands.

    Args:
        config: longest step, largest turn, costs.
        conditions: errors of the actuators.
        command: turns [rad] and distances [mm].
        inputs: state of the robots: who can move, and where they are.
        key: random key of the errors.
    """
    # Dead and waiting robots stand still, whatever they command.
    acts = inputs.swarm.is_alive & ~inputs.waits
    is_refused = acts & ~(jnp.isfinite(command.turn) & jnp.isfinite(command.forward))
    # Robots that command no motion at all do not err either.
    moves = (command.turn != 0.0) | (command.forward != 0.0)

    limited = _limited(config, conditions, command, inputs.swarm.is_loaded)
    is_blocked = jnp.zeros(len(command.forward), bool)
    if config.drive.locations == "cells":
        is_blocked = acts & enters_taken_cell(inputs.poses, inputs.is_present, limited)
        limited = limited._replace(forward=jnp.where(is_blocked, 0.0, limited.forward))

    actual = _with_errors(config, conditions, limited, acts=acts, moves=moves, key=key)

    return DriveOutput(
        command=actual,
        energy=_energy_left(config, actual, inputs),
        shortfall=command.forward - jnp.where(acts, limited.forward, 0.0),
        is_blocked=is_blocked,
        is_refused=is_refused,
    )


def _limited(
    config: StaticConfig, conditions: Conditions, command: Command, is_loaded: Bool[Array, "N"]
) -> Command:
    """Return commands within the limits: turns take time from walks, and loads slow robots down."""
    max_turn = math.radians(config.drive.max_turn)
    step_length = mm_from_rd(config.step_length)

    turn_fraction = jnp.minimum(jnp.abs(command.turn) / max_turn, 1.0)
    walk_share = 1.0 - conditions.turn_share * turn_fraction
    reach = step_length * walk_share * jnp.where(is_loaded, conditions.loaded_speed, 1.0)

    turn = jnp.clip(command.turn, -max_turn, max_turn)
    forward = jnp.clip(command.forward, -reach, reach)
    return Command(turn, forward)


def _with_errors(
    config: StaticConfig,
    conditions: Conditions,
    command: Command,
    *,
    acts: Bool[Array, "N"],
    moves: Bool[Array, "N"],
    key: Array,
) -> Command:
    """Return motions with errors, within the limits; zero for robots that do not act."""
    # The barrier keeps XLA from drawing the numbers again in each loop that uses them.
    draw_errors = partial(_draw_errors, len(command.forward))
    turn_error, walk_factor = fusion_barrier(
        draw_errors, conditions.error_turn, conditions.error_step, key
    )
    turn = command.turn + jnp.where(moves, turn_error, 0.0)
    forward = command.forward * walk_factor
    turn = jnp.where(acts, turn, 0.0)
    forward = jnp.where(acts, forward, 0.0)

    max_turn = math.radians(config.drive.max_turn)
    step_length = mm_from_rd(config.step_length)
    turn = jnp.clip(turn, -max_turn, max_turn)
    forward = jnp.clip(forward, -step_length, step_length)
    return Command(turn, forward)


def _draw_errors(
    n_robots: int, error_turn: Array, error_step: Array, key: Array
) -> tuple[Float[Array, "N"], Float[Array, "N"]]:
    """Return what actuators add to turns [rad], and by what they multiply distances."""
    (turn_normal,), (walk_normal,) = draw(key, (n_robots,), n_normal=1).normal
    return jnp.deg2rad(error_turn) * turn_normal, 1.0 + error_step * walk_normal


def _energy_left(
    config: StaticConfig, command: Command, inputs: DriveInputs
) -> Float[Array, "N"] | None:
    """Return the energy left in the capacitors after the step [J]; None where robots have none."""
    swarm = inputs.swarm
    if swarm.energy is None:
        return None
    led_power = swarm.is_alive
    if swarm.led_power is not None:
        led_power = led_power * swarm.led_power
    return power.energy_after_step(
        config=config,
        energy=swarm.energy,
        command=command,
        tool_voltage_squared=inputs.tool_voltage_squared,
        led_power=led_power,
    )


def enters_taken_cell(
    poses: Float[Array, "N 3"], is_present: Bool[Array, "N"], command: Command
) -> Bool[Array, "N"]:
    """Return which robots would enter a cell of 1 rd in which a robot stands as the step begins."""
    yaw = poses[:, 2] + command.turn
    heading = jnp.stack([jnp.cos(yaw), jnp.sin(yaw)], axis=-1)
    step = command.forward[:, None] * heading
    cell_before = _cell_number(poses[:, :2])
    cell_after = _cell_number(poses[:, :2] + step)

    # Look the cells up in the sorted list of those that are taken. Empty places take none.
    no_cell = -(MAX_CELLS**2)
    taken_cells = jnp.sort(jnp.where(is_present, cell_before, no_cell))
    place = jnp.minimum(jnp.searchsorted(taken_cells, cell_after), len(taken_cells) - 1)
    is_taken = taken_cells[place] == cell_after
    return is_taken & (cell_after != cell_before)


def _cell_number(xy: Float[Array, "N 2"]) -> Int[Array, "N"]:
    """Return one number for the cell of 1 rd that holds each point [mm]."""
    column, row = jnp.round(xy / mm_from_rd(1.0)).astype(jnp.int32).T
    return column * MAX_CELLS + row


def velocity_towards(
    drive: StaticDrive,
    is_driven: Bool[Array, "*B M"],
    target_poses: Array | None,
    box_poses: Array | None,
) -> Array | None:
    """Return the velocities that take driven boxes towards their targets in a control step.

    They reach their targets unless that needs more than `MAX_BOX_VELOCITY`.

    Args:
        drive: duration of a control step.
        is_driven: boxes of mass 0; the others have no velocity of their own.
        target_poses: target of each box (*B, M, 3), x, y [mm] and yaw [rad]; None if the task
            drives none. A target that is not finite gives a velocity that is not finite, which is a
            fault.
        box_poses: pose of each box (*B, M, 3); None if there are none.

    Returns:
        Velocities (*B, M, 3) [mm/s, mm/s, rad/s]; None if nothing is driven.
    """
    if target_poses is None or box_poses is None:
        return None
    xp = array_module(box_poses)
    max_velocity = np.array(MAX_BOX_VELOCITY)
    duration = (drive.turn_substeps + drive.walk_substeps) * drive.timestep

    target = xp.where(xp.isfinite(target_poses), target_poses, xp.nan)
    displacement = xp.where(xp.asarray(is_driven)[..., None], target - box_poses, 0.0)
    velocity = xp.clip(displacement / duration, -max_velocity, max_velocity)
    return velocity.astype(box_poses.dtype)


def drive_phases(
    drive: StaticDrive, command: Command, box_velocity: Array | None = None
) -> tuple[Phase, Phase]:
    """Return the two phases of a motion: a turn on the spot, then a walk straight ahead.

    A robot that a contact turns while it walks keeps its direction over the ground until the next
    control step.

    Args:
        drive: durations of the phases.
        command: turns [rad] and distances [mm] (*B, N).
        box_velocity: velocities of driven boxes, see `Phase.boxes`.
    """
    xp = array_module(command.turn)

    def turn_velocity(poses: Array) -> Array:
        """Return the velocities of robots that turn on the spot."""
        yaw_rate = command.turn / (drive.turn_substeps * drive.timestep)
        zero = xp.zeros_like(yaw_rate)
        return xp.stack([zero, zero, yaw_rate], axis=-1)

    def walk_velocity(poses: Array) -> Array:
        """Return the velocities of robots that walk along their heading."""
        speed = command.forward / (drive.walk_substeps * drive.timestep)
        yaw = poses[..., 2]
        return xp.stack([speed * xp.cos(yaw), speed * xp.sin(yaw), xp.zeros_like(yaw)], axis=-1)

    turn = Phase(drive.turn_substeps, turn_velocity, box_velocity, TURN_PARTS)
    walk = Phase(drive.walk_substeps, walk_velocity, box_velocity)
    return turn, walk
