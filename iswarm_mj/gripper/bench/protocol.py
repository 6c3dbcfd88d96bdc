"""The motion and the voltage of the tool in a trial: distances, speeds, limits.

A trial goes through these phases:

1. Attempts without contact: the tool stops at a gap above the ball, and the voltage rises along a
   ramp (`no_contact_...`).
2. The tool approaches the ball, presses on it and dwells.
3. Staircase of grasps. At each rung the tool touches the ball, the voltage rises, the tool retracts
   slowly while the contact may open (`peel`) and then up to the `lift`, and the voltage is
   switched off. The lowest rung whose voltage lifts the ball is searched.
4. Adhesion alone holds the lifted ball. The tool carries it to the height of release, and to the
   target aside if there is one (`transport`); there it hangs until its charge has relaxed.
5. Release: the voltage rises along a ramp until the plate pulls the ball off the tool.
6. The ball falls or flies, and counts as landed once it has rested.

Source: section 3.2.3 for the sequence, the contact, the 5 um gap and the 50 V without contact.
Speeds, durations and the criterion of a lift are choices: slow enough that half the speed changes
no voltage by 1 %.
"""

import math
from dataclasses import dataclass
from typing import Annotated, Literal, NamedTuple

from iswarm_mj.gripper.laws.detachment import RELEASE_GAP
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.constraints import Within, check, validate

Duration = Annotated[float, Within(1e-6, 0.1, "s")]
Voltage = Annotated[float, Within(0.1, 200.0, "V")]


@dataclass(frozen=True)
class Protocol:
    """Speeds and limits of a trial, in SI units."""

    start_gap: Annotated[float, Within(0.1e-6, 40e-6, "m")] = 5e-6
    """Gap between tool and ball before the approach [m]."""
    approach_time: Duration = 0.3e-3
    """Duration of the approach [s]."""
    press: Annotated[float, Within(1e-9, 1e-6, "m")] = 25e-9
    """Depth below first touch to which the tool presses [m]."""
    dwell: Duration = 0.05e-3
    """Pause after the approach [s]."""
    rise_time: Duration = 0.05e-3
    """Rise time of the voltage, with the tool in contact [s]."""
    peel: Annotated[float, Within(1e-9, 5e-6, "m")] = 10e-9
    """Height above first touch up to which the tool retracts slowly, while a contact opens [m]."""
    peel_time: Duration = 0.3e-3
    """Duration of the slow retraction up to `peel` [s]."""
    lift: Annotated[float, Within(10e-9, 5e-6, "m")] = 0.3e-6
    """Height above first touch at which the trial checks whether the ball was lifted [m]."""
    acceleration: Annotated[float, Within(0.01, 1e4, "m/s^2")] = 40.0
    """Largest acceleration of a tool that raises or lowers a ball by adhesion only [m/s^2]."""
    transport: Annotated[float, Within(0, 500e-6, "m")] = 0.0
    """Distance of the target aside, to which the tool carries a lifted ball before release [m]."""
    transport_acceleration: Annotated[float, Within(0.01, 1e3, "m/s^2")] = 0.5
    """Largest acceleration towards the target; with more a ball rolls along the tool [m/s^2]."""
    off_time: Duration = 0.05e-3
    """Fall time of the voltage once a ball is grasped and lifted [s]."""
    away: Annotated[float, Within(1e-9, 0.4e-6, "m")] = 0.2e-6
    """Distance from plate or tool beyond which a ball counts as lifted or released [m]."""
    hold_time: Duration = 3e-3
    """Time for which a lifted ball hangs before the ramp, so that its charge relaxes [s]."""
    step_voltage: Annotated[float, Within(2e-3, 200.0, "V")] = 0.25
    """Voltage between two rungs of the staircase [V]."""
    grasp_limit: Voltage = 80.0
    """Voltage that no rung exceeds [V]."""
    ramp_rate: Annotated[float, Within(1e3, 1e7, "V/s")] = 2.5e3
    """Rate of the release ramp; the ball's voltage lags by the relaxation time [V/s]."""
    no_contact_rate: Annotated[float, Within(1e3, 1e7, "V/s")] = 40e3
    """Rate of the voltage in attempts without contact [V/s]."""
    release_limit: Voltage = 120.0
    """End of the release ramp [V]."""
    after_release: Literal["cut", "held"] = "cut"
    """The voltage is cut or held once a ball has left the tool; the paper does not say which."""
    cut_delay: Annotated[float, Within(0, 0.1, "s")] = 0.0
    """Delay from detecting that the ball left (beyond `away`) to the start of the cut [s]."""
    cut_time: Duration = 0.05e-3
    """Fall time of the voltage at the cut [s]."""
    no_contact_limit: Voltage = 50.0
    """End of the ramp without contact [V]."""
    watch_time: Annotated[float, Within(1e-6, 1e-3, "s")] = 0.01e-3
    """Interval between checks of a ramp [s]."""
    flight_limit: Duration = 20e-3
    """Time after which a ball that does not come to rest counts as lost [s]."""
    rest_time: Duration = 0.2e-3
    """Time that a landed ball must rest [s]."""

    def __post_init__(self):
        validate(self, "protocol")
        for small, large in (("peel", "lift"), ("away", "lift"), ("step_voltage", "grasp_limit")):
            value, bound = getattr(self, small), getattr(self, large)
            check(f"protocol.{small}", value, f"below `protocol.{large}`, {bound:g}", value < bound)

    @property
    def highest_rung(self) -> int:
        """Index of the last rung of the staircase; rung 0 is without voltage."""
        return math.floor(self.grasp_limit / self.step_voltage + 1e-9)

    @property
    def contact_time(self) -> float:
        """Longest time for which the tool keeps a ball on the plate under a rung's voltage [s]."""
        return self.rise_time + self.peel_time

    def carry_time(self, distance: float) -> float:
        """Return the time to move by a distance [m] with the protocol's acceleration [s].

        The tool moves along `minimum_jerk`.
        """
        return (_PEAK * abs(distance) / self.acceleration) ** 0.5

    @property
    def transport_time(self) -> float:
        """Time to move to the target, along `minimum_jerk` [s]."""
        return (_PEAK * self.transport / self.transport_acceleration) ** 0.5


_PEAK = 10 / 3**0.5
"""Greatest acceleration of `minimum_jerk`, in distance over time squared."""


def minimum_jerk(share: Array) -> Array:
    """Return the fraction of the path at a fraction s of the time, 10 s^3 - 15 s^4 + 6 s^5.

    Source: Flash and Hogan 1985. Speed and acceleration vanish at both ends.
    """
    return share**3 * (10 + share * (6 * share - 15))


class Gaps(NamedTuple):
    """Gaps at which each trial is repeated."""

    release: tuple[float, ...] = (RELEASE_GAP,)
    """Gaps between ball and plate at the release [m]."""
    no_contact: tuple[float, ...] = ()
    """Gaps between tool and ball in attempts without contact [m]."""


PAPER_GAPS = Gaps()
"""Gaps of the paper's experiments."""
