"""Energy budget of robots: light charges their capacitors, and control steps draw on them."""

import jax.numpy as jnp
from jaxtyping import Bool, Float

from iswarm_mj.config.energy import EnergyConfig
from iswarm_mj.config.static import StaticConfig
from iswarm_mj.simulation.state import SwarmState
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.units import mm_from_rd


def charged(config: StaticConfig, energy: Float[Array, "N"]) -> Float[Array, "N"]:
    """Return the energies of capacitors after a control step in the light [J]."""
    income = config.energy.light_power * config.drive.control_period
    return jnp.minimum(energy + income, config.energy.full)


def voltage(config: EnergyConfig, energy: Float[Array, "N"]) -> Float[Array, "N"]:
    """Return the voltages of capacitors, (2 E / C)^(1/2) [V]."""
    return jnp.sqrt(2 * energy / config.capacitance)


def can_act(config: StaticConfig, energy: Float[Array, "N"]) -> Bool[Array, "N"]:
    """Return which robots have the energy of a control step; the others wait for light."""
    return energy >= config.energy.of_step(config.drive.control_period)


def is_emitting(
    config: StaticConfig, is_alive: Bool[Array, "*B N"], energy: Float[Array, "*B N"] | None
) -> Bool[Array, "*B N"]:
    """Return which robots light their LEDs: all that live and do not wait for energy.

    Args:
        config: costs of a control step, and the power of the light.
        is_alive: robots that live; dead ones are dark.
        energy: energies at the end of the previous step [J]; None where robots have no capacitors.
    """
    if energy is None:
        return is_alive
    return is_alive & can_act(config, charged(config, energy))


def emitted_light(
    config: StaticConfig, swarm: SwarmState
) -> Bool[Array, "*B N"] | Float[Array, "*B N"]:
    """Return which robots light their LEDs in a control step, or at what power, from 0 to 1."""
    emits = is_emitting(config, swarm.is_alive, swarm.energy)
    if swarm.led_power is None:
        return emits
    return emits * swarm.led_power


def energy_after_step(
    config: StaticConfig,
    energy: Float[Array, "N"],
    command: Command,
    tool_voltage_squared: Float[Array, "N"],
    led_power: Bool[Array, "N"] | Float[Array, "N"],
) -> Float[Array, "N"]:
    """Return the energies left after a control step [J].

    A robot pays for its turn and walk, for messages, and C V^2 for the charge of its tool in each
    attempt.

    Args:
        config: costs, and the greatest motion in a control step.
        energy: energies with what light charged in this step [J].
        command: motion that the drives carry out.
        tool_voltage_squared: sum of V^2 over the attempts of each robot [V^2].
        led_power: robots that light their LEDs, or the power of the LEDs from 0 to 1. Robots that
            wait for energy never light them.
    """
    costs = config.energy
    drive = config.drive

    turn_steps = jnp.abs(command.turn) / jnp.deg2rad(drive.max_turn) * drive.turn_substeps
    walk_steps = jnp.abs(command.forward) / mm_from_rd(config.step_length) * drive.walk_substeps
    motion = (turn_steps + walk_steps) * drive.timestep * costs.walking_power

    tools = tool_voltage_squared * costs.tool_capacitance
    messages = costs.message_energy * led_power * can_act(config, energy)
    return jnp.maximum(energy - motion - messages - tools, 0.0)
