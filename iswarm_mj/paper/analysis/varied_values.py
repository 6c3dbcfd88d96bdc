"""Values that experiments vary, and by which statements tell their runs apart."""

from dataclasses import replace

from iswarm_mj.config.swarm import DriveConfig
from iswarm_mj.utils.errors import ConfigError

SWARMS = ("type1", "type2")
"""Types of swarms of the paper."""
DEFAULT = "default"
"""Group and choice of the runs of the default, in the study of choices."""

INSTANT_MESSAGES = "no time"
"""Setting in which messages take no time, in the study of message times."""
TIMED_MESSAGES = (
    "30000 bit/s",
    "2000 bit/s",
    "1000 bit/s",
    "30000 bit/s, all photodiodes on",
)
"""Settings in which messages take time, in the study of message times."""

HUMIDITIES = (10.0, 30.0, 50.0)
"""Relative humidities, in the study of grasps [%]."""
VOLTAGES = (30.0, 40.0, 55.0)
"""Voltages of the tool while it lifts, in the study of grasps [V]; balls are released at the
configuration's voltage."""
BALANCE = "quasi-static"
"""Resolution of grasps that are decided by the balance of forces."""
TRIALS = "dynamic"
"""Resolution of grasps that are decided by trials on the bench."""

SUBSTEPS = {2: (1, 1), 5: (2, 3), 10: (4, 6), 20: (8, 12), 50: (20, 30), 100: (40, 60)}
"""Physics steps of the turn and of the walk, by their number in a control step of 1 s, in the study
of time steps; the drive refuses some."""
FINEST_RATE = max(SUBSTEPS)
"""Largest number of physics steps in a control step."""


def drive_with_rate(drive: DriveConfig, rate: int) -> DriveConfig:
    """Return a drive with so many physics steps in a control step.

    Raises:
        ConfigError: the drive refuses them.
    """
    turn_substeps, walk_substeps = SUBSTEPS[rate]
    return replace(drive, turn_substeps=turn_substeps, walk_substeps=walk_substeps)


def refused_rates(drive: DriveConfig) -> dict[int, str]:
    """Return the numbers of physics steps that a drive refuses, with the texts of its errors."""
    errors = {}
    for rate in SUBSTEPS:
        try:
            drive_with_rate(drive, rate)
        except ConfigError as error:
            errors[rate] = str(error)
    return errors
