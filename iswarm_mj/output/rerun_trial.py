"""Trace of a trial -> Rerun recording (.rrd): SI in, um and nN out. Its look is defined in `rerun_trial_view`."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from jaxtyping import Float

from iswarm_mj import __version__
from iswarm_mj.gripper.bench.trial_trace import Trace, thinned
from iswarm_mj.output import rerun_trial_view as look
from iswarm_mj.output.rerun_format import (
    check_recordings,
    close,
    columns_of,
    flush,
    save,
    send_properties,
    written,
)
from iswarm_mj.output.rerun_trial_view import UM
from iswarm_mj.utils.errors import SimulationFault
from iswarm_mj.utils.files import atomic_write

SAMPLES = 4000
"""Longer traces are thinned to about this number of samples."""
ARROW_FORCE = 4e-6
"""Force whose arrow is one radius long; lengths go with the square root [N]."""
_APPLICATION = "iswarm_mj_grasp"
"""Recordings of one application share the viewer's layout."""
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
        SimulationFault: a number of the trace is not finite.
        UserError: the file cannot be written, or recording is switched off by the environment.
    """
    _check(trace)
    path, stream = Path(path), rr.RecordingStream(_APPLICATION)
    check_recordings(stream)
    with atomic_write(path) as part, written(path, stream):
        save(stream, part, look.layout(trace))
        try:
            stream.send_recording_name(path.stem)
            shown = {"version": __version__, **settings}
            send_properties(stream, "settings", shown)
            for entity, archetype in look.static_entities(trace, shown):
                stream.log(entity, archetype, static=True, strict=True)
            send_trace(stream, thinned(trace, SAMPLES), time_index)
            flush(stream, part)
        finally:
            close(stream, part)


def _check(trace: Trace) -> None:
    """Refuse values that the viewer would silently draw wrong."""
    for name, values in trace._asdict().items():
        if isinstance(values, np.ndarray) and not np.isfinite(values).all():
            first = int(np.argmin(np.isfinite(values).reshape(len(values), -1).all(axis=1)))
            raise SimulationFault(f"Sample {first} of the trace: {name} is not finite.")
    if np.any(np.diff(trace.time) <= 0):
        raise ValueError("The times of a trace must increase.")


def time_index(time: Float[np.ndarray, "T"]) -> list[rr.TimeColumn]:
    """Return the column of times [s]."""
    return [rr.TimeColumn("sim_time", duration=np.rint(time * 1e9).astype("timedelta64[ns]"))]


def send_trace(stream: rr.RecordingStream, trace: Trace, index: Index, root: str = "") -> None:
    """Write all that changes in a trial.

    Args:
        stream: where it goes.
        trace: of the trial.
        index: of its times.
        root: what precedes the names of its entities.
    """
    moving, n_samples = {**_bodies(trace), **_series(trace)}, len(trace.time)
    for start in range(0, n_samples, _BLOCK):
        block = slice(start, start + _BLOCK)
        times = index(trace.time[block])
        for entity, (archetype, fields) in moving.items():
            parts = {name: values[block].reshape(-1, *values.shape[2:]) for name, values in fields.items()}
            n_rows, size = next(iter(fields.values()))[block].shape[:2]
            sent = columns_of(archetype.from_fields(**parts), {}, n_rows, size)
            stream.send_columns(root + entity, times, sent, strict=True)
    for entity, states in states_of(trace).items():
        changes = np.flatnonzero(np.append(True, states[1:] != states[:-1]))
        sent = rr.StateChange.columns(state=[str(state) for state in states[changes]])
        stream.send_columns(root + entity, index(trace.time[changes]), sent, strict=True)


def _bodies(trace: Trace) -> dict[str, tuple[Any, dict[str, np.ndarray]]]:
    """Entity -> archetype and fields (T, instances, ...) of the moving bodies and forces."""
    ball, radius = trace.ball * UM, trace.radius * UM
    mark = ball + radius * rotated(trace.ball_quaternion, np.array([0.3, -0.8, 0.52]))
    forces = np.stack([trace.electrostatic, trace.adhesion_tool, -trace.adhesion_plate], axis=1)
    arrows = np.zeros((*forces.shape, 3))
    arrows[..., 2] = np.sign(forces) * np.sqrt(np.abs(forces) / ARROW_FORCE) * radius
    origins = ball[:, None] + np.array([[1.3, 0, 0], [1.55, 0, 0], [1.8, 0, 0]]) * radius
    centre = trace.probe * UM + np.array([0, 0, look.PROBE_LENGTH / 2])
    classes = np.where(trace.on_plate_potential, 0, 1).astype(np.uint16)
    return {
        look.PROBE: (rr.Cylinders3D, {"centers": centre[:, None]}),
        look.BALL: (rr.Points3D, {"positions": ball[:, None], "class_ids": classes[:, None]}),
        look.SHADOW: (rr.Cylinders3D, {"centers": (ball * np.array([1, 1, 0]))[:, None]}),
        look.BALL_MARK: (rr.Points3D, {"positions": mark[:, None]}),
        look.FORCES: (rr.Arrows3D, {"origins": origins, "vectors": arrows}),
    }


def _series(trace: Trace) -> dict[str, tuple[Any, dict[str, np.ndarray]]]:
    """Entity -> archetype and field (T, 1) of the time series; V, um, nN."""
    values = {name: getattr(trace, line.field) * line.factor for name, line in look.SERIES.items()}
    each = {name: np.broadcast_to(np.asarray(value, float), len(trace.time)) for name, value in values.items()}
    return {name: (rr.Scalars, {"scalars": value[:, None]}) for name, value in each.items()}


def states_of(trace: Trace) -> dict[str, np.ndarray]:
    """Entity -> (T,) names of states."""
    at_tool, at_plate = trace.gap_tool <= 0, trace.gap_plate <= 0
    free, tool, plate, both = (list(look.PLACES)[i] for i in (3, 2, 0, 1))
    place = np.where(at_tool, np.where(at_plate, both, tool), np.where(at_plate, plate, free))
    of_plate, of_probe = look.POTENTIALS
    return {
        look.PHASE: np.array(trace.phases)[trace.phase],
        look.PLACE: place,
        look.POTENTIAL: np.where(trace.on_plate_potential, of_plate, of_probe),
    }


def rotated(quaternion: Float[np.ndarray, "T 4"], vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "T 3"]:
    """Rotate a vector by unit quaternions, w first."""
    w, axis = quaternion[:, :1], quaternion[:, 1:]
    cross = np.cross(axis, vector)
    return vector + 2 * (w * cross + np.cross(axis, cross))
