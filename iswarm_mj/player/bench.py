"""The gripper's bench on the page: a trial in slow motion, and a force curve."""

import time
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.gripper.bench.tracing import Trace
from iswarm_mj.output.legend import Entry, Group
from iswarm_mj.output.palette import BLUE, GREEN, ORANGE, PALE, WALL, YELLOW, rgb
from iswarm_mj.output.trial_shapes import PROBE_LENGTH, trial_shapes
from iswarm_mj.player.bench_settings import BenchSettings
from iswarm_mj.player.bench_tip import TipPlot, tip_mesh
from iswarm_mj.player.controls import Control, declared
from iswarm_mj.player.inputs import Inputs
from iswarm_mj.player.view import linear
from iswarm_mj.player.widgets import AXIS, show, spots
from iswarm_mj.utils.constraints import Within, check_kind
from iswarm_mj.utils.errors import UserError

_ROOT = "/bench"
FORCES = (
    ("electrostatic", YELLOW),
    ("adhesion to the tool", GREEN),
    ("adhesion to the plate", ORANGE),
)
"""Forces on the ball that have an arrow, with its colour."""
SHOWN_S = 15.0
"""Duration in which a trial is shown [s]."""
CALIBRATIONS = {"the paper's balls": BenchSettings()}
"""Settings of the bench by their names, without a fit."""


def calibrations_of(fits: Sequence[Any]) -> dict[str, BenchSettings]:
    """Return settings of the bench by their names; those of the paper come last.

    Args:
        fits: each a `Fit` of `iswarm_mj.fit`, `GraspSettings`, or the path of a fit.toml.

    Raises:
        UserError: a file cannot be read, or has what the page cannot show.
    """
    if not fits:
        return CALIBRATIONS

    # The module of fits takes long to import.
    from iswarm_mj.workflows.fit import Fit, grasp_settings
    from iswarm_mj.workflows.grasp_settings import GraspSettings, read_settings, settings_of

    of_fits: dict[str, BenchSettings] = {}
    for number, given in enumerate(fits, start=1):
        name = f"fit {number}"
        if isinstance(given, Fit):
            settings = settings_of(grasp_settings(given), source=name)
        elif isinstance(given, GraspSettings):
            settings = given
        else:
            check_kind("fits", given, (str, Path, Fit, GraspSettings))
            name = str(given)
            settings = read_settings(Path(given))
        of_fits[name] = BenchSettings.of(settings)
    return of_fits | CALIBRATIONS


_OF_SETTINGS = {"laws", "curve"}
"""What is computed again for other settings."""
_BEFORE_TRIAL = "Click on the button to watch a trial in slow motion."
_EXPLANATION = (
    "The ball is orange with the potential of the plate, and green with that of the tool. "
    "The black dot shows how it turns. The plate is 150 µm wide."
)
_WITHOUT_CURVE = (
    "There is no force curve of a rounded tip, whose forces at a distance are unknown; "
    "`iswarm tip --table` computes them."
)
_NO_CURVE = (np.arange(2.0), np.full(2, np.nan), np.full(2, np.nan))
_NO_ARROWS = np.zeros((len(FORCES), 2, 3), np.float32)
_ON_PLATE = 1e-7
"""Largest gap at which a ball lies on the plate after the release [m]."""


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


def describe_laws(settings: BenchSettings) -> str:
    """Return least voltages and pull-off forces by the laws, as a table in Markdown."""
    laws = settings.laws
    melting = settings.trial.contacts.breaks_at
    grasp = f"{laws.grasp_voltage:.1f} V" if laws.grasp_voltage > 0 else "none: adhesion does"
    release = f"{laws.release_voltage:.1f} V" if laws.release_voltage > 0 else "none: weight does"
    rows = [
        ("least voltage to lift the ball", grasp),
        (f"least voltage to release it over {settings.gap:g} µm", release),
        ("pull-off force from the plate", f"{laws.pull_off_plate:.0f} nN"),
        ("pull-off force from the tool", f"{laws.pull_off_tool:.0f} nN"),
    ]
    if laws.grasp_voltage > melting:
        rows.append(("voltage that melts the ball first", f"{melting:.0f} V"))
    lines = [f"| {name} | {value} |" for name, value in rows]
    return "\n".join(["| by the laws | |", "|---|---|", *lines])


class Bench:
    """Nodes and controls of the bench.

    Attributes:
        settings: settings of the ball and the tool.
        root: parent of all nodes, which is hidden at first.
        trace: trial that is shown; None before the first.
    """

    def __init__(
        self,
        server: Any,
        inputs: Inputs,
        size: float,
        calibrations: Mapping[str, BenchSettings] = CALIBRATIONS,
    ):
        """Make the nodes, which are hidden, and the controls, in the present container.

        Args:
            server: viser server of the page.
            inputs: inputs of the page.
            size: diameter of a ball of 15 µm in the scene [mm].
            calibrations: settings that can be chosen, by their names; those of the first one are
                shown at first.
        """
        self._calibrations = calibrations
        self.settings = next(iter(calibrations.values()))
        self.trace: Trace | None = None
        self._scale = size / 30
        self._due = set[str]()
        self._began = 0.0
        self._shown_sample = -1
        self._drawn_settings = self.settings
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
        vertices, faces = self._tip_mesh(self.settings)
        self._probe = drawn.add_mesh_simple(
            f"{_ROOT}/probe",
            vertices,
            faces,
            color=rgb(PALE),
            opacity=0.7,
            flat_shading=True,
            side="double",
            cast_shadow=False,
        )
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

    def _tip_mesh(self, settings: BenchSettings) -> tuple[np.ndarray, np.ndarray]:
        """Return vertices and faces of the tip in the scene."""
        vertices, faces = tip_mesh(settings.profile, settings.in_si.radii[0])
        return self._scale * vertices, faces

    def _add_controls(self, gui: Any, inputs: Inputs) -> None:
        """Add the trial, the settings and the force curve to the panel."""
        inputs.add_button(
            "Lift and release the ball",
            lambda _: self._due.add("trial"),
            icon="arrow-bar-up",
        )
        self._text = gui.add_markdown(_BEFORE_TRIAL)
        film_position = Control(
            "film position",
            "",
            0.0,
            limits=Within(0.0, 100.0, "%"),
            text="What the slow-motion film of the trial shows, from its start to its end.",
            step=0.1,
        )
        self._film_position = inputs.add(film_position)
        is_filmed = Control("play film", "", True, text="Repeat the film; untick it to stop.")
        self._plays_film = inputs.add(is_filmed)
        forces = [Entry(name, rgb(colour)) for name, colour in FORCES]
        gui.add_html(spots([Group("Forces on the ball", forces)]))
        gui.add_markdown(_EXPLANATION)

        self._handles = {}
        if len(self._calibrations) > 1:
            calibration = Control(
                "calibration",
                "",
                next(iter(self._calibrations)),
                choices=tuple(self._calibrations),
                text="Where works of adhesion, humidity and tip come from.",
            )
            inputs.add(calibration, self._calibrate)
        self._laws = gui.add_markdown("")
        for control in declared(self.settings):
            self._handles[control.name] = inputs.add(control, partial(self._move, control.name))
        self._add_curve(gui)
        self._tip = TipPlot(gui)

    def _add_curve(self, gui: Any) -> None:
        """Add the plot of the force curve, without data."""
        self._curve = gui.add_uplot(
            _NO_CURVE,
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
            self._due |= _OF_SETTINGS

    def take(self, trace: Trace) -> None:
        """Show a trial, from its start."""
        self._shapes = trial_shapes(trace)
        self.trace = trace
        self._began = time.monotonic()
        self._text.content = outcome(trace)

    def hold(self, moment: float) -> None:
        """Stop at a moment of the trial [%], and show it."""
        self._plays_film.value = False
        self._film_position.value = moment
        self.show()

    def _move(self, name: str, value: Any) -> None:
        """Take another value of a setting; if it is refused, show the present one again.

        Raises:
            UserError: the settings do not fit each other.
        """
        try:
            settings = self.settings.changed(name, value)
        except UserError:
            self._show_values()
            raise
        self._take_settings(settings)

    def _calibrate(self, name: str) -> None:
        """Take the settings of a calibration."""
        self._take_settings(self._calibrations[name])

    def _take_settings(self, settings: BenchSettings) -> None:
        """Show other settings; a trial with the earlier ones is shown no longer."""
        self.settings = settings
        self._show_values()
        self.trace = None
        self._text.content = _BEFORE_TRIAL
        self._due |= _OF_SETTINGS
        self.show()

    def _show_values(self) -> None:
        """Let the inputs show the present settings."""
        for setting, handle in self._handles.items():
            show(handle, "value", getattr(self.settings, setting))

    def work(self) -> bool:
        """Compute what is due; return whether anything was. What fails is no longer due."""
        settings = self.settings
        if "laws" in self._due:
            self._due.discard("laws")
            self._laws.content = describe_laws(settings)
            self._tip.draw(settings.profile, settings.in_si.radii[0])
            return True
        if "curve" in self._due:
            self._due.discard("curve")
            self._draw_curve(settings)
            return True
        if "trial" in self._due:
            self._due.discard("trial")
            self._compute_trial()
            return True
        return False

    def _draw_curve(self, settings: BenchSettings) -> None:
        """Draw the force curve, and state its pull-off force beside what the laws say."""
        self._curve.visible = settings.has_curve
        if not settings.has_curve:
            self._laws.content = f"{describe_laws(settings)}\n\n{_WITHOUT_CURVE}"
            return
        heights, approaching, retracting = settings.curve()
        self._curve.data = (heights, approaching, retracting)
        if settings == self.settings:
            pull_off = -retracting.min()
            sentence = f"Pull-off force in the curve, at {settings.voltage:g} V: {pull_off:.0f} nN"
            self._laws.content = f"{describe_laws(settings)}\n\n{sentence}"

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
        if self._plays_film.value:
            share_of_film = (time.monotonic() - self._began) / SHOWN_S % 1
            self._film_position.value = round(100 * share_of_film, 1)
        n_samples = len(trace.time)
        sample = min(n_samples - 1, int(self._film_position.value / 100 * n_samples))
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
        if settings is not self._drawn_settings:
            self._drawn_settings = settings
            self._probe.vertices, self._probe.faces = self._tip_mesh(settings)
        self._ball.position = (0, 0, radius)
        self._mark.position = (0.3 * radius, -0.8 * radius, 1.52 * radius)
        self._probe.position = (0, 0, 2 * radius + scale * (5 + PROBE_LENGTH / 2))
        self._ball.color = rgb(ORANGE)
        self._arrows.points = _NO_ARROWS.copy()
