"""Trials of a swarm's attempts in the recording of its arena, which so shows both scales.

An attempt that was decided in control step s plays at the end of step s - 1 on the timeline
`sim_time`, in milliseconds while the arena stands still; several of one step play one after the
other. Attempts are logged below `grasp`, each with a line in a list that leads to its time, and
with a mark in the arena.
"""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float

from iswarm_mj.config.static import StaticGripper
from iswarm_mj.gripper.bench.tracing import Trace, thinned, trace_attempt
from iswarm_mj.gripper.handling import Tried
from iswarm_mj.output import rerun_trial
from iswarm_mj.output.palette import GREEN, ORANGE, Rgb, rgb
from iswarm_mj.output.rerun_format import blueprint, durations, space
from iswarm_mj.output.rerun_swarm import swarm_views
from iswarm_mj.output.trajectory import Scene
from iswarm_mj.output.trial_shapes import UM

ROOT = "grasp/"
"""Prefix of the names of entities of trials."""
LOG = "grasp/log"
MARKS = "world/grasps"
SAMPLES = 600
"""Number of samples to which longer traces are thinned, approximately."""
_SIZED = (
    rerun_trial.PLATE,
    rerun_trial.PROBE,
    rerun_trial.BALL,
    rerun_trial.BALL_MARK,
    rerun_trial.SHADOW,
    rerun_trial.FORCES,
)
"""Entities whose size depends on the ball."""
_PLOT_SPAN = 4e-3
"""Range of the plots about the cursor [s]."""
_MARK_HEIGHT = 2.0
"""Height of the marks above the floor [mm]."""


class AttemptView:
    """Writes the trials of the first attempts of a run into a recording."""

    def __init__(
        self,
        stream: rr.RecordingStream,
        scene: Scene,
        gripper: StaticGripper,
        limit: int,
    ):
        """Write the layout.

        Args:
            stream: stream of the arena's recording, at its start.
            scene: constants of the world.
            gripper: gap, tip and protocol of the attempts.
            limit: maximum number of attempts that are written.
        """
        self._stream = stream
        self._period = scene.control_period
        self._gripper = gripper
        self._n_left = limit
        self._n_written = 0
        stream.send_blueprint(layout(scene), make_active=True, make_default=True)

    def append(self, step: int, attempts: Sequence[Tried], balls: Float[np.ndarray, "K 2"]) -> None:
        """Write the trials of the attempts of one control step.

        Args:
            step: number of the step, from 1.
            attempts: attempts that were decided in the step.
            balls: positions of all balls [mm].
        """
        chosen = attempts[: self._n_left]
        if not chosen:
            return
        self._n_left -= len(chosen)
        self._mark(step, chosen, balls)
        start = (step - 1) * self._period
        for tried in chosen:
            self._n_written += 1
            trace, _ = trace_attempt(tried, self._gripper)
            self._write(trace, tried, step, start)
            start += float(trace.time[-1] - trace.time[0])

    def _mark(self, step: int, attempts: Sequence[Tried], balls: Float[np.ndarray, "K 2"]) -> None:
        """Mark attempts in the arena, until their step is over."""
        first_number = self._n_written + 1
        marks = rr.Points3D(
            [[*balls[tried.ball], _MARK_HEIGHT] for tried in attempts],
            radii=rr.Radius.ui_points(9.0),
            colors=[_colour(tried) for tried in attempts],
            labels=[
                f"attempt {number}: {outcome(tried)}"
                for number, tried in enumerate(attempts, start=first_number)
            ],
        )
        self._set_time((step - 1) * self._period, step - 1)
        self._stream.log(MARKS, marks)
        self._set_time(step * self._period, step)
        self._stream.log(MARKS, rr.Points3D([]))
        self._stream.reset_time()

    def _set_time(self, seconds: float, step: int) -> None:
        nanoseconds = np.timedelta64(round(seconds * 1e9), "ns")
        self._stream.set_time("sim_time", duration=nanoseconds)
        self._stream.set_time("step", sequence=step)

    def _write(self, trace: Trace, tried: Tried, step: int, start: float) -> None:
        """Write one trial, and its line in the list.

        Args:
            trace: trace of the trial.
            tried: the attempt.
            step: number of the control step in which it was decided.
            start: time at which it plays [s].
        """
        self._set_time(start, step - 1)
        for entity, archetype in rerun_trial.static_entities(trace):
            has_size = entity in _SIZED
            if has_size or self._n_written == 1:
                self._stream.log(ROOT + entity, archetype, static=not has_size, strict=True)
        level = "INFO" if tried.succeeded else "WARN"
        line = rr.TextLog(self._description(tried), level=level, color=_colour(tried))
        self._stream.log(LOG, line)
        self._stream.reset_time()

        def index(time: np.ndarray) -> list[rr.TimeColumn]:
            steps = rr.TimeColumn("step", sequence=np.full(len(time), step))
            return [durations(start + time - trace.time[0]), steps]

        rerun_trial.send_trace(self._stream, thinned(trace, SAMPLES), index, ROOT)

    def _description(self, tried: Tried) -> str:
        """Return the line of the attempt that was written last."""
        offset = f"{tried.misalignment * UM:.1f} µm beside the axis"
        conditions = f"{tried.voltage:.0f} V, {tried.radius * UM:.1f} µm, {offset}"
        return f"attempt {self._n_written} at ball {tried.ball}: {outcome(tried)} ({conditions})"


def _colour(tried: Tried) -> Rgb:
    return rgb(GREEN if tried.succeeded else ORANGE)


def outcome(tried: Tried) -> str:
    """Return the outcome of an attempt in words."""
    verb = "lifted" if tried.is_lift else "released"
    return verb if tried.succeeded else f"not {verb}"


def layout(scene: Scene) -> rrb.Blueprint:
    """Return the layout: the arena above; the list of attempts, the bench and its plots below."""
    bench = space(f"{ROOT}world", "Grasp (µm)", eye=(24, -120, 24), target=(4, 0, 30))
    near_cursor = (
        rr.TimeRangeBoundary.cursor_relative(seconds=-_PLOT_SPAN / 2),
        rr.TimeRangeBoundary.cursor_relative(seconds=_PLOT_SPAN / 2),
    )
    plots = [
        rerun_trial.plot(name, ROOT, corner="LeftTop", span=near_cursor)
        for name in ("voltage", "gaps", "attraction")
    ]
    log = rrb.TextLogView(origin=LOG, name="Attempts; a click on a time shows its grasp")
    below = rrb.Horizontal(
        log,
        rrb.Vertical(bench, rerun_trial.states_view(ROOT), row_shares=[2, 1]),
        rrb.Vertical(*plots, name="Grasp over time"),
        column_shares=[2, 3, 3],
    )
    return blueprint(rrb.Vertical(swarm_views(scene), below, row_shares=[1, 1]))
