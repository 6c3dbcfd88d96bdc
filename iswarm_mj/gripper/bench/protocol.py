"""The motion and the voltage of the tool in a trial: distances, speeds, limits.

Source: section 3.2.3 for the sequence, the contact, the 5 um gap and the 50 V without contact. Speeds, durations and
the criterion of a lift are choices: slow enough that half the speed changes no voltage by 1 %.
"""

import math
from dataclasses import dataclass, fields

from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import UserError


@dataclass(frozen=True)
class Protocol:
    """Speeds and limits of a trial. SI units."""

    start_gap: float = 5e-6
    """Between tool and ball before the approach [m]."""
    approach_time: float = 0.3e-3
    """[s]"""
    press: float = 25e-9
    """Depth below first touch to which the tool is driven; the ball sinks by less, so that the tool touches it [m]."""
    dwell: float = 0.05e-3
    """At rest after the approach, and before the release ramp [s]."""
    rise_time: float = 0.05e-3
    """Time in which the voltage of a rung rises, with the tool in contact [s]."""
    peel: float = 10e-9
    """Height above first touch up to which the tool retracts slowly, since one of the contacts opens there [m]."""
    peel_time: float = 0.3e-3
    """[s]"""
    lift: float = 0.3e-6
    """Height above first touch at which the trial checks whether the ball came along [m]."""
    acceleration: float = 40.0
    """Greatest acceleration of a tool that carries a ball, which only adhesion holds [m/s^2]."""
    off_time: float = 0.05e-3
    """Time in which the voltage falls to zero with the ball lifted [s]."""
    away: float = 0.2e-6
    """Distance from plate or tool beyond which a ball counts as lifted or released [m]."""
    step_voltage: float = 0.25
    """Between two rungs of the staircase [V]."""
    grasp_limit: float = 80.0
    """Highest rung [V]."""
    ramp_rate: float = 40e3
    """Rate of the voltage in the release ramp and without contact [V/s]."""
    release_limit: float = 120.0
    """End of the release ramp [V]."""
    no_contact_limit: float = 50.0
    """End of the ramp without contact [V]."""
    watch_time: float = 0.01e-3
    """Interval at which a ramp is checked, hence its longest overrun after the ball left [s]."""
    flight_limit: float = 2e-3
    """Time of flight after which a ball counts as lost [s]."""
    rest_time: float = 0.2e-3
    """Time for which a landed ball is observed [s]."""

    def __post_init__(self):
        for field in fields(self):
            value, (low, high) = getattr(self, field.name), allowed(field.name)
            if not low <= value <= high:
                raise UserError(
                    f"{field.name} of the protocol was {value}; it must be between {low:g} and {high:g}: "
                    "give such a value."
                )
        for small, large in (("peel", "lift"), ("away", "lift"), ("step_voltage", "grasp_limit")):
            if getattr(self, small) >= getattr(self, large):
                raise UserError(
                    f"{small} of the protocol was {getattr(self, small)}; it must be below its {large}, "
                    f"{getattr(self, large)}: give a smaller {small} or a larger {large}."
                )

    @property
    def highest_rung(self) -> int:
        """Index of the last rung of the staircase; rung 0 is without voltage."""
        return math.floor(self.grasp_limit / self.step_voltage + 1e-9)

    def carry_time(self, distance: float) -> float:
        """Time to move by a distance [m] with the protocol's acceleration, along `minimum_jerk` [s]."""
        return (_PEAK * abs(distance) / self.acceleration) ** 0.5

    def slowed(self, factor: float) -> "Protocol":
        """The same protocol with all speeds divided by a factor."""
        times = ("approach_time", "dwell", "rise_time", "peel_time", "off_time", "rest_time")
        changed = {name: getattr(self, name) * factor for name in times}
        kept = {field.name: getattr(self, field.name) for field in fields(self) if field.name not in times}
        kept |= {"ramp_rate": self.ramp_rate / factor, "acceleration": self.acceleration / factor**2}
        return Protocol(**kept, **changed)


_TIME, _VOLTAGE = (1e-6, 0.1), (0.1, 200.0)
_ALLOWED = {
    "start_gap": (0.1e-6, 40e-6),
    "press": (1e-9, 1e-6),
    "peel": (1e-9, 5e-6),
    "lift": (10e-9, 5e-6),
    "away": (1e-9, 0.4e-6),
    "acceleration": (0.01, 1e4),
    "step_voltage": (2e-3, 200.0),
    "ramp_rate": (1e3, 1e7),
    "watch_time": (1e-6, 1e-3),
}


def allowed(name: str) -> tuple[float, float]:
    """Least and greatest value of a field of `Protocol`, beyond which a trial never ends or shows nothing."""
    return _ALLOWED.get(name, _VOLTAGE if name.endswith("_limit") and name != "flight_limit" else _TIME)


_PEAK = 10 / 3**0.5
"""Greatest acceleration of `minimum_jerk`, in distance over time squared."""


def minimum_jerk(share: Array) -> Array:
    """Fraction of the path at a fraction s of the time, 10 s^3 - 15 s^4 + 6 s^5.

    Source: Flash and Hogan 1985. Speed and acceleration vanish at both ends.
    """
    return share**3 * (10 + share * (6 * share - 15))
