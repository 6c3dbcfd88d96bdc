"""One trial: a ball on the bench, its contacts, and the works of adhesion that it draws."""

import math
from typing import Annotated, NamedTuple

import numpy as np

from iswarm_mj.gripper.laws.adhesion import humidity_factor
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
from iswarm_mj.gripper.laws.melting import Supply
from iswarm_mj.gripper.laws.restitution import MODULUS_PLATE, MODULUS_PROBE, YIELD_PRESSURE
from iswarm_mj.utils.constraints import Above, Within


class Contacts(NamedTuple):
    """Conduction and impacts of a ball between tool and plate. SI units.

    None of the values is the paper's. Oxide and breakdown are fitted: a field of 1 GV/m, that of
    thin alumina, breaks 70 nm at the 70 V at which a ball melted. The leak is a choice within the
    window in which a trial works, given its duration (`tests/gripper/test_circuit.py`): the charge
    of a ball must stay while it is lifted, and flow off while it hangs.
    """

    leak: Annotated[float, Within(0, 1e18, "Ohm")] = 60e9
    """Resistance of the touching tool's oxide [Ohm].

    0: no circuit; the ball has the plate's potential during the lift, and the tool's once the
    voltage is off.
    """
    contact: Annotated[float, Above(0, 1e18, "Ohm")] = 1e3
    """Resistance of the tool's contact after breakdown [Ohm]; a choice."""
    plate_contact: Annotated[float, Above(0, 1e18, "Ohm")] = 1e3
    """Resistance of the plate's contact [Ohm]; a choice."""
    oxide: Annotated[float, Within(0, 1e-6, "m")] = 70e-9
    """Thickness of the tool's oxide where it touches [m]; 0: none."""
    breakdown: Annotated[float, Above(0, 1e12, "V/m")] = 1e9
    """Field that breaks the oxide [V/m]."""
    restitution: Annotated[float | None, Within(0, 1)] = None
    """Restitution of impacts without adhesion; None: by plastic yield; 0: balls do not rebound."""
    rolling: Annotated[float, Within(1e-10, 1e-6, "m")] = 1e-9
    """Torque that resists rolling, over the force of the contact [m]; a choice."""
    yield_pressure: Annotated[float, Above(0, 1e12, "Pa")] = YIELD_PRESSURE
    """Contact pressure at which a ball yields [Pa]."""
    plate_modulus: Annotated[float, Above(0, 1e13, "Pa")] = MODULUS_PLATE
    """Reduced modulus of ball and plate [Pa]."""
    probe_modulus: Annotated[float, Above(0, 1e13, "Pa")] = MODULUS_PROBE
    """Reduced modulus of ball and tool [Pa]."""

    @property
    def breaks_at(self) -> float:
        """Voltage that breaks the oxide of a tool on a ball on the plate [V].

        Infinity without a circuit.
        """
        return self.oxide * self.breakdown if self.leak > 0 else math.inf

    @property
    def supply(self) -> Supply:
        """Supply that heats a ball on the plate through a broken oxide.

        The plate's contact is in series with the resistance of the supply.
        """
        usual = Supply()
        return usual._replace(
            resistance=usual.resistance + self.plate_contact,
            contact=self.contact,
        )


class Trial(NamedTuple):
    """One ball on the bench and its surroundings. SI units."""

    radius: float
    """Radius of the ball [m]."""
    work_tool_object: float
    """W_TO of this trial at 10 % RH [J/m^2]."""
    work_object_substrate: float
    """W_OS of this trial at 10 % RH [J/m^2]."""
    relative_humidity: float = 10.0
    """Relative humidity [%]."""
    contact_gap: float = CONTACT_GAP
    """Effective electrical gap of a touching tool [m]."""
    probe_radius: float = PROBE_RADIUS
    """Radius of the tool [m]."""
    density: float = BALL_DENSITY
    """Density of the ball [kg/m^3]."""
    misalignment: float = 0.0
    """Lateral offset of the tool's axis from the ball's [m]."""
    contacts: Contacts = Contacts()
    """Conduction and impacts."""
    tip: str | None = None
    """File of the table of the tip's forces, see `tips.table`; None: a flat tip."""


def draw(
    seed: int,
    radius: float,
    relative_humidity: float,
    repeat: int,
    humidity_spread: float = 0.0,
    spreads: tuple[float, float] = (VARIATION_TOOL_OBJECT, VARIATION_OBJECT_SUBSTRATE),
) -> Trial:
    """Draw a trial's works of adhesion and its humidity, which depend on these arguments alone.

    The calibrated works and their spreads are those of a chamber set to 10 % RH
    (`laws.detachment`), which includes its deviations: mean and variance of their humidity factor
    are taken out of the works at exactly 10 %.

    Args:
        seed: of all draws.
        radius: of the ball [m].
        relative_humidity: of the setting [%].
        repeat: number of the trial at this radius and humidity.
        humidity_spread: largest deviation of the humidity from the setting, drawn uniformly [%].
        spreads: coefficients of variation of the works to tool and plate at 10 % RH.
    """
    identity = [seed, round(radius * 1e12), round(relative_humidity * 1e6), repeat]
    random = np.random.default_rng(identity)
    normal = random.standard_normal(2)

    # Medians and spreads at exactly 10 %.
    factor = humidity_factor(10.0 + humidity_spread * np.linspace(-1, 1, 1001))
    works = np.array([WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE]) / factor.mean()
    variations = np.array(spreads)
    of_humidity = (factor.std() / factor.mean()) ** 2
    variations = np.sqrt(np.maximum(variations**2 - of_humidity, 0.0))
    works = np.asarray(scattered_work(works, variations, normal))
    work_tool_object, work_object_substrate = works.tolist()

    deviation = humidity_spread * random.uniform(-1, 1)
    return Trial(
        radius=radius,
        work_tool_object=work_tool_object,
        work_object_substrate=work_object_substrate,
        relative_humidity=float(np.clip(relative_humidity + deviation, 0, 100)),
    )
