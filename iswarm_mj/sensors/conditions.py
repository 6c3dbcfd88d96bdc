"""Noise, voltages and places of a world: what may differ between worlds of one run, beside the robots' rules."""

from typing import NamedTuple

from iswarm_mj.config import SwarmConfig
from iswarm_mj.utils.arrays import Array


class Conditions(NamedTuple):
    """What the surroundings of one world are like, as scalars, or of B worlds, as arrays (B,); named as in the
    configuration."""

    error_distance_measure: Array
    """Relative standard deviation of a measured distance."""
    error_in_communication: Array
    """Probability that a message arrives with a wrong bit."""
    independent_bit_errors: Array
    """Bits flip independently."""
    parity_check: Array
    """Messages whose check is wrong are ignored."""
    p_communication_break: Array
    """Probability that a message does not arrive."""
    drop_rate: Array
    """Probability per control step that a held ball falls."""
    grasp_voltage: Array
    """Voltage while lifting a ball [V]."""
    release_voltage: Array
    """Voltage while releasing a ball [V]."""
    spread_tool_object: Array
    """Coefficient of variation of the work of adhesion between tool and ball, from attempt to attempt."""
    spread_object_substrate: Array
    """Coefficient of variation of the work of adhesion between ball and floor, from attempt to attempt."""
    error_turn: Array
    """Standard deviation of a turn [deg]."""
    error_step: Array
    """Relative standard deviation of a walk's length."""
    dump_size: Array
    """Edge of the dump [rd]."""
    dust_range: Array
    """Distance within which a robot senses a ball [rd]."""


def conditions_of(config: SwarmConfig) -> Conditions:
    """Return the conditions that a configuration sets, as floats and Booleans."""
    parts = config.optics, config.gripper, config.drive, config.arena, config.strategy
    settings = {name: value for part in parts for name, value in vars(part).items()}
    return Conditions(*(settings[name] for name in Conditions._fields))
