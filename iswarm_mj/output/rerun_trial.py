"""Trace of a trial -> Rerun recording (.rrd): SI in, um and nN out. Its look is defined in `rerun_trial_view`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from jaxtyping import Float

from iswarm_mj import __version__
from iswarm_mj.gripper.bench.trial_trace import Trace, thinned
from iswarm_mj.output import rerun_trial_view as look
from iswarm_mj.output.rerun_format import (
    FLUSH_SECONDS,
    bounded,
    close,
    leave_alone,
    require_recordings,
    send_properties,
)
from iswarm_mj.output.rerun_trial_view import NN, UM
from iswarm_mj.utils.errors import SimulationFault, UserError
from iswarm_mj.utils.files import atomic_write

SAMPLES = 4000
"""Longer traces are thinned to about this number of samples."""

ARROW_FORCE = 4e-6
"""Force whose arrow is one radius long; lengths go with the square root [N]."""

_APPLICATION = "iswarm_mj_grasp"
"""Recordings of one application share the viewer's layout."""

_BLOCK = 1000
"""Samples per block, for quick seeking."""


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
    require_recordings(stream)
    try:
        with atomic_write(path) as part:
            part.open("wb").close()
            bounded(lambda: stream.save(part, default_blueprint=look.layout(trace)))
            try:
                _write(stream, path.stem, thinned(trace, SAMPLES), {"version": __version__, **settings})
                stream.flush(timeout_sec=FLUSH_SECONDS)
            finally:
                close(stream, part)
    except (OSError, RuntimeError) as error:
        leave_alone(stream)
        raise UserError(
            f"The recording {str(path)!r} cannot be written ({error}): "
            "give a file name in an existing folder that you may write to, with room on its disk."
        ) from error


def _check(trace: Trace) -> None:
    """Refuse values that the viewer would silently draw wrong."""
    for name, values in trace._asdict().items():
        if isinstance(values, np.ndarray) and not np.isfinite(values).all():
            first = int(np.argmin(np.isfinite(values).reshape(len(values), -1).all(axis=1)))
            raise SimulationFault(f"Sample {first} of the trace: {name} is not finite.")
    if np.any(np.diff(trace.time) <= 0):
        raise ValueError("The times of a trace must increase.")


def _write(stream: rr.RecordingStream, name: str, trace: Trace, settings: Mapping[str, Any]) -> None:
    """Write a whole trace."""
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    stream.send_recording_name(name)
    send_properties(stream, "settings", settings)
    for entity, archetype in look.static_entities(trace, settings):
        stream.log(entity, archetype, static=True, strict=True)
    columns = columns_of(trace)
    count = len(trace.time)
    for start in range(0, count, _BLOCK):
        block = slice(start, start + _BLOCK)
        for entity, (archetype, sizes, values) in columns.items():
            parts = {key: value[block].reshape(-1, *value.shape[2:]) for key, value in values.items()}
            sent = archetype.columns(**parts).partition([sizes] * len(range(count)[block]))
            stream.send_columns(entity, _index(trace.time[block]), sent, strict=True)
    for entity, states in states_of(trace).items():
        changes = np.flatnonzero(np.append(True, states[1:] != states[:-1]))
        sent = rr.StateChange.columns(state=[str(state) for state in states[changes]])
        stream.send_columns(entity, _index(trace.time[changes]), sent, strict=True)


def _index(time: np.ndarray) -> list[rr.TimeColumn]:
    return [rr.TimeColumn("sim_time", duration=np.rint(time * 1e9).astype("timedelta64[ns]"))]


def columns_of(trace: Trace) -> dict[str, tuple[Any, int, dict[str, np.ndarray]]]:
    """Entity -> archetype, number of instances, and fields (T, instances, ...) of all that changes but the states."""
    return {**_bodies(trace), **_series(trace)}


def _bodies(trace: Trace) -> dict[str, tuple[Any, int, dict[str, np.ndarray]]]:
    """Entity -> archetype, number of instances, and fields (T, instances, ...) of the moving bodies and forces."""
    probe, ball = trace.probe * UM, trace.ball * UM
    mark = ball + trace.radius * UM * rotated(trace.ball_quaternion, np.array([0.3, -0.8, 0.52]))
    forces = np.stack([trace.electrostatic, trace.adhesion_tool, -trace.adhesion_plate], axis=1)
    arrows = np.zeros((*forces.shape, 3))
    arrows[..., 2] = np.sign(forces) * np.sqrt(np.abs(forces) / ARROW_FORCE) * trace.radius * UM
    origins = ball[:, None] + np.array([[1.3, 0, 0], [1.55, 0, 0], [1.8, 0, 0]]) * trace.radius * UM
    centre = probe + np.array([0, 0, look.PROBE_LENGTH / 2])
    classes = np.where(trace.on_plate_potential, 0, 1).astype(np.uint16)
    return {
        look.PROBE: (rr.Cylinders3D, 1, {"centers": centre[:, None]}),
        look.BALL: (rr.Points3D, 1, {"positions": ball[:, None], "class_ids": classes[:, None]}),
        look.SHADOW: (rr.Cylinders3D, 1, {"centers": (ball * np.array([1, 1, 0]))[:, None]}),
        look.BALL_MARK: (rr.Points3D, 1, {"positions": mark[:, None]}),
        look.FORCES: (rr.Arrows3D, 3, {"origins": origins, "vectors": arrows}),
    }


def _series(trace: Trace) -> dict[str, tuple[Any, int, dict[str, np.ndarray]]]:
    """Entity -> archetype, number of instances, and fields (T, 1) of the time series; V, um, nN."""
    values = {
        "series/voltage/voltage": trace.voltage,
        "series/gaps/tool": trace.gap_tool * UM,
        "series/gaps/plate": trace.gap_plate * UM,
        "series/attraction/electrostatic": trace.electrostatic * NN,
        "series/attraction/tool": trace.adhesion_tool * NN,
        "series/attraction/plate": trace.adhesion_plate * NN,
        "series/attraction/weight": np.full(len(trace.time), trace.weight * NN),
        "series/contact/tool": trace.contact_tool * NN,
        "series/contact/plate": trace.contact_plate * NN,
    }
    return {name: (rr.Scalars, 1, {"scalars": np.asarray(values[name], float)[:, None]}) for name in look.SERIES}


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
