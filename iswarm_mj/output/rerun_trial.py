"""Trace of a trial -> Rerun recording (.rrd): SI in, um and nN out. What does not move is in `rerun_trial_view`."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from jaxtyping import Float

from iswarm_mj import __version__
from iswarm_mj.gripper.bench.trial_trace import Trace, thinned
from iswarm_mj.output import rerun_trial_view as look
from iswarm_mj.output.rerun_format import RrdFile, columns_of, durations, send_properties
from iswarm_mj.output.trace_lines import LINES
from iswarm_mj.output.trial_shapes import trial_shapes
from iswarm_mj.utils.files import atomic_write

SAMPLES = 4000
"""Longer traces are thinned to about this number of samples."""
_BLOCK = 1000
"""Samples per block, for quick seeking."""

Index = Callable[[Float[np.ndarray, "T"]], list[rr.TimeColumn]]
"""From times of samples [s] to their columns."""


def record_trace(path: str | Path, trace: Trace, settings: Mapping[str, Any]) -> None:
    """Write the recording of a trial, whole or not at all.

    Args:
        path: the file to write, by custom `*.rrd`; an existing one is replaced.
        trace: at least two samples; long ones are thinned.
        settings: shown as a table, and stored with the package's version as property `settings`; may be nested.

    Raises:
        UserError: the file cannot be written, or recording is switched off by the environment.
    """
    path = Path(path)
    with atomic_write(path) as part:
        file = RrdFile("iswarm_mj_grasp", part, look.layout(trace), path)
        try:
            stream, shown = file.stream, {"version": __version__, **settings}
            stream.send_recording_name(path.stem)
            send_properties(stream, "settings", shown)
            for entity, archetype in look.static_entities(trace, shown):
                stream.log(entity, archetype, static=True, strict=True)
            send_trace(stream, thinned(trace, SAMPLES), lambda time: [durations(time)])
            file.flush()
        finally:
            file.close()


def send_trace(stream: rr.RecordingStream, trace: Trace, index: Index, root: str = "") -> None:
    """Write all that changes in a trial.

    Args:
        stream: where it goes.
        trace: of the trial.
        index: of its times.
        root: what precedes the names of its entities.
    """
    moving = list(_moving(trace))
    for start in range(0, len(trace.time), _BLOCK):
        times = index(trace.time[start : start + _BLOCK])
        for entity, archetype, fields in moving:
            parts = {name: values[start : start + _BLOCK] for name, values in fields.items()}
            n_rows, size = next(iter(parts.values())).shape[:2]
            shown = archetype.from_fields(**{n: part.reshape(-1, *part.shape[2:]) for n, part in parts.items()})
            stream.send_columns(root + entity, times, columns_of(shown, {}, n_rows, size), strict=True)
    for entity, states in states_of(trace).items():
        changes = np.flatnonzero(np.append(True, states[1:] != states[:-1]))
        sent = rr.StateChange.columns(state=[str(state) for state in states[changes]])
        stream.send_columns(root + entity, index(trace.time[changes]), sent, strict=True)


def _moving(trace: Trace) -> Iterator[tuple[str, Any, dict[str, np.ndarray]]]:
    """Entity, archetype and fields (T, instances, ...) of bodies, forces and time series."""
    shapes = trial_shapes(trace)
    classes = np.where(trace.on_plate_potential, 0, 1).astype(np.uint16)
    yield look.PROBE, rr.Cylinders3D, {"centers": shapes.probe[:, None]}
    yield look.BALL, rr.Points3D, {"positions": shapes.ball[:, None], "class_ids": classes[:, None]}
    yield look.SHADOW, rr.Cylinders3D, {"centers": (shapes.ball * np.array([1, 1, 0]))[:, None]}
    yield look.BALL_MARK, rr.Points3D, {"positions": shapes.mark[:, None]}
    yield look.FORCES, rr.Arrows3D, {"origins": shapes.origins, "vectors": shapes.arrows}
    for line in LINES:
        values = np.broadcast_to(np.asarray(getattr(trace, line.field) * line.factor, float), len(trace.time))
        yield f"series/{line.name}", rr.Scalars, {"scalars": values[:, None]}


def states_of(trace: Trace) -> dict[str, np.ndarray]:
    """Entity -> (T,) names of states."""
    plate, both, tool, free = look.STATES[look.PLACE]
    at_tool, at_plate = trace.gap_tool <= 0, trace.gap_plate <= 0
    return {
        look.PHASE: np.array(trace.phases)[trace.phase],
        look.PLACE: np.where(at_tool, np.where(at_plate, both, tool), np.where(at_plate, plate, free)),
        look.POTENTIAL: np.where(trace.on_plate_potential, *look.STATES[look.POTENTIAL]),
    }
