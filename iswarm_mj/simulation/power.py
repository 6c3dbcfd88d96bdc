"""What robots draw from their capacitors, and what light puts in."""

import jax.numpy as jnp
from jaxtyping import Bool, Float

from iswarm_mj.config.energy import EnergyConfig
from iswarm_mj.config.static import StaticConfig
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import mm_from_rd


def charged(config: StaticConfig, energy: Float[Array, "N"]) -> Float[Array, "N"]:
    """Energies after a control step in the light [J]."""
    income = config.energy.light_power * config.drive.control_period
    return jnp.minimum(energy + income, config.energy.full)


def voltage(config: EnergyConfig, energy: Float[Array, "N"]) -> Float[Array, "N"]:
    """Voltages of capacitors, (2 E / C)^(1/2) [V]."""
    return jnp.sqrt(2 * energy / config.capacitance)


def can_act(config: StaticConfig, energy: Float[Array, "N"]) -> Bool[Array, "N"]:
    """Whether each robot has the energy of one control step, messages and a walk; otherwise it waits for light."""
    return energy >= config.energy.of_step(config.drive.control_period)


def is_emitting(
    config: StaticConfig, is_alive: Bool[Array, "*B N"], energy: Float[Array, "*B N"] | None
) -> Bool[Array, "*B N"]:
    """Robots that light their LEDs in a control step: all that live and do not wait for energy.

    Args:
        config: costs, and the light.
        is_alive: the others are dark.
        energy: as the step before ended [J]; None where robots have no capacitors.
    """
    return is_alive if energy is None else is_alive & can_act(config, charged(config, energy))


def energy_after_step(
    config: StaticConfig,
    energy: Float[Array, "N"],
    command: Command,
    tool_voltage_squared: Float[Array, "N"],
    lit: Bool[Array, "N"] | Float[Array, "N"],
) -> Float[Array, "N"]:
    """Energies of N robots after a control step: without motion, messages, and a tool's charge C V^2 in each attempt.

    Args:
        config: costs, and the greatest motion in a control step.
        energy: with what light put in [J].
        command: motion.
        tool_voltage_squared: sum of V^2 over the attempts of each robot [V^2].
        lit: which robots light their LEDs, or their power from 0 to 1; those that wait for energy do not.
    """
    costs, drive = config.energy, config.drive
    turned = jnp.abs(command.turn) / jnp.deg2rad(drive.max_turn) * drive.turn_substeps
    walked = jnp.abs(command.forward) / mm_from_rd(config.step_length) * drive.walk_substeps
    moving = (turned + walked) * drive.timestep * costs.walking_power
    tools = tool_voltage_squared * costs.tool_capacitance
    messages = costs.message_energy * lit * can_act(config, energy)
    return jnp.maximum(energy - moving - messages - tools, 0.0)
