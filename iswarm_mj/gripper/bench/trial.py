"""One trial: a ball on the bench, and the works of adhesion that it draws."""

from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.bench.contacts import Contacts
from iswarm_mj.gripper.laws.detachment import (
    BALL_DENSITY,
    CONTACT_GAP,
    PROBE_RADIUS,
    VARIATION_OBJECT_SUBSTRATE,
    VARIATION_TOOL_OBJECT,
    WORK_OBJECT_SUBSTRATE,
    WORK_TOOL_OBJECT,
    scattered_work,
)


class Trial(NamedTuple):
    """One ball on the bench and its surroundings. SI units."""

    radius: float
    """[m]"""
    work_tool_object: float
    """W_TO of this trial at 10 % RH [J/m^2]."""
    work_object_substrate: float
    """W_OS of this trial at 10 % RH [J/m^2]."""
    relative_humidity: float = 10.0
    """[%]"""
    contact_gap: float = CONTACT_GAP
    """Effective electrical gap of a touching tool [m]."""
    probe_radius: float = PROBE_RADIUS
    """[m]"""
    density: float = BALL_DENSITY
    """Of the ball [kg/m^3]."""
    misalignment: float = 0.0
    """Lateral offset of the tool's axis from the ball's [m]."""
    contacts: Contacts = Contacts()
    """Conduction and impacts."""


def draw(seed: int, radius: float, relative_humidity: float, repeat: int) -> Trial:
    """Trial with works of adhesion scattered by a draw that depends on these arguments alone.

    Args:
        seed: of all draws.
        radius: of the ball [m].
        relative_humidity: [%].
        repeat: which of the trials at this radius and humidity.
    """
    identity = [seed, round(radius * 1e12), round(relative_humidity * 1e6), repeat]
    tool, substrate = np.random.default_rng(identity).standard_normal(2)
    return Trial(
        radius,
        float(scattered_work(WORK_TOOL_OBJECT, VARIATION_TOOL_OBJECT, tool)),
        float(scattered_work(WORK_OBJECT_SUBSTRATE, VARIATION_OBJECT_SUBSTRATE, substrate)),
        relative_humidity,
    )
