"""Settings of the energy on board."""

from dataclasses import dataclass
from typing import Annotated, Literal

from iswarm_mj.utils.constraints import Needs, Within, check, validate

_USED = Needs("model", ("capacitor",))


@dataclass(frozen=True)
class EnergyConfig:
    """A capacitor on board that light charges, and its consumers.

    The paper names "a capacitor up to the desired voltage level" of 20 to 40 V and negligible costs
    of manipulation (section 5); it gives no capacitance, no power and no cost of walking and LEDs.
    All values are choices.
    """

    model: Literal["none", "capacitor"] = "none"
    """Robots have unlimited energy, or what is left in their capacitor."""
    capacitance: Annotated[float, Within(1e-9, 1e-3, "F"), _USED] = 1e-6
    """Capacitance [F]."""
    largest_voltage: Annotated[float, Within(1, 69, "V"), _USED] = 60.0
    """Voltage to which light charges it, and at the start [V]."""
    light_power: Annotated[float, Within(0, 1, "W"), _USED] = 0.48e-3
    """Charging power [W]: a cell of 4 mm^2 and 12 % in sunlight of 1000 W/m^2."""
    walking_power: Annotated[float, Within(0, 1, "W"), _USED] = 0.3e-3
    """Power of walking at full speed or turning at full rate [W]."""
    message_energy: Annotated[float, Within(0, 1e-3, "J"), _USED] = 80e-6
    """Energy of the LEDs per control step [J]: 1 mW for 20 ms on each of four sides."""
    tool_capacitance: Annotated[float, Within(0, 1e-6, "F"), _USED] = 10e-12
    """Capacitance of tool and leads, charged in each attempt [F]; the ball adds some 10 fF."""

    def __post_init__(self):
        validate(self, "energy")

    @property
    def full(self) -> float:
        """Energy of a full capacitor, C V^2 / 2 [J]."""
        return self.capacitance * self.largest_voltage**2 / 2

    def of_step(self, period: float) -> float:
        """Energy that a robot needs to act in a control step of this period [s]: messages and a
        walk [J]."""
        return self.message_energy + self.walking_power * period

    def check_step(self, period: float) -> None:
        """Raise a ConfigError if robots can never act in a control step of this period [s]."""
        needed, volts = self.of_step(period), self.largest_voltage
        least = 2 * needed / volts**2
        limit = (
            f"at least {least:.3g} F with `energy.largest_voltage` {volts:g}, "
            f"for the {needed:g} J of a control step"
        )
        check(
            "energy.capacitance",
            self.capacitance,
            limit,
            self.model == "none" or self.capacitance >= least,
        )
