"""Trials of a swarm's attempts in the recording of its arena, so that a pick-up can be opened at both scales.

An attempt that was decided in control step s plays at the end of step s - 1 on the timeline `sim_time`, in milliseconds
while the arena stands still; of several in one step one after the other. Attempts are logged below `grasp`, each with
a line in a list that leads to its time, and with a mark in the arena.
"""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float

from iswarm_mj.gripper.bench.tracing import Trace, thinned, trace_attempt
from iswarm_mj.gripper.handling import Tried
from iswarm_mj.output import rerun_trial as look
from iswarm_mj.output.palette import GREEN, ORANGE, rgb
from iswarm_mj.output.rerun_format import blueprint, durations, space
from iswarm_mj.output.rerun_swarm import content
from iswarm_mj.output.trajectory import Scene
from iswarm_mj.output.trial_shapes import UM

ROOT, LOG, MARKS = "grasp/", "grasp/log", "world/grasps"
SAMPLES = 600
"""Longer traces are thinned to about this number of samples."""
_SIZED = (look.PLATE, look.PROBE, look.BALL, look.BALL_MARK, look.SHADOW, look.FORCES)
"""Entities that have another size with another ball."""
_SPAN = 4e-3
"""Of the time series about the cursor [s]."""


class AttemptView:
    """Writes the trials of the first attempts of a run into a recording."""

    def __init__(self, stream: rr.RecordingStream, scene: Scene, gap: float, limit: int):
        """Write the layout.

        Args:
            stream: of the arena's recording, at its start.
            scene: of the arena.
            gap: of releases [m].
            limit: attempts that are written at most.
        """
        self._stream, self._period, self._gap, self._left = stream, scene.control_period, gap, limit
        self._count = 0
        stream.send_blueprint(layout(scene), make_active=True, make_default=True)

    def append(self, step: int, attempts: Sequence[Tried], balls: Float[np.ndarray, "K 2"]) -> None:
        """Write the trials of the attempts of one control step.

        Args:
            step: its number, from 1.
            attempts: that were decided in it.
            balls: where all balls are [mm].
        """
        chosen = attempts[: self._left]
        if not chosen:
            return
        self._left -= len(chosen)
        start = (step - 1) * self._period
        self._mark(step, chosen, balls)
        for tried in chosen:
            self._count += 1
            trace, _ = trace_attempt(tried, self._gap)
            self._write(trace, tried, step, start)
            start += float(trace.time[-1] - trace.time[0])

    def _mark(self, step: int, attempts: Sequence[Tried], balls: Float[np.ndarray, "K 2"]) -> None:
        """Mark attempts in the arena, until their step is over."""
        self._at((step - 1) * self._period, step - 1)
        marks = rr.Points3D(
            [[*balls[tried.ball], 2.0] for tried in attempts],
            radii=rr.Radius.ui_points(9.0),
            colors=[_colour(tried) for tried in attempts],
            labels=[f"attempt {k}: {outcome(tried)}" for k, tried in enumerate(attempts, start=self._count + 1)],
        )
        self._stream.log(MARKS, marks)
        self._at(step * self._period, step)
        self._stream.log(MARKS, rr.Points3D([]))
        self._stream.reset_time()

    def _at(self, seconds: float, step: int) -> None:
        self._stream.set_time("sim_time", duration=np.timedelta64(round(seconds * 1e9), "ns"))
        self._stream.set_time("step", sequence=step)

    def _write(self, trace: Trace, tried: Tried, step: int, start: float) -> None:
        """Write one trial, which begins at a time [s], and its line in the list."""
        self._at(start, step - 1)
        for entity, archetype in look.static_entities(trace):
            if entity in _SIZED or self._count == 1:
                self._stream.log(ROOT + entity, archetype, static=entity not in _SIZED, strict=True)
        about = f"{tried.voltage:.0f} V, {tried.radius * UM:.1f} µm, {tried.misalignment * UM:.1f} µm beside the axis"
        text = f"attempt {self._count} at ball {tried.ball}: {outcome(tried)} ({about})"
        self._stream.log(LOG, rr.TextLog(text, level="INFO" if tried.succeeded else "WARN", color=_colour(tried)))
        self._stream.reset_time()

        def index(time: np.ndarray) -> list[rr.TimeColumn]:
            steps = rr.TimeColumn("step", sequence=np.full(len(time), step))
            return [durations(start + time - trace.time[0]), steps]

        look.send_trace(self._stream, thinned(trace, SAMPLES), index, ROOT)


def _colour(tried: Tried) -> tuple[int, int, int]:
    return rgb(GREEN if tried.succeeded else ORANGE)


def outcome(tried: Tried) -> str:
    """What came of an attempt, in words."""
    return ("" if tried.succeeded else "not ") + ("lifted" if tried.is_lift else "released")


def layout(scene: Scene) -> rrb.Blueprint:
    """Return the layout: the arena with its panels above; the list of attempts, the bench and its plots below."""
    bench = space(f"{ROOT}world", "Grasp (µm)", (24, -120, 24), (4, 0, 30))
    near = tuple(rr.TimeRangeBoundary.cursor_relative(seconds=side * _SPAN / 2) for side in (-1, 1))
    series = [look.plot(name, ROOT, "LeftTop", span=near) for name in ("voltage", "gaps", "attraction")]
    lines = rrb.TextLogView(origin=LOG, name="Attempts; a click on a time shows its grasp")
    middle = rrb.Vertical(bench, look.states_view(ROOT), row_shares=[2, 1])
    below = rrb.Horizontal(lines, middle, rrb.Vertical(*series, name="Grasp over time"), column_shares=[2, 3, 3])
    return blueprint(rrb.Vertical(content(scene), below, row_shares=[1, 1]))
