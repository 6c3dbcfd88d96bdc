"""The gripper's bench on the page: a trial in slow motion with its forces as arrows, and a live force curve."""

import time
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any

import numpy as np

from iswarm_mj.gripper.bench.force_curve import force_curve
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.tracing import Trace, thinned, trace_trial
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws import detachment as usual
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
FORCES = (("electrostatic", YELLOW), ("adhesion to the tool", GREEN), ("adhesion to the plate", ORANGE))
SAMPLES = 600
"""Of a trial that is shown; they are dense where the ball moves."""
SHOWN_S = 15.0
"""In which a trial is shown [s]."""


_MATERIALS = ("ball_material", "tool_material", "plate_material")


@dataclass(frozen=True)
class BenchSettings:
    """A ball and a tool. Lengths are in micrometres, as on the page."""

    voltage: Annotated[float, Within(0, 80, "V")] = 40.0
    """Of the tool while it lifts, and in the force curve [V]."""
    relative_humidity: Annotated[float, Within(0, 100, "%")] = 10.0
    """Of the air [%]."""
    radius: Annotated[float, Within(10, 50, "µm")] = 15.0
    """Of the ball [µm]."""
    probe_radius: Annotated[float, Within(2, 50, "µm")] = usual.PROBE_RADIUS * UM
    """Of the tool's flat face [µm]."""
    ball_material: Name = "solder"
    """Of the ball; sets the works of adhesion, its density and its contacts."""
    tool_material: Name = "aluminium"
    """Of the tool."""
    plate_material: Name = "steel"
    """Of the plate."""
    work_tool_object: Annotated[float, Within(0.05, 100, "mJ/m²")] = usual.WORK_TOOL_OBJECT * 1e3
    """Work of adhesion between tool and ball at 10 % RH [mJ/m²]."""
    work_object_substrate: Annotated[float, Within(0.1, 100, "mJ/m²")] = usual.WORK_OBJECT_SUBSTRATE * 1e3
    """Work of adhesion between ball and plate at 10 % RH [mJ/m²]."""
    gap: Annotated[float, Within(1, 20, "µm")] = usual.RELEASE_GAP * UM
    """Between ball and plate at the release [µm]."""

    def __post_init__(self):
        validate(self)

    @property
    def used(self) -> EffectiveProperties:
        """Numbers of the materials, see `GraspSettings.effective`."""
        return GraspSettings(**{name: getattr(self, name) for name in _MATERIALS}).effective

    def changed(self, name: str, value: Any) -> "BenchSettings":
        """Return settings with another value; another material changes the works of adhesion, too."""
        if name not in _MATERIALS:
            return replace(self, **{name: float(value)})
        used = replace(self, **{name: value}).used
        works = 1e3 * used.work_tool_object, 1e3 * used.work_object_substrate
        return replace(self, **{name: value}, work_tool_object=works[0], work_object_substrate=works[1])

    @property
    def trial(self) -> Trial:
        """The ball on the bench."""
        works, used = (self.work_tool_object * 1e-3, self.work_object_substrate * 1e-3), self.used
        probe = self.probe_radius / UM
        own = {"probe_radius": probe, "density": used.ball_density, "contacts": used.contacts}
        return Trial(self.radius / UM, *works, self.relative_humidity, **own)

    def trace(self) -> Trace:
        """Return the trial with this voltage, thinned."""
        return thinned(trace_trial(self.trial, Protocol(), self.voltage, self.gap / UM), SAMPLES)

    def curve(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rising heights of the tool's face [µm], and the forces on it [nN], approaching and retracting.

        The height is 0 where the tool first touches the ball. Attraction is negative. Forces are interpolated.
        """
        rows = sorted(force_curve(self.trial, Protocol(), self.voltage), key=lambda row: row["tip"])
        heights = np.unique([row["tip"] for row in rows])
        sides = [[row for row in rows if row["direction"] == name] for name in ("approach", "retract")]
        there, back = (np.interp(heights, *np.array([(row["tip"], row["total"]) for row in side]).T) for side in sides)
        return heights * UM, there * NN, back * NN


def outcome(trace: Trace) -> str:
    """Return what became of the ball: whether the tool lifted it, and at which voltage it let go."""
    names = [trace.phases[k] for k in trace.phase]
    if "ramp" not in names:
        return "The ball stays on the plate: the tool pulls less than the plate holds."
    ramp = np.array([name == "ramp" for name in names])
    released = trace.gap_plate[-1] < 1e-7
    end = f"let go at {trace.voltage[ramp].max():.0f} V" if released else "did not let go"
    return f"The tool lifted the ball, and {end}."


class Bench:
    """Nodes and controls of the bench.

    Attributes:
        settings: of the ball and the tool.
        root: node of all, which is hidden at first.
        trace: of the trial that is shown; None before the first.
    """

    def __init__(self, server: Any, inputs: Inputs, size: float):
        """Make the nodes, which are hidden, and the controls, in the present container.

        Args:
            server: of viser.
            inputs: of the page.
            size: of a ball of 15 um in the scene.
        """
        self.settings = BenchSettings()
        self.trace: Trace | None = None
        self._scale = size / 30
        self._due = set[str]()
        self._began = 0.0
        self._shown = -1
        self._add_nodes(server.scene)
        self._add_controls(server.gui, inputs)
        self.show()

    def _add_nodes(self, drawn: Any) -> None:
        """Add ball, tool, plate and forces to the scene."""
        k = self._scale
        self.root = drawn.add_frame(_ROOT, show_axes=False, visible=False)
        self._ball = drawn.add_icosphere(f"{_ROOT}/ball", 1.0, rgb(ORANGE), subdivisions=4, cast_shadow=False)
        self._mark = drawn.add_icosphere(f"{_ROOT}/mark", 1.0, (40, 40, 40), cast_shadow=False)
        self._probe = drawn.add_cylinder(f"{_ROOT}/probe", 1.0, k * PROBE_LENGTH, rgb(PALE), opacity=0.7)
        self._probe.cast_shadow = False
        drawn.add_box(
            f"{_ROOT}/plate",
            rgb(WALL),
            (150 * k, 150 * k, 2 * k),
            position=(0, 0, -k),
            cast_shadow=False,
        )
        self._arrows = drawn.add_arrows(
            f"{_ROOT}/forces",
            np.zeros((3, 2, 3), np.float32),
            linear(np.array([rgb(colour) for _, colour in FORCES])),
            shaft_radius=1.0 * k,
            head_radius=2.2 * k,
            head_length=3 * k,
        )

    def _add_controls(self, gui: Any, inputs: Inputs) -> None:
        """Add the trial, the settings and the force curve to the panel."""
        self._try = inputs.add_button("Lift and release the ball", lambda _: self._due.add("trial"), icon="player-play")
        self._said = gui.add_markdown("")
        self._moment = inputs.add(Control("moment", "", 0.0, low=0.0, high=100.0, unit="%", step=0.1))
        self._plays = inputs.add(Control("plays", "", True))
        self._handles = {
            control.name: inputs.add(control, partial(self._moved, control.name)) for control in declared(self.settings)
        }
        gui.add_html(spots([(name, rgb(colour)) for name, colour in FORCES]))
        lines = (("approach", GREEN), ("retract", BLUE))
        series = [{"label": name, "stroke": colour, "width": 2} for name, colour in lines]
        nothing = (np.arange(2.0), np.full(2, np.nan), np.full(2, np.nan))
        self._curve = gui.add_uplot(
            nothing,
            ({"label": "height"}, *series),
            title="Force on the tool; attraction is negative",
            axes=(
                AXIS | {"label": "height of the tool above touch [µm]"},
                AXIS | {"label": "force [nN]"},
            ),
            scales={"x": {"time": False}},
            height=220,
        )

    def turn(self, is_shown: bool) -> None:
        """Show or hide it."""
        self.root.visible = is_shown
        self._due |= {"curve"} if is_shown else set()

    def take(self, trace: Trace) -> None:
        """Show a trial, from its start."""
        self._where, self.trace, self._began = trial_shapes(trace), trace, time.monotonic()
        self._said.content = outcome(trace)

    def hold(self, moment: float) -> None:
        """Stop at a moment of the trial [%], and show it."""
        self._plays.value, self._moment.value = False, moment
        self.show()

    def _moved(self, name: str, value: Any) -> None:
        """Take another value of a setting; if it is refused, show the present one again.

        Raises:
            UserError: it does.
        """
        try:
            self.settings = self.settings.changed(name, value)
        finally:
            for own, handle in self._handles.items():
                show(handle, "value", getattr(self.settings, own))
        self.trace = None
        self._due.add("curve")
        self.show()

    def work(self) -> bool:
        """Compute what is due; return whether anything was. What fails is no longer due."""
        if "curve" in self._due:
            self._due.discard("curve")
            self._curve.data = self.settings.curve()
        elif "trial" in self._due:
            self._due.discard("trial")
            self._said.content = "Computing some 25 000 physics steps of 1 µs ..."
            settings = self.settings
            try:
                trace = settings.trace()
            except Exception:
                self._said.content = "The trial failed."
                raise
            if settings == self.settings:
                self.take(trace)
            else:
                self._said.content = "The settings have changed meanwhile."
        else:
            return False
        return True

    def show(self) -> None:
        """Draw the moment that is due."""
        trace, k = self.trace, self._scale
        if trace is None:
            self._place(self.settings)
            return
        n = len(trace.time)
        if self._plays.value:
            self._moment.value = round(100 * ((time.monotonic() - self._began) / SHOWN_S % 1), 1)
        sample = min(n - 1, int(self._moment.value / 100 * n))
        if sample == self._shown:
            return
        self._shown, where = sample, self._where
        self._ball.position, self._mark.position, self._probe.position = (
            tuple(k * part[sample]) for part in (where.ball, where.mark, where.probe)
        )
        self._ball.color = rgb(ORANGE if trace.on_plate_potential[sample] else GREEN)
        ends = np.stack([where.origins[sample], where.origins[sample] + where.arrows[sample]], axis=1)
        self._arrows.points = (k * ends).astype(np.float32)
        phase, volts = trace.phases[trace.phase[sample]], trace.voltage[sample]
        self._said.content = f"{outcome(trace)}\n\n{1e3 * trace.time[sample]:.2f} ms · {phase} · {volts:.1f} V"

    def _place(self, settings: BenchSettings) -> None:
        """Put tool and ball where a trial begins."""
        k, self._shown = self._scale, -1
        radius = k * settings.radius
        self._ball.radius, self._mark.radius, self._probe.radius = radius, 0.08 * radius, k * settings.probe_radius
        self._ball.position, self._mark.position = (0, 0, radius), (0.3 * radius, -0.8 * radius, 1.52 * radius)
        self._probe.position = (0, 0, 2 * radius + k * (5 + PROBE_LENGTH / 2))
        self._ball.color, self._arrows.points = rgb(ORANGE), np.zeros((3, 2, 3), np.float32)
