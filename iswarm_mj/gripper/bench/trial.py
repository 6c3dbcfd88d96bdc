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
from iswarm_mj.gripper.laws.humidity import humidity_factor


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


def draw(seed: int, radius: float, relative_humidity: float, repeat: int, humidity_spread: float = 0.0) -> Trial:
    """Trial with works of adhesion and a humidity scattered by a draw that depends on these arguments alone.

    The calibrated works and their spreads are those of a chamber set to 10 % RH (`laws.detachment`), to which its
    deviations belong: mean and variance of their humidity factor are taken out of the works at exactly 10 %.

    Args:
        seed: of all draws.
        radius: of the ball [m].
        relative_humidity: of the setting [%].
        repeat: which of the trials at this radius and humidity.
        humidity_spread: largest deviation of the trial's humidity from the setting, uniformly drawn [%].
    """
    identity = [seed, round(radius * 1e12), round(relative_humidity * 1e6), repeat]
    random = np.random.default_rng(identity)
    normal = random.standard_normal(2)
    factor = humidity_factor(10.0 + humidity_spread * np.linspace(-1, 1, 1001))
    works = np.array([WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE]) / factor.mean()
    variations = np.array([VARIATION_TOOL_OBJECT, VARIATION_OBJECT_SUBSTRATE])
    variations = np.sqrt(variations**2 - (factor.std() / factor.mean()) ** 2)
    tool, substrate = np.asarray(scattered_work(works, variations, normal)).tolist()
    return Trial(
        radius,
        tool,
        substrate,
        float(np.clip(relative_humidity + humidity_spread * random.uniform(-1, 1), 0, 100)),
    )
