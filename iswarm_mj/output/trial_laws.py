"""Force laws with the settings of a run on the bench, and these settings in words."""

import textwrap
from collections.abc import Mapping
from typing import Any

import numpy as np

from iswarm_mj.gripper.laws import adhesion, detachment
from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.gripper.laws.detachment import RELEASE_GAP, grasp_voltage, release_voltage
from iswarm_mj.gripper.laws.roughness import Surface, effective_work
from iswarm_mj.gripper.tips.table import TipTable, read_table
from iswarm_mj.output.trial_shapes import UM
from iswarm_mj.utils.arrays import Quantity

_CAPTION_WIDTH = 96
"""Maximum number of characters of a line of a caption."""


class Laws:
    """Least voltages without dynamics, at the medians of the works of adhesion. SI units."""

    def __init__(self, settings: Mapping[str, Any]):
        """Take the constants from a run's settings.

        Args:
            settings: settings of a run, see `GraspSettings.metadata`; `calibration` has constants
                of `detachment` by name, which replace those of the module.
        """
        calibration = settings.get("calibration", {})

        def constant(name: str) -> float:
            return calibration.get(name, getattr(detachment, name))

        # Works of adhesion [J/m^2].
        self._work_tool = constant("WORK_TOOL_OBJECT")
        self._work_plate = constant("WORK_OBJECT_SUBSTRATE")
        self._contact_gap = constant("CONTACT_GAP")
        self._probe_radius = constant("PROBE_RADIUS")
        self._density = constant("BALL_DENSITY")
        self._doubling = settings.get("humidity_doubling", adhesion.HUMIDITY_DOUBLING)
        self._fall = settings.get("humidity_fall", adhesion.HUMIDITY_FALL)
        self._tool = Surface(**settings.get("tool", {}))
        self._plate = Surface(**settings.get("plate", {}))
        self._tip_curvature = settings.get("tip_curvature")
        tip = settings.get("tip")
        self._tip: TipTable | None = None if tip is None else read_table(tip)

        self.is_of_paper = not _parameters_unlike_the_papers(settings)
        """The run has the materials, the tip and the surfaces of the paper."""

    def grasp_voltage_of(
        self, radius: Quantity, humidity: Quantity, gap: Quantity = 0.0
    ) -> Quantity:
        """Return the least voltage that picks up a ball [V].

        Args:
            radius: radius of the ball [m].
            humidity: relative humidity [%].
            gap: gap between tool and ball [m], across which the tool's adhesion does not help.
        """
        is_touching = np.asarray(gap) <= 0
        work_tool = np.where(is_touching, self._work_of_tool(radius, humidity), 0.0)
        work_plate = self._work(self._work_plate, radius, humidity, self._plate)
        effective_gap = np.where(
            is_touching,
            self._contact_gap * self._curvature_factor(radius),
            np.maximum(gap, self._contact_gap),
        )
        if self._tip is not None:
            law = np.vectorize(self._tip.grasp_voltage)
            return law(radius, work_tool, work_plate, effective_gap, self._density)
        return grasp_voltage(
            radius=radius,
            work_tool_object=work_tool,
            work_object_substrate=work_plate,
            gap=effective_gap,
            probe_radius=self._probe_radius,
            density=self._density,
        )

    def release_voltage_of(
        self, radius: Quantity, humidity: Quantity, gap: Quantity = RELEASE_GAP
    ) -> Quantity:
        """Return the least voltage that makes the tool drop a ball [V].

        Args:
            radius: radius of the ball [m].
            humidity: relative humidity [%].
            gap: gap between ball and plate [m].
        """
        work_tool = self._work_of_tool(radius, humidity)
        if self._tip is not None:
            law = np.vectorize(self._tip.release_voltage)
            return law(radius, work_tool, gap, self._density)
        return release_voltage(
            radius=radius,
            work_tool_object=work_tool,
            gap=gap,
            probe_radius=self._probe_radius,
            density=self._density,
        )

    def _work_of_tool(self, radius: Quantity, humidity: Quantity) -> Quantity:
        """Return the work of adhesion of the ball to the tip, as to a plane [J/m^2]."""
        work = self._work(self._work_tool, radius, humidity, self._tool)
        if self._tip is not None:
            return work * np.vectorize(self._tip.adhesion_share)(radius)
        return work / self._curvature_factor(radius)

    def _work(
        self, median: float, radius: Quantity, humidity: Quantity, surface: Surface
    ) -> Quantity:
        """Return a work of adhesion at a humidity [J/m^2].

        The surface changes the work at the humidity of 10 %, as in the trials of the bench, which
        multiply the result by the default law of humidity.
        """
        default_growth = humidity_factor(humidity)
        growth = humidity_factor(humidity, self._doubling, self._fall) / default_growth
        return effective_work(median * growth, radius, surface) * default_growth

    def _curvature_factor(self, radius: Quantity) -> Quantity:
        """Return by how much a rounded tip lowers adhesion and widens the gap, 1 if it is flat."""
        if self._tip_curvature is None:
            return np.ones_like(radius)
        return 1 + np.asarray(radius) / self._tip_curvature


def described_parameters(settings: Mapping[str, Any]) -> str:
    """Return the parameters of a run, and what of them is beyond the fit, as lines of a caption.

    Args:
        settings: settings of the run, see `GraspSettings.metadata`.
    """
    calibration = settings.get("calibration", {})

    def constant(name: str) -> float:
        return calibration.get(name, getattr(detachment, name))

    parts = [
        f"W_TO = {constant('WORK_TOOL_OBJECT') * 1e3:.3g} mJ/m²",
        f"W_OS = {constant('WORK_OBJECT_SUBSTRATE') * 1e3:.3g} mJ/m² (medians at 10 % RH)",
        f"density {constant('BALL_DENSITY'):g} kg/m³",
        f"electrical gap {constant('CONTACT_GAP') * UM:g} µm",
        _tip_text(settings, constant("PROBE_RADIUS")),
    ]
    for name in ("tool", "plate"):
        surface = Surface(**settings.get(name, {}))
        default = Surface()._asdict()
        parts += [
            f"{name} {field} {value:g}"
            for field, value in surface._asdict().items()
            if value != default[field]
        ]
    text = textwrap.fill(f"This run: {', '.join(parts)}.", _CAPTION_WIDTH)

    beyond = settings.get("beyond_the_fit")
    if beyond:
        sentence = f"Beyond the fit, hence predictions: {', '.join(beyond)}."
        text += "\n" + textwrap.fill(sentence, _CAPTION_WIDTH)
    return text


def _tip_text(settings: Mapping[str, Any], probe_radius: float) -> str:
    """Return the tip of a run in words."""
    if settings.get("tip") is not None:
        return f"tip of {settings['tip']}"
    text = f"tip radius {probe_radius * UM:g} µm"
    if settings.get("tip_curvature") is not None:
        text += f", rounded by {settings['tip_curvature'] * UM:g} µm"
    return text


def _parameters_unlike_the_papers(settings: Mapping[str, Any]) -> list[str]:
    """Return the names of settings behind the force laws that are not those of the paper."""
    calibration = settings.get("calibration", {})
    names = [name for name, value in calibration.items() if value != getattr(detachment, name)]
    for name in ("tool", "plate"):
        if Surface(**settings.get(name, {})) != Surface():
            names.append(name)
    only_beyond = ("humidity_doubling", "humidity_fall", "tip_curvature", "tip")
    return names + [name for name in only_beyond if name in settings]
