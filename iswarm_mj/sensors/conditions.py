"""Noise, voltages and places of a world: what may differ between worlds of one run, beside the robots' rules."""

from typing import Any, NamedTuple

from jaxtyping import Bool, Float

from iswarm_mj.config import SwarmConfig
from iswarm_mj.utils.arrays import Array


class Conditions(NamedTuple):
    """Surroundings of one world as scalars, or of B worlds as arrays (B,).

    Each field is the setting of the same name, in the unit of that setting. A task may change them from step to step
    (`Task.conditions`).
    """

    dump_size: Float[Array, "*B"]
    """`arena.dump_size` [rd]."""
    error_turn: Float[Array, "*B"]
    """`drive.error_turn` [deg]."""
    error_step: Float[Array, "*B"]
    """`drive.error_step`."""
    stop_share: Float[Array, "*B"]
    """`drive.stop_share`."""
    turn_share: Float[Array, "*B"]
    """`drive.turn_share`."""
    loaded_speed: Float[Array, "*B"]
    """`drive.loaded_speed`."""
    error_distance_measure: Float[Array, "*B"]
    """`optics.error_distance_measure`."""
    error_in_communication: Float[Array, "*B"]
    """`optics.error_in_communication`."""
    independent_bit_errors: Bool[Array, "*B"]
    """`optics.independent_bit_errors`."""
    parity_check: Bool[Array, "*B"]
    """`optics.parity_check`."""
    p_communication_break: Float[Array, "*B"]
    """`optics.p_communication_break`."""
    grasp_voltage: Float[Array, "*B"]
    """`gripper.grasp_voltage` [V]."""
    release_voltage: Float[Array, "*B"]
    """`gripper.release_voltage` [V]."""
    spread_tool_object: Float[Array, "*B"]
    """`gripper.spread_tool_object`."""
    spread_object_substrate: Float[Array, "*B"]
    """`gripper.spread_object_substrate`."""
    drop_rate: Float[Array, "*B"]
    """`gripper.drop_rate`."""
    dust_range: Float[Array, "*B"]
    """`strategy.dust_range` [rd]."""
    error_in_sensing: Float[Array, "*B"]
    """`strategy.error_in_sensing`."""


def conditions_of(config: SwarmConfig) -> Conditions:
    """Return the conditions that a configuration sets, as floats and Booleans."""
    drive, optics, gripper = config.drive, config.optics, config.gripper
    scalars: dict[str, Any] = {
        "dump_size": config.arena.dump_size,
        "error_turn": drive.error_turn,
        "error_step": drive.error_step,
        "stop_share": drive.stop_share,
        "turn_share": drive.turn_share,
        "loaded_speed": drive.loaded_speed,
        "error_distance_measure": optics.error_distance_measure,
        "error_in_communication": optics.error_in_communication,
        "independent_bit_errors": optics.independent_bit_errors,
        "parity_check": optics.parity_check,
        "p_communication_break": optics.p_communication_break,
        "grasp_voltage": gripper.grasp_voltage,
        "release_voltage": gripper.release_voltage,
        "spread_tool_object": gripper.spread_tool_object,
        "spread_object_substrate": gripper.spread_object_substrate,
        "drop_rate": gripper.drop_rate,
        "dust_range": config.strategy.dust_range,
        "error_in_sensing": config.strategy.error_in_sensing,
    }
    return Conditions(**scalars)
