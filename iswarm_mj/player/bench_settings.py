"""Settings of the gripper's bench on the page, and what follows from them."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Annotated, Any, NamedTuple

import numpy as np

from iswarm_mj.gripper.bench.force_curve import force_curve
from iswarm_mj.gripper.bench.tracing import Trace, thinned, trace_trial
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws import detachment
from iswarm_mj.gripper.laws.adhesion import dmt_pull_off, humidity_factor
from iswarm_mj.gripper.laws.materials import MATERIALS, Name
from iswarm_mj.gripper.tips.profile import Profile
from iswarm_mj.gripper.tips.shapes import flat, rounded
from iswarm_mj.gripper.tips.table import read_table
from iswarm_mj.output.trial_shapes import NN, UM
from iswarm_mj.utils.constraints import Within, validate
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.workflows.grasp import quasi_static_grasp, quasi_static_release
from iswarm_mj.workflows.grasp_settings import GraspSettings, adapted

SAMPLES = 600
"""Samples of a trial that are shown; they are dense where the ball moves."""
_MJ = 1e3
"""Millijoules per joule."""
_MATERIALS = ("ball_material", "tool_material", "plate_material")
_WORKS = ("work_tool_object", "work_object_substrate")
_WORK_TOOL_OBJECT = detachment.WORK_TOOL_OBJECT * _MJ
_WORK_OBJECT_SUBSTRATE = detachment.WORK_OBJECT_SUBSTRATE * _MJ
"""Works of adhesion at first [mJ/m²]."""


class Laws(NamedTuple):
    """Voltages and forces of a ball by the laws, without the dynamics of a trial."""

    grasp_voltage: float
    """Least voltage that lifts the ball [V]."""
    release_voltage: float
    """Least voltage that drops the ball [V]."""
    pull_off_tool: float
    """Force that pulls the ball off the tool without a voltage [nN]."""
    pull_off_plate: float
    """Force that pulls the ball off the plate without a voltage [nN]."""


@dataclass(frozen=True)
class BenchSettings:
    """A ball and a tool. Lengths are in micrometres, as on the page."""

    voltage: Annotated[float, Within(0, 80, "V")] = 40.0
    """Voltage of the tool while it lifts, and in the force curve [V]."""
    relative_humidity: Annotated[float, Within(0, 100, "%")] = 10.0
    """Relative humidity of the air [%]."""
    radius: Annotated[float, Within(10, 50, "µm")] = 15.0
    """Radius of the ball [µm]."""
    probe_radius: Annotated[float, Within(2, 80, "µm")] = detachment.PROBE_RADIUS * UM
    """Radius of the tool, a wire whose tip is flat [µm]."""
    ball_material: Name = "solder"
    """Material of the ball; sets the works of adhesion, its density and its contacts."""
    tool_material: Name = "aluminium"
    """Material of the tool."""
    plate_material: Name = "steel"
    """Material of the plate."""
    work_tool_object: Annotated[float, Within(0.01, 1000, "mJ/m²")] = _WORK_TOOL_OBJECT
    """Work of adhesion between tool and ball at 10 % RH [mJ/m²]."""
    work_object_substrate: Annotated[float, Within(0.01, 1000, "mJ/m²")] = _WORK_OBJECT_SUBSTRATE
    """Work of adhesion between ball and plate at 10 % RH [mJ/m²]."""
    gap: Annotated[float, Within(1, 20, "µm")] = detachment.RELEASE_GAP * UM
    """Gap between ball and plate at the release [µm]."""
    others: GraspSettings = field(default_factory=GraspSettings)
    """Settings without an input here, such as the electrical gap and the shape of the tip."""

    def __post_init__(self):
        validate(self)
        assert self.in_si  # raises a ConfigError for settings that do not fit each other

    @classmethod
    def of(cls, settings: GraspSettings) -> "BenchSettings":
        """Return the settings of `iswarm grasp`, with the first of its radii, humidities and gaps.

        Raises:
            ConfigError: a value is out of the page's range, or a material has no name.
        """
        materials: dict[str, Any] = {name: getattr(settings, name) for name in _MATERIALS}
        for name, material in materials.items():
            if material not in MATERIALS:
                names = ", ".join(MATERIALS)
                raise ConfigError(name, material, f"one of {names} on the page")
        works: dict[str, Any] = {
            name: _rounded(_MJ * getattr(settings.effective, name)) for name in _WORKS
        }
        return cls(
            relative_humidity=settings.humidities[0],
            radius=_rounded(settings.radii[0] * UM),
            probe_radius=_rounded(settings.probe_radius * UM),
            gap=_rounded(settings.gaps.release[0] * UM),
            others=settings,
            **materials,
            **works,
        )

    @cached_property
    def in_si(self) -> GraspSettings:
        """The same as settings of `iswarm grasp`, in SI units."""
        return replace(
            self.others,
            radius=(str(self.radius / UM),),
            rh=(self.relative_humidity,),
            probe_radius=_rounded(self.probe_radius / UM),
            gap=(self.gap / UM,),
            ball_material=self.ball_material,
            tool_material=self.tool_material,
            plate_material=self.plate_material,
            work_tool_object=self.work_tool_object / _MJ,
            work_object_substrate=self.work_object_substrate / _MJ,
        )

    def changed(self, name: str, value: Any) -> "BenchSettings":
        """Return settings with another value; another material scales the works of adhesion, too.

        Raises:
            UserError: the value is out of range, or the materials have no works of adhesion.
        """
        if name not in _MATERIALS:
            return replace(self, **{name: float(value)})

        # Works that were fitted or set keep their ratio to those that the materials alone have.
        materials = {material: getattr(self, material) for material in _MATERIALS}
        before = GraspSettings(**materials).effective
        after = GraspSettings(**materials | {name: value}).effective
        works = {}
        for work in _WORKS:
            ratio = getattr(after, work) / getattr(before, work)
            works[work] = _rounded(getattr(self, work) * ratio)
        return replace(self, **{name: value}, **works)

    @property
    def trial(self) -> Trial:
        """The ball on the bench, in SI units."""
        median = Trial(
            radius=self.radius / UM,
            work_tool_object=detachment.WORK_TOOL_OBJECT,
            work_object_substrate=detachment.WORK_OBJECT_SUBSTRATE,
            relative_humidity=self.relative_humidity,
        )
        return adapted(self.in_si, median)

    @property
    def laws(self) -> Laws:
        """Voltages and forces by the laws."""
        trial = self.trial
        growth = float(humidity_factor(trial.relative_humidity))
        work_tool = trial.work_tool_object * growth
        work_plate = trial.work_object_substrate * growth
        return Laws(
            quasi_static_grasp(trial, work_tool, work_plate, trial.contact_gap),
            quasi_static_release(trial, work_tool, self.gap / UM),
            float(dmt_pull_off(trial.radius, work_tool)) * NN,
            float(dmt_pull_off(trial.radius, work_plate)) * NN,
        )

    @property
    def profile(self) -> Profile:
        """Profile of the tip. Of a sphere that is smaller than the wire, half is drawn."""
        if self.others.tip is not None:
            return read_table(self.others.tip).profile
        radius = self.in_si.probe_radius
        curvature = self.others.tip_curvature
        if curvature is None:
            return flat(radius)
        return rounded(min(radius, curvature), curvature)

    @property
    def has_curve(self) -> bool:
        """Forces at a distance are known: not for a rounded tip without a table of its forces."""
        return self.others.tip_curvature is None

    def trace(self) -> Trace:
        """Return the trial with this voltage, thinned."""
        trace = trace_trial(self.trial, self.others.protocol, self.voltage, self.gap / UM)
        return thinned(trace, SAMPLES)

    def curve(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rising heights of the tool's face, and the forces on it in both directions.

        Returns:
            heights: above the place where the tool first touches the ball [µm].
            approaching: force on the tool at each height as it approaches, interpolated [nN].
            retracting: the same as it retracts. Attraction is negative.
        """
        rows = force_curve(self.trial, self.others.protocol, self.voltage)
        rows = sorted(rows, key=lambda row: row["tip"])
        heights = np.unique([row["tip"] for row in rows])

        def force(direction: str) -> np.ndarray:
            on_the_way = [row for row in rows if row["direction"] == direction]
            tips = np.array([row["tip"] for row in on_the_way])
            totals = np.array([row["total"] for row in on_the_way])
            return np.interp(heights, tips, totals)

        return heights * UM, force("approach") * NN, force("retract") * NN


def _rounded(value: float) -> float:
    """Return a number to twelve digits, without what another unit left behind them."""
    return float(f"{value:.12g}")
