"""Settings of the energy on board."""

from dataclasses import dataclass
from typing import Annotated, Literal

from iswarm_mj.utils.constraints import Needs, Within, check, validate

_WITH_CAPACITOR = Needs("model", ("capacitor",))


@dataclass(frozen=True)
class EnergyConfig:
    """Capacitor on board that light charges, and its consumers.

    The paper names "a capacitor up to the desired voltage level" of 20 to 40 V and negligible costs
    of manipulation (section 5); it gives no capacitance, no power and no cost of walking and LEDs.
    All values are choices.
    """

    model: Literal["none", "capacitor"] = "none"
    """Robots have unlimited energy (`none`), or what is left in their capacitor (`capacitor`)."""
    capacitance: Annotated[float, Within(1e-9, 1e-3, "F"), _WITH_CAPACITOR] = 1e-6
    """Capacitance [F]."""
    largest_voltage: Annotated[float, Within(1, 69, "V"), _WITH_CAPACITOR] = 60.0
    """Voltage to which light charges the capacitor, and voltage at the start [V]."""
    light_power: Annotated[float, Within(0, 1, "W"), _WITH_CAPACITOR] = 0.48e-3
    """Charging power [W]: a solar cell of 4 mm^2 and 12 % efficiency in 1000 W/m^2 of
    sunlight."""
    walking_power: Annotated[float, Within(0, 1, "W"), _WITH_CAPACITOR] = 0.3e-3
    """Power of walking at full speed or turning at full rate [W]."""
    message_energy: Annotated[float, Within(0, 1e-3, "J"), _WITH_CAPACITOR] = 80e-6
    """Energy of the LEDs per control step [J]: 1 mW for 20 ms on each of four sides."""
    tool_capacitance: Annotated[float, Within(0, 1e-6, "F"), _WITH_CAPACITOR] = 10e-12
    """Capacitance of tool and leads, charged in each attempt [F]; the ball adds some 10 fF."""

    def __post_init__(self):
        validate(self, "energy")

    @property
    def full(self) -> float:
        """Energy of a full capacitor, C V^2 / 2 [J]."""
        return self.capacitance * self.largest_voltage**2 / 2

    def of_step(self, period: float) -> float:
        """Return the energy that a robot needs in a control step, for messages and a walk [J].

        Args:
            period: duration of the control step [s].
        """
        return self.message_energy + self.walking_power * period

    def check_step(self, period: float) -> None:
        """Raise a ConfigError if robots can never act in a control step of this period [s]."""
        energy = self.of_step(period)
        voltage = self.largest_voltage
        least = 2 * energy / voltage**2
        limit = (
            f"at least {least:.3g} F with `energy.largest_voltage` {voltage:g}, "
            f"for the {energy:g} J of a control step"
        )
        is_enough = self.model == "none" or self.capacitance >= least
        check("energy.capacitance", self.capacitance, limit, is_enough)
