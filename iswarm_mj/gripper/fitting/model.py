"""The load that a voltage or a force must overcome in each measurement, and how it scatters.

Works of adhesion scatter from ball to ball. They are normal here, with the mean and the variance of
the bench's log-normal ones, so that the load is normal, too, and all probabilities have a closed
form: a voltage V lifts or releases a ball if k V^2 exceeds the load.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from iswarm_mj.gripper.fitting.table import MAX_GAP_RATIO, MIN_GAP_RATIO, Measurements
from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.gripper.laws.detachment import ball_weight
from iswarm_mj.gripper.laws.electrostatics import asymptotic_force, pick_force, release_force
from iswarm_mj.gripper.laws.probe_table import probe_factor
from iswarm_mj.gripper.laws.roughness import Surface, roughness_factor

REFERENCE_RADIUS = 20e-6
"""Radius at which the exponent of the radius changes nothing [m]."""
MELTING_SPREAD = 0.1
"""Coefficient of variation of the voltage that melts a ball, from ball to ball; a choice."""

_TOOL_SIGN = {"grasp": -1.0, "release": 1.0, "pull_off_tool": 1.0}
_PLATE_SIGN = {"grasp": 1.0, "no_contact": 1.0, "pull_off_plate": 1.0}
_WEIGHT_SIGN = {"grasp": 1.0, "release": -1.0, "no_contact": 1.0}
"""Signs with which adhesion to tool and plate and the weight enter the load, by kind."""


@dataclass(frozen=True)
class Loads:
    """Loads of N measurements: forces [N], or squares of voltages [V^2] of melting."""

    mean: Float[np.ndarray, "N"]
    deviation: Float[np.ndarray, "N"]
    """Standard deviation from ball to ball."""
    per_volt2: Float[np.ndarray, "N"]
    """Factor k between load and square of the voltage; 1 for forces."""


class LoadModel:
    """The loads of measurements as a function of the parameters.

    What does not depend on parameters is computed once.
    """

    def __init__(self, measurements: Measurements):
        self.measurements = measurements
        rows = measurements
        adhesion = 2 * math.pi * rows.radius
        self._curvature = 1 + rows.radius / rows.tip_curvature
        tool = adhesion * rows.tool_ratio / self._curvature
        self._tool = _by_kind(rows.kind, _TOOL_SIGN) * tool
        self._plate = _by_kind(rows.kind, _PLATE_SIGN) * adhesion * rows.plate_ratio
        weight = np.asarray(ball_weight(rows.radius, rows.ball_density))
        self._weight = _by_kind(rows.kind, _WEIGHT_SIGN) * weight
        self._in_contact = rows.kind == "grasp"
        self._is_force = np.isin(rows.kind, ("pull_off_tool", "pull_off_plate"))
        self._is_melting = rows.kind == "melting"
        self._per_volt2_of_gap: dict[float, np.ndarray] = {}

    def loads(self, values: Mapping[str, float]) -> Loads:
        """Return the loads.

        Args:
            values: parameters by name, in SI.
        """
        rows = self.measurements
        factor = self._shape_factor(values)
        tool = factor * self._tool * _rough(rows.radius, values["tool_roughness"])
        plate = factor * self._plate * _rough(rows.radius, values["plate_roughness"])

        # Works are medians; the mean of a log-normal quantity of variation v is sqrt(1 + v^2) larger.
        spread_tool = values["spread_tool_object"]
        spread_plate = values["spread_object_substrate"]
        tool_load = tool * values["work_tool_object"] * math.hypot(1, spread_tool)
        plate_load = plate * values["work_object_substrate"] * math.hypot(1, spread_plate)
        mean = tool_load + plate_load + self._weight
        deviation = np.hypot(
            tool_load * spread_tool,
            plate_load * spread_plate,
        )

        if self._is_melting.any():
            melting_voltage = values["breakdown_voltage"]
            mean = np.where(self._is_melting, melting_voltage**2, mean)
            melting_deviation = 2 * MELTING_SPREAD * melting_voltage**2
            deviation = np.where(self._is_melting, melting_deviation, deviation)
        return Loads(mean, deviation, self._per_volt2(values["electrical_gap"]))

    def _shape_factor(self, values: Mapping[str, float]) -> np.ndarray:
        """Return adhesion over that of a ball of 20 um at 10 % RH with the same works."""
        humidity = np.asarray(
            humidity_factor(
                self.measurements.humidity, values["humidity_doubling"], values["humidity_fall"]
            )
        )
        factor = humidity ** (1 + values["humidity_exponent"])
        if values["radius_exponent"]:
            radius = self.measurements.radius / REFERENCE_RADIUS
            factor = factor * radius ** values["radius_exponent"]
        return factor

    def _per_volt2(self, electrical_gap: float) -> np.ndarray:
        """Return the factor between load and square of the voltage, kept for the latest gap."""
        if electrical_gap not in self._per_volt2_of_gap:
            rows = self.measurements
            factor = np.ones(len(rows))
            contact = self._in_contact
            # Searches try gaps beyond the shape factor's range, where it has the value of its edge.
            radius = rows.radius[contact]
            gap = electrical_gap * self._curvature[contact]
            gap_ratio = np.clip(gap / radius, MIN_GAP_RATIO, MAX_GAP_RATIO)
            shape = probe_factor("pick", gap_ratio, rows.probe_radius[contact] / radius)
            factor[contact] = shape * asymptotic_force(1.0, gap, radius)
            distant = rows.kind == "no_contact"
            factor[distant] = pick_force(
                1.0, rows.gap[distant], rows.radius[distant], rows.probe_radius[distant]
            )
            releasing = rows.kind == "release"
            factor[releasing] = release_force(
                1.0, rows.gap[releasing], rows.radius[releasing], rows.probe_radius[releasing]
            )
            self._per_volt2_of_gap = {electrical_gap: factor}
        return self._per_volt2_of_gap[electrical_gap]

    def load_of(self, value: np.ndarray, loads: Loads) -> np.ndarray:
        """Return the loads that measured values, voltages or forces, overcome."""
        return np.where(self._is_force, value, loads.per_volt2 * value**2)

    def slope_of(self, value: np.ndarray, loads: Loads) -> np.ndarray:
        """Return the derivative of `load_of`."""
        return np.where(self._is_force, 1.0, 2 * loads.per_volt2 * value)

    def value_of(self, load: np.ndarray, loads: Loads) -> np.ndarray:
        """Return the voltages or forces that overcome loads, 0 where none is needed."""
        positive = np.maximum(load, 0.0)
        return np.where(self._is_force, positive, np.sqrt(positive / loads.per_volt2))


def _by_kind(kind: np.ndarray, signs: Mapping[str, float]) -> np.ndarray:
    """Return the sign of each row."""
    return sum((kind == name) * sign for name, sign in signs.items()) + np.zeros(len(kind))


def _rough(radius: np.ndarray, roughness: float) -> np.ndarray | float:
    """Return the factor of a rough surface; its asperities have the default spacing."""
    if roughness == 0:
        return 1.0
    return np.asarray(roughness_factor(radius, Surface(roughness=roughness)))
