"""Parameters of the laws that a fit estimates, with their priors."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from iswarm_mj.gripper.laws.adhesion import HUMIDITY_DOUBLING, HUMIDITY_FALL
from iswarm_mj.gripper.laws.detachment import CONTACT_GAP
from iswarm_mj.utils.constraints import Within
from iswarm_mj.utils.errors import ConfigError, UserError, closest

_FARTHEST = 30.0
"""Place in a prior up to which values follow it: searches try any, and exponentials overflow."""
NORMAL_95 = 1.96
"""Standard deviations of a normal distribution within which 95 % lie on each side of the mean."""
_POSITIVE = Within(0)


@dataclass(frozen=True)
class Parameter:
    """A parameter and its prior, which is log-normal, or normal where `is_linear`."""

    text: str
    """Words for tables."""
    symbol: str
    unit: str
    """Unit in tables."""
    scale: float
    """That unit in SI."""
    median: float
    """Median of the prior, in SI."""
    factor: float
    """95 % of the prior lie between the median over this factor and the median times it.

    Of a linear parameter: within this distance of the median.
    """
    held: float | None = None
    """Value while the parameter is not estimated; by default the median."""
    limits: Within = _POSITIVE
    """Values that may be held, in SI."""
    is_linear: bool = False

    @property
    def prior_deviation(self) -> float:
        """Standard deviation of the prior, of the logarithm unless `is_linear`."""
        width = self.factor if self.is_linear else math.log(self.factor)
        return width / NORMAL_95

    @property
    def usual(self) -> float:
        """Value while the parameter is not estimated, in SI."""
        return self.median if self.held is None else self.held

    def value_at(self, place: float) -> float:
        """Return the value that lies `place` standard deviations of the prior above its median."""
        place = min(max(place, -_FARTHEST), _FARTHEST)
        if self.is_linear:
            return self.median + self.prior_deviation * place
        return self.median * math.exp(self.prior_deviation * place)

    def place_of(self, value: float) -> float:
        """Return where a value lies in the prior, the inverse of `value_at`."""
        if self.is_linear:
            return (value - self.median) / self.prior_deviation
        return math.log(value / self.median) / self.prior_deviation

    @property
    def prior_text(self) -> str:
        """The prior in words, in the unit of tables."""
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.median / self.scale:.3g}{unit}, within a factor of {self.factor:.3g}"


_LENGTH = Within(1e-10, 1e-5, "m")
_WORK = Within(1e-6, 10.0, "J/m^2")
_SPREAD = Within(0.005, 2.0)

PARAMETERS: dict[str, Parameter] = {
    "work_tool_object": Parameter(
        "work of adhesion to the tool", "W_tool", "mJ/m^2", 1e-3, 5e-3, 20.0, limits=_WORK
    ),
    "work_object_substrate": Parameter(
        "work of adhesion to the plate", "W_plate", "mJ/m^2", 1e-3, 5e-3, 20.0, limits=_WORK
    ),
    "spread_tool_object": Parameter(
        "spread of the work to the tool", "spread_tool", "%", 0.01, 0.15, 2.5, limits=_SPREAD
    ),
    "spread_object_substrate": Parameter(
        "spread of the work to the plate", "spread_plate", "%", 0.01, 0.15, 2.5, limits=_SPREAD
    ),
    "electrical_gap": Parameter(
        "electrical gap in contact", "D_eff", "um", 1e-6, CONTACT_GAP, 4.0, limits=_LENGTH
    ),
    "humidity_doubling": Parameter(
        "humidity over 10 % that doubles adhesion",
        "RH_2",
        "% RH",
        1.0,
        HUMIDITY_DOUBLING,
        2.5,
        limits=Within(1, 1e6, "%"),
    ),
    "humidity_fall": Parameter(
        "growth of adhesion below 10 % RH",
        "fall",
        "1/% RH",
        1.0,
        HUMIDITY_FALL,
        5.0,
        limits=Within(0, 1, "1/%"),
    ),
    "tool_roughness": Parameter(
        "roughness of the tool", "rms_tool", "nm", 1e-9, 1e-9, 10.0, 0.0, Within(0, 1e-6, "m")
    ),
    "plate_roughness": Parameter(
        "roughness of the plate", "rms_plate", "nm", 1e-9, 1e-9, 10.0, 0.0, Within(0, 1e-6, "m")
    ),
    "breakdown_voltage": Parameter(
        "voltage that melts a ball", "V_melt", "V", 1.0, 70.0, 3.0, limits=Within(1, 1000, "V")
    ),
    "radius_exponent": Parameter(
        "exponent of the radius that the law lacks", "a_R", "", 1.0, 0.0, 6.0, is_linear=True
    ),
    "humidity_exponent": Parameter(
        "exponent of the humidity that the law lacks", "a_RH", "", 1.0, 0.0, 6.0, is_linear=True
    ),
}
"""All parameters by name, in SI.

The prior of both works covers what surfaces in air have, 0.25 to 100 mJ/m^2, and is the same for
both, so that a difference comes from measurements alone. Spreads of 6 to 38 % cover repeated
pull-offs of one surface. The exponents are 0 in the law, and serve to test its shape: adhesion is
multiplied by (R / 20 um)^a_R and by h(RH)^a_RH.
"""

ALWAYS_FREE = (
    "work_tool_object",
    "work_object_substrate",
    "spread_tool_object",
    "spread_object_substrate",
)
"""Parameters that are estimated by default; those that the data do not determine keep the prior."""
FREE_IF_DETERMINED = ("electrical_gap", "humidity_doubling", "humidity_fall", "breakdown_voltage")
"""Parameters that are estimated by default where the data determine them, and else are held."""


def known_parameter(name: str, setting: str) -> Parameter:
    """Return a parameter that a user names.

    Raises:
        UserError: there is none of this name.
    """
    settable = {key: value for key, value in PARAMETERS.items() if not value.is_linear}
    if name in settable:
        return settable[name]
    similar = closest(name, settable)
    hint = f"; perhaps you meant {similar}" if similar else ""
    raise UserError(f"`{setting}` names {name}, but parameters are {', '.join(settable)}{hint}")


@dataclass(frozen=True)
class Model:
    """Which parameters are estimated, and what the others are.

    Vectors have one place per free parameter, in standard deviations of its prior.
    """

    free: tuple[str, ...] = ALWAYS_FREE
    """Names of the parameters that are estimated."""
    parameters: Mapping[str, Parameter] = field(default_factory=lambda: dict(PARAMETERS))
    """Parameters by name, with the priors and the held values of this fit."""

    def values(self, places: np.ndarray) -> dict[str, float]:
        """Return the values of all parameters, in SI."""
        values = {name: parameter.usual for name, parameter in self.parameters.items()}
        for name, place in zip(self.free, places, strict=True):
            values[name] = self.parameters[name].value_at(float(place))
        return values

    def with_free(self, *names: str) -> "Model":
        """Return the model in which further parameters are estimated, each once."""
        return replace(self, free=tuple(dict.fromkeys((*self.free, *names))))

    def with_prior(self, name: str, median: float, factor: float) -> "Model":
        """Return the model with another prior.

        Args:
            name: of the parameter.
            median: of the prior, in SI.
            factor: within which 95 % of the prior lie.

        Raises:
            UserError: there is no such parameter, or the prior is none.
        """
        known_parameter(name, "prior")
        parameter = self.parameters[name]
        is_valid = parameter.limits.allows(median) and median > 0 and 1 < factor <= 1e4
        if not is_valid:
            raise ConfigError(
                "prior",
                f"{name}={median:g}:{factor:g}",
                f"a median that is {parameter.limits} and above 0, and a factor between 1 and 1e4",
            )
        changed = replace(parameter, median=median, factor=factor)
        return replace(self, parameters={**self.parameters, name: changed})

    def with_least_gap(self, least: float) -> "Model":
        """Return the model in which no smaller electrical gap [m] may be held or be usual."""
        parameter = self.parameters["electrical_gap"]
        reason = "the laws for these balls have no smaller gaps"
        limits = replace(parameter.limits, low=least, reason=reason)
        changed = replace(parameter, limits=limits)
        return replace(self, parameters={**self.parameters, "electrical_gap": changed})

    def with_held(self, name: str, value: float) -> "Model":
        """Return the model in which a parameter has a value and is not estimated.

        Raises:
            UserError: there is no such parameter, or the value is out of range.
        """
        known_parameter(name, "hold")
        parameter = self.parameters[name]
        if not parameter.limits.allows(value):
            raise ConfigError("hold", f"{name}={value:g}", f"{parameter.limits}, for {name}")
        changed = replace(parameter, held=value)
        free = tuple(free_name for free_name in self.free if free_name != name)
        return replace(self, free=free, parameters={**self.parameters, name: changed})
