"""What the drives make of commands: errors, limits, robots that stand still, and the energy that all of it takes."""

import math
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float

from iswarm_mj.config import DriveConfig, SwarmConfig
from iswarm_mj.engines.base import Phase
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.simulation import power
from iswarm_mj.simulation.state import SwarmState
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.draws import draw
from iswarm_mj.utils.units import mm_from_rd


class Actuated(NamedTuple):
    """Commands of N robots as their drives carry them out."""

    command: Command
    """With the actuators' errors, within the limits; zero for robots that are dead or wait."""
    is_refused: Bool[Array, "*B N"]
    """The command was not finite."""
    energy: Float[Array, "*B N"] | None
    """Left in the capacitors after the step [J]; None where robots have none."""


def actuate(
    config: SwarmConfig,
    conditions: Conditions,
    command: Command,
    swarm: SwarmState,
    waits: Bool[Array, "N"],
    tool_voltage_squared: Float[Array, "N"],
    key: Array,
) -> Actuated:
    """Carry out what N robots of a world command.

    Args:
        config: longest step, largest turn, costs.
        conditions: errors of the actuators.
        command: turns [rad] and distances [mm].
        swarm: which robots live, and what their capacitors have.
        waits: robots that stand still.
        tool_voltage_squared: see `tasks.protocol.Sensed` [V^2].
        key: of the errors.
    """
    acts = swarm.is_alive & ~waits
    turn, step = math.radians(config.drive.max_turn), mm_from_rd(config.step_length)
    (turning,), (walking,) = draw(key, command.turn.shape, n_normal=1).normal
    moves = (command.turn != 0.0) | (command.forward != 0.0)
    turned = command.turn + jnp.where(moves, jnp.deg2rad(conditions.error_turn) * turning, 0.0)
    slip = conditions.error_step * walking * jnp.clip(command.forward, -step, step)
    turned, walked = (jnp.where(acts, part, 0.0) for part in (turned, command.forward + slip))
    is_refused = ~(jnp.isfinite(turned) & jnp.isfinite(walked))
    done = Command(jnp.clip(turned, -turn, turn), jnp.clip(walked, -step, step))
    energy = swarm.energy
    if energy is not None:
        lit = swarm.is_alive if swarm.led_power is None else swarm.is_alive * swarm.led_power
        energy = power.after(config, energy, done, tool_voltage_squared, lit)
    return Actuated(done, is_refused, energy)


def drive_phases(drive: DriveConfig, command: Command) -> tuple[Phase, Phase]:
    """Turn on the spot, then walk ahead, along the heading as it is then.

    A robot that a contact turns while it walks keeps its direction over the ground until the next control step.

    Args:
        drive: durations of the phases.
        command: turns [rad] and distances [mm] (*B, N).
    """
    xp = array_module(command.turn)

    def spin(poses: Array) -> Array:
        rate = command.turn / (drive.turn_substeps * drive.timestep)
        still = xp.zeros_like(rate)
        return xp.stack([still, still, rate], axis=-1)

    def walk(poses: Array) -> Array:
        speed, yaw = command.forward / (drive.walk_substeps * drive.timestep), poses[..., 2]
        return xp.stack([speed * xp.cos(yaw), speed * xp.sin(yaw), xp.zeros_like(yaw)], axis=-1)

    return Phase(drive.turn_substeps, spin), Phase(drive.walk_substeps, walk)
