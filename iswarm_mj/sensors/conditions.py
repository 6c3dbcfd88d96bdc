"""Noise, voltages and places of a world as arrays: settings in which worlds of a run may differ."""

from typing import Any, NamedTuple

from jaxtyping import Bool, Float

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.utils.arrays import Array


class Conditions(NamedTuple):
    """Surroundings of one world as scalars, or of B worlds as arrays (B,).

    Each field is the setting of the same name, in the unit of that setting. A task may change them
    from step to step (`Task.conditions`). The robots' rules are `strategy.rules.Rules`.
    """

    dump_size: Float[Array, "*B"]
    """Edge of the square dump [rd]."""
    error_turn: Float[Array, "*B"]
    """Standard deviation of an executed turn about its command [deg]."""
    error_step: Float[Array, "*B"]
    """Relative standard deviation of the distance walked."""
    stop_share: Float[Array, "*B"]
    """Probability per step that a robot stays where it is."""
    turn_share: Float[Array, "*B"]
    """Share of a step that the largest turn takes."""
    loaded_speed: Float[Array, "*B"]
    """Speed of a robot that carries a ball, relative to that of others."""
    error_distance_measure: Float[Array, "*B"]
    """Relative standard deviation of a measured distance."""
    error_in_communication: Float[Array, "*B"]
    """Probability that a message arrives with a wrong bit."""
    independent_bit_errors: Bool[Array, "*B"]
    """Bits flip independently."""
    parity_check: Bool[Array, "*B"]
    """Robots discard messages that fail their check."""
    p_communication_break: Float[Array, "*B"]
    """Probability per step that a link fails."""
    grasp_voltage: Float[Array, "*B"]
    """Voltage for picking up a ball [V]."""
    release_voltage: Float[Array, "*B"]
    """Voltage for releasing a ball [V]."""
    spread_tool_object: Float[Array, "*B"]
    """Coefficient of variation of the work of adhesion between tool and ball."""
    spread_object_substrate: Float[Array, "*B"]
    """Coefficient of variation of the work of adhesion between ball and floor."""
    drop_rate: Float[Array, "*B"]
    """Probability per step that a carried ball falls."""
    dust_range: Float[Array, "*B"]
    """Distance within which a robot senses a ball [rd]."""
    error_in_sensing: Float[Array, "*B"]
    """Probability per step that a robot senses neither dust nor dump."""


def conditions_of(config: SwarmConfig) -> Conditions:
    """Return the conditions that a configuration sets, as floats and Booleans."""
    drive = config.drive
    optics = config.optics
    gripper = config.gripper
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
