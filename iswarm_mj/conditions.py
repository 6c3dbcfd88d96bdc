"""What may differ from world to world of a batch beside genome, seed and number of robots."""

from typing import NamedTuple

from iswarm_mj.arrays import Array
from iswarm_mj.config import SwarmConfig


class Conditions(NamedTuple):
    """Noise and voltages of one world, or of many with a leading axis; named as in the configuration."""

    error_distance_measure: Array
    """Standard deviation of a measured distance, relative."""
    error_in_communication: Array
    """Probability that a message arrives with a wrong bit."""
    p_communication_break: Array
    """Probability that a message does not arrive."""
    drop_rate: Array
    """Probability per control step that a held ball falls."""
    grasp_voltage: Array
    """[V]"""
    release_voltage: Array
    """[V]"""


def conditions_of(config: SwarmConfig) -> Conditions:
    """Return what a configuration says, as floats."""
    optics, gripper = config.optics, config.gripper
    return Conditions(
        optics.error_distance_measure, optics.error_in_communication, optics.p_communication_break,
        gripper.drop_rate, gripper.grasp_voltage, gripper.release_voltage,
    )  # fmt: skip
