"""The gripper's bench on the page: a trial in slow motion, and a force curve."""

import time
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any

import numpy as np

from iswarm_mj.gripper.bench.force_curve import force_curve
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.tracing import Trace, thinned, trace_trial
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws import detachment as defaults
from iswarm_mj.gripper.laws.materials import Name
from iswarm_mj.output.palette import BLUE, GREEN, ORANGE, PALE, WALL, YELLOW, rgb
from iswarm_mj.output.trial_shapes import NN, PROBE_LENGTH, UM, trial_shapes
from iswarm_mj.player.controls import Control, declared
from iswarm_mj.player.inputs import Inputs
from iswarm_mj.player.view import linear
from iswarm_mj.player.widgets import AXIS, show, spots
from iswarm_mj.utils.constraints import Within, validate
from iswarm_mj.workflows.grasp_settings import EffectiveProperties, GraspSettings

_ROOT = "/bench"
FORCES = (
    ("electrostatic", YELLOW),
    ("adhesion to the tool", GREEN),
    ("adhesion to the plate", ORANGE),
)
"""Forces on the ball that have an arrow, with its colour."""
SAMPLES = 600
"""Samples of a trial that are shown; they are dense where the ball moves."""
SHOWN_S = 15.0
"""Duration in which a trial is shown [s]."""
_WORK_TOOL_OBJECT = defaults.WORK_TOOL_OBJECT * 1e3
_WORK_OBJECT_SUBSTRATE = defaults.WORK_OBJECT_SUBSTRATE * 1e3
"""Works of adhesion at first [mJ/m²]."""
_NO_ARROWS = np.zeros((len(FORCES), 2, 3), np.float32)
_ON_PLATE = 1e-7
"""Largest gap at which a ball lies on the plate after the release [m]."""
_MATERIALS = ("ball_material", "tool_material", "plate_material")


@dataclass(frozen=True)
class BenchSettings:
    """A ball and a tool. Lengths are in micrometres, as on the page."""

    voltage: Annotated[float, Within(0, 80, "V")] = 40.0
    """Voltage of the tool while it lifts, and in the force curve [V]."""
    relative_humidity: Annotated[float, Within(0, 100, "%")] = 10.0
    """Relative humidity of the air [%]."""
    radius: Annotated[float, Within(10, 50, "µm")] = 15.0
    """Radius of the ball [µm]."""
    probe_radius: Annotated[float, Within(2, 50, "µm")] = defaults.PROBE_RADIUS * UM
    """Radius of the tool's flat face [µm]."""
    ball_material: Name = "solder"
    """Material of the ball; sets the works of adhesion, its density and its contacts."""
    tool_material: Name = "aluminium"
    """Material of the tool."""
    plate_material: Name = "steel"
    """Material of the plate."""
    work_tool_object: Annotated[float, Within(0.05, 100, "mJ/m²")] = _WORK_TOOL_OBJECT
    """Work of adhesion between tool and ball at 10 % RH [mJ/m²]."""
    work_object_substrate: Annotated[float, Within(0.1, 100, "mJ/m²")] = _WORK_OBJECT_SUBSTRATE
    """Work of adhesion between ball and plate at 10 % RH [mJ/m²]."""
    gap: Annotated[float, Within(1, 20, "µm")] = defaults.RELEASE_GAP * UM
    """Gap between ball and plate at the release [µm]."""

    def __post_init__(self):
        validate(self)

    @property
    def used(self) -> EffectiveProperties:
        """Numbers of the materials, see `GraspSettings.effective`."""
        materials = {name: getattr(self, name) for name in _MATERIALS}
        return GraspSettings(**materials).effective

    def changed(self, name: str, value: Any) -> "BenchSettings":
        """Return settings with another value; another material changes the works of adhesion, too.

        Raises:
            UserError: the value is out of range, or the materials have no works of adhesion.
        """
        if name not in _MATERIALS:
            return replace(self, **{name: float(value)})
        used = replace(self, **{name: value}).used
        works = {
            "work_tool_object": 1e3 * used.work_tool_object,
            "work_object_substrate": 1e3 * used.work_object_substrate,
        }
        return replace(self, **{name: value}, **works)

    @property
    def trial(self) -> Trial:
        """The ball on the bench, in SI units."""
        used = self.used
        return Trial(
            self.radius / UM,
            self.work_tool_object * 1e-3,
            self.work_object_substrate * 1e-3,
            self.relative_humidity,
            probe_radius=self.probe_radius / UM,
            density=used.ball_density,
            contacts=used.contacts,
        )

    def trace(self) -> Trace:
        """Return the trial with this voltage, thinned."""
        trace = trace_trial(self.trial, Protocol(), self.voltage, self.gap / UM)
        return thinned(trace, SAMPLES)

    def curve(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rising heights of the tool's face, and the forces on it in both directions.

        Returns:
            heights: above the place where the tool first touches the ball [µm].
            approaching: force on the tool at each height as it approaches, interpolated [nN].
            retracting: the same as it retracts. Attraction is negative.
        """
        rows = sorted(force_curve(self.trial, Protocol(), self.voltage), key=lambda row: row["tip"])
        heights = np.unique([row["tip"] for row in rows])

        def force(direction: str) -> np.ndarray:
            on_the_way = [row for row in rows if row["direction"] == direction]
            tips = np.array([row["tip"] for row in on_the_way])
            totals = np.array([row["total"] for row in on_the_way])
            return np.interp(heights, tips, totals)

        return heights * UM, force("approach") * NN, force("retract") * NN


def outcome(trace: Trace) -> str:
    """Return whether the tool lifted the ball, and at which voltage it released it."""
    phases = [trace.phases[k] for k in trace.phase]
    if "ramp" not in phases:
        return "The ball stays on the plate: the tool pulls less than the plate holds."
    is_ramp = np.array([phase == "ramp" for phase in phases])
    is_released = trace.gap_plate[-1] < _ON_PLATE
    end = "did not let go"
    if is_released:
        end = f"let go at {trace.voltage[is_ramp].max():.0f} V"
    return f"The tool lifted the ball, and {end}."


class Bench:
    """Nodes and controls of the bench.

    Attributes:
        settings: settings of the ball and the tool.
        root: parent of all nodes, which is hidden at first.
        trace: trial that is shown; None before the first.
    """

    def __init__(self, server: Any, inputs: Inputs, size: float):
        """Make the nodes, which are hidden, and the controls, in the present container.

        Args:
            server: viser server of the page.
            inputs: inputs of the page.
            size: diameter of a ball of 15 µm in the scene [mm].
        """
        self.settings = BenchSettings()
        self.trace: Trace | None = None
        self._scale = size / 30
        self._due = set[str]()
        self._began = 0.0
        self._shown_sample = -1
        self._add_nodes(server.scene)
        self._add_controls(server.gui, inputs)
        self.show()

    def _add_nodes(self, drawn: Any) -> None:
        """Add ball, tool, plate and forces to the scene."""
        scale = self._scale
        self.root = drawn.add_frame(_ROOT, show_axes=False, visible=False)
        self._ball = drawn.add_icosphere(
            f"{_ROOT}/ball",
            1.0,
            rgb(ORANGE),
            subdivisions=4,
            cast_shadow=False,
        )
        self._mark = drawn.add_icosphere(f"{_ROOT}/mark", 1.0, (40, 40, 40), cast_shadow=False)
        self._probe = drawn.add_cylinder(
            f"{_ROOT}/probe",
            1.0,
            scale * PROBE_LENGTH,
            rgb(PALE),
            opacity=0.7,
        )
        self._probe.cast_shadow = False
        drawn.add_box(
            f"{_ROOT}/plate",
            rgb(WALL),
            (150 * scale, 150 * scale, 2 * scale),
            position=(0, 0, -scale),
            cast_shadow=False,
        )
        self._arrows = drawn.add_arrows(
            f"{_ROOT}/forces",
            _NO_ARROWS,
            linear(np.array([rgb(colour) for _, colour in FORCES])),
            shaft_radius=1.0 * scale,
            head_radius=2.2 * scale,
            head_length=3 * scale,
        )

    def _add_controls(self, gui: Any, inputs: Inputs) -> None:
        """Add the trial, the settings and the force curve to the panel."""
        inputs.add_button(
            "Lift and release the ball",
            lambda _: self._due.add("trial"),
            icon="player-play",
        )
        self._text = gui.add_markdown("")
        moment = Control("moment", "", 0.0, limits=Within(0.0, 100.0, "%"), step=0.1)
        self._moment = inputs.add(moment)
        self._plays = inputs.add(Control("plays", "", True))
        self._handles = {}
        for control in declared(self.settings):
            self._handles[control.name] = inputs.add(control, partial(self._move, control.name))
        gui.add_html(spots([(name, rgb(colour)) for name, colour in FORCES]))
        self._add_curve(gui)

    def _add_curve(self, gui: Any) -> None:
        """Add the plot of the force curve, without data."""
        nothing = (np.arange(2.0), np.full(2, np.nan), np.full(2, np.nan))
        self._curve = gui.add_uplot(
            nothing,
            (
                {"label": "height"},
                {"label": "approach", "stroke": GREEN, "width": 2},
                {"label": "retract", "stroke": BLUE, "width": 2},
            ),
            title="Force on the tool; attraction is negative",
            axes=(
                AXIS | {"label": "height of the tool above touch [µm]"},
                AXIS | {"label": "force [nN]"},
            ),
            scales={"x": {"time": False}},
            height=220,
        )

    def show_or_hide(self, *, is_shown: bool) -> None:
        """Show or hide it."""
        self.root.visible = is_shown
        if is_shown:
            self._due.add("curve")

    def take(self, trace: Trace) -> None:
        """Show a trial, from its start."""
        self._shapes = trial_shapes(trace)
        self.trace = trace
        self._began = time.monotonic()
        self._text.content = outcome(trace)

    def hold(self, moment: float) -> None:
        """Stop at a moment of the trial [%], and show it."""
        self._plays.value = False
        self._moment.value = moment
        self.show()

    def _move(self, name: str, value: Any) -> None:
        """Take another value of a setting; if it is refused, show the present one again.

        Raises:
            UserError: the settings do not fit each other.
        """
        try:
            self.settings = self.settings.changed(name, value)
        finally:
            for setting, handle in self._handles.items():
                show(handle, "value", getattr(self.settings, setting))
        self.trace = None
        self._due.add("curve")
        self.show()

    def work(self) -> bool:
        """Compute what is due; return whether anything was. What fails is no longer due."""
        if "curve" in self._due:
            self._due.discard("curve")
            self._curve.data = self.settings.curve()
            return True
        if "trial" in self._due:
            self._due.discard("trial")
            self._compute_trial()
            return True
        return False

    def _compute_trial(self) -> None:
        """Compute a trial and show it, unless the settings change meanwhile."""
        self._text.content = "Computing some 25 000 physics steps of 1 µs ..."
        settings = self.settings
        try:
            trace = settings.trace()
        except Exception:
            self._text.content = "The trial failed."
            raise
        if settings == self.settings:
            self.take(trace)
        else:
            self._text.content = "The settings have changed meanwhile."

    def show(self) -> None:
        """Draw the moment that is due."""
        trace = self.trace
        if trace is None:
            self._draw_start(self.settings)
            return
        if self._plays.value:
            share_of_film = (time.monotonic() - self._began) / SHOWN_S % 1
            self._moment.value = round(100 * share_of_film, 1)
        n_samples = len(trace.time)
        sample = min(n_samples - 1, int(self._moment.value / 100 * n_samples))
        if sample != self._shown_sample:
            self._shown_sample = sample
            self._draw_sample(trace, sample)

    def _draw_sample(self, trace: Trace, sample: int) -> None:
        """Draw a sample of a trial: bodies, forces and a line on it."""
        scale = self._scale
        shapes = self._shapes
        self._ball.position = tuple(scale * shapes.ball[sample])
        self._mark.position = tuple(scale * shapes.mark[sample])
        self._probe.position = tuple(scale * shapes.probe[sample])
        self._ball.color = rgb(ORANGE if trace.on_plate_potential[sample] else GREEN)

        origins = shapes.origins[sample]
        ends = np.stack([origins, origins + shapes.arrows[sample]], axis=1)
        self._arrows.points = (scale * ends).astype(np.float32)

        phase = trace.phases[trace.phase[sample]]
        milliseconds = 1e3 * trace.time[sample]
        volts = trace.voltage[sample]
        moment = f"{milliseconds:.2f} ms · {phase} · {volts:.1f} V"
        self._text.content = f"{outcome(trace)}\n\n{moment}"

    def _draw_start(self, settings: BenchSettings) -> None:
        """Draw tool and ball where a trial begins, without forces."""
        self._shown_sample = -1
        scale = self._scale
        radius = scale * settings.radius
        self._ball.radius = radius
        self._mark.radius = 0.08 * radius
        self._probe.radius = scale * settings.probe_radius
        self._ball.position = (0, 0, radius)
        self._mark.position = (0.3 * radius, -0.8 * radius, 1.52 * radius)
        self._probe.position = (0, 0, 2 * radius + scale * (5 + PROBE_LENGTH / 2))
        self._ball.color = rgb(ORANGE)
        self._arrows.points = _NO_ARROWS.copy()
