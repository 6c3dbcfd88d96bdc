"""Common parts of all Rerun recordings: their files, settings as properties, columns, views."""

import ctypes
import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any
from weakref import WeakSet

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings
from jaxtyping import Float, Int

from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import check_name, flat, only_writer

_END_MARK = b"RRF2FOOT"
"""Mark of the index of a complete file, which is followed by four more bytes."""
FLUSH_SECONDS = 30.0
"""Time limit of a flush; without one Rerun waits for ever when the disk is full [s]."""
ROOM = 2**20
"""Free space that a recording needs before more is written [bytes]."""
_BACKGROUND = (24, 26, 30)
"""Colour of the ground of spatial views."""
Point = tuple[float, float, float]

_unfinished: WeakSet[rr.RecordingStream] = WeakSet()
"""Streams whose file is not complete."""


def check_recordings(stream: rr.RecordingStream | None = None) -> None:
    """Check that Rerun is enabled, for instance before anything is computed or removed.

    Raises:
        UserError: the environment disables it.
    """
    # Without properties: Rerun warns of what a stream holds that is freed without a file.
    probe = stream or rr.RecordingStream("iswarm_mj", send_properties=False)
    if not rr.is_enabled(probe):
        raise UserError(
            "Recordings are disabled by the environment variable "
            f"RERUN={os.environ.get('RERUN', '')}; "
            "unset it, set it to 1, or run without a recording."
        )


def free_finished_streams() -> None:
    """Free the threads and the memory of recordings that are complete.

    Rerun keeps each stream for ever (rerun-io/rerun#2116): four threads and some megabytes for each
    recording. `rerun.init` calls the same function for this reason. It first flushes all streams,
    which never ends for one whose disk is full. So nothing is freed while the file of a stream is
    open, and nothing ever again once a stream has failed.
    """
    if _unfinished:
        return
    global_stream = rr.get_global_data_recording()
    rerun_bindings.flush_and_cleanup_orphaned_recordings()
    if global_stream is not None:  # of the user's, which that function forgets
        rr.set_global_data_recording(global_stream)


class _Layout(rrb.Blueprint):
    """A layout of the viewer that knows the stream by which it is written.

    That stream refers to itself by the memory that it writes to, so that Rerun never frees it
    unless it is disconnected; `RecordingStream.save` does not.
    """

    def __init__(self, layout: rrb.Blueprint):
        """Take the views and panels of a layout."""
        vars(self).update(vars(layout))
        self._stream: rr.RecordingStream | None = None

    def _log_to_stream(self, stream: rr.RecordingStream) -> None:
        self._stream = stream
        super()._log_to_stream(stream)

    def free(self) -> None:
        """Let Rerun free the stream, once the layout is written."""
        if self._stream is not None:
            self._stream.disconnect()
            self._stream = None


class RrdFile:
    """A Rerun recording in a file; what was flushed is readable, whatever happens to the process.

    All methods raise a UserError if the file cannot be written.

    Attributes:
        stream: stream of the recording, to which entities are sent.
    """

    def __init__(
        self, application: str, path: Path, layout: rrb.Blueprint, name_in_errors: str | Path = ""
    ):
        """Open the file.

        Args:
            application: name of the application, whose recordings share the viewer's layout.
            path: the file to write; an existing one is replaced.
            layout: layout of the viewer.
            name_in_errors: name of the file in errors; by default `path`.

        Raises:
            UserError: the environment disables recordings, the name does not end in .rrd, or
                another process writes the file.
        """
        free_finished_streams()
        self._path = path
        self._name = str(name_in_errors or path)
        self.stream = rr.RecordingStream(application)
        check_recordings(self.stream)
        check_name(self._name, ".rrd", setting="path")
        with ExitStack() as lock:
            with self._explaining_errors():
                # Opening to append changes nothing; an error explains what is wrong with the name.
                path.open("ab").close()
                lock.enter_context(only_writer(path, setting="file"))
                path.open("wb").close()
                check_room(path)
                _unfinished.add(self.stream)
                own_layout = _Layout(layout)
                self.stream.save(path, default_blueprint=own_layout)
                own_layout.free()
            self._lock = lock.pop_all()
        self.stream.set_log_time_enabled(False)
        self.stream.set_log_tick_enabled(False)

    @contextmanager
    def _explaining_errors(self) -> Iterator[None]:
        """Raise a UserError if the block fails, and keep a stream that failed for ever.

        Rerun's thread of the stream may have given up, and Rerun waits for that thread without end
        when Python frees the stream, and at the end of the process.
        """
        try:
            yield
        except (OSError, RuntimeError, ValueError) as error:  # ValueError: a null byte in the name
            ctypes.pythonapi.Py_IncRef(ctypes.py_object(self.stream))
            rr.unregister_shutdown()
            cause = str(error)
            if isinstance(error, OSError) and error.errno:
                cause = os.strerror(error.errno)
            raise UserError(
                f"The recording {self._name!r} cannot be written ({cause}): make room, or give a "
                "file name in an existing folder that you may write to."
            ) from error

    def flush(self) -> None:
        """Write everything to the file.

        Where there is no room, Rerun itself only logs that and waits, hence the short timeouts.
        """
        with self._explaining_errors():
            for _ in range(round(FLUSH_SECONDS)):
                try:
                    self.stream.flush(timeout_sec=1.0)
                except RuntimeError:
                    check_room(self._path)
                else:
                    return
            raise RuntimeError(f"not done within {FLUSH_SECONDS:g} s")

    def close(self) -> None:
        """Complete the file."""
        with self._lock, self._explaining_errors():
            check_room(self._path)
            self.stream.disconnect()
            if self._path.is_file():
                self._check_end()
            _unfinished.discard(self.stream)

    def _check_end(self) -> None:
        """Raise a RuntimeError if the file does not end with an index."""
        n_bytes = len(_END_MARK) + 4
        with self._path.open("rb") as file:
            file.seek(-min(n_bytes, self._path.stat().st_size), os.SEEK_END)
            if not file.read().startswith(_END_MARK):
                raise RuntimeError("No space left for its end, or another fault of the disk")


def check_room(path: Path) -> None:
    """Raise an OSError if the disk, or the limit of the size of files, has no room for more.

    Args:
        path: the file that is to grow; a special file, such as a pipe, is not checked.
    """
    if not path.is_file():
        return
    probe = path.parent / f".{os.getpid()}-{path.name}"
    try:
        with probe.open("wb") as file:
            file.truncate(path.stat().st_size + ROOM)
            file.write(bytes(ROOM))
            file.flush()
            os.fsync(file.fileno())
    finally:
        probe.unlink(missing_ok=True)


def flatten(values: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield dotted names and values (bool, number or text) of nested mappings and dataclasses."""
    mappings = {}
    for key, value in values.items():
        if is_dataclass(value) and not isinstance(value, type):
            value = asdict(value)
        mappings[key] = value
    for name, value in flat(mappings):
        plain = value.tolist() if isinstance(value, np.ndarray | np.generic) else value
        yield name, plain if isinstance(plain, bool | int | float | str) else str(plain)


def send_properties(stream: rr.RecordingStream, name: str, values: Mapping[str, Any]) -> None:
    """Send nested settings as a property of the recording, if there are any."""
    # As Arrow arrays: Rerun otherwise casts a value to the type that its name first had.
    arrays = {key: pa.array([value]) for key, value in flatten(values)}
    if arrays:
        stream.send_property(name, rr.AnyValues(**arrays))


def durations(seconds: Float[np.ndarray, "T"]) -> rr.TimeColumn:
    """Return times [s] as a column of the timeline `sim_time`."""
    nanoseconds = np.rint(seconds * 1e9).astype("timedelta64[ns]")
    return rr.TimeColumn("sim_time", duration=nanoseconds)


def index(step: Int[np.ndarray, "T"], period: float) -> list[rr.TimeColumn]:
    """Return the columns of time of control steps.

    Args:
        step: numbers of the steps.
        period: duration of a step [s].
    """
    steps = np.asarray(step, np.int64)
    return [rr.TimeColumn("step", sequence=steps), durations(steps * float(period))]


def columns_of(
    shown: rr.AsComponents,
    values: Mapping[str, np.ndarray],
    n_rows: int,
    lengths: Int[np.ndarray, "T"] | int,
) -> list[rr.ComponentColumn]:
    """Return components as columns of time.

    Rerun's own `columns` first makes a row of each instance, which takes as long again.

    Args:
        shown: an archetype with the instances of all rows.
        values: further components by name, one value for each instance.
        n_rows: number of rows.
        lengths: number of instances of each row; a number if it is the same in all rows.
    """
    row_lengths = np.full(n_rows, lengths) if isinstance(lengths, int) else lengths
    offsets = np.append(0, np.cumsum(row_lengths)).astype(np.int32)

    batches: dict[Any, Any] = {}
    for part in shown.as_component_batches():
        batches[part.component_descriptor()] = part
    for name, value in values.items():
        # As Arrow arrays: of an empty one Rerun otherwise does not know the type.
        batches[name] = rr.AnyBatchValue(name, pa.array(value.ravel()))
    return [rr.ComponentColumn(name, batch, offsets=offsets) for name, batch in batches.items()]


WHOLE_TIME = (rr.TimeRangeBoundary.infinite(), rr.TimeRangeBoundary.infinite())
"""Range of a plot that shows all times."""


def time_series(
    origin: str,
    name: str,
    corner: str | None = "LeftTop",
    span: tuple[rr.TimeRangeBoundary, ...] = WHOLE_TIME,
    **more: Any,
) -> rrb.TimeSeriesView:
    """Return a plot of the series below an entity.

    Args:
        origin: the entity.
        name: title of the plot.
        corner: corner of the legend, a name in `rrb.Corner2D`; None for no legend.
        span: range of times.
        more: further settings of the view.
    """
    start, end = span
    legend = rrb.PlotLegend(
        corner=getattr(rrb.Corner2D, corner or "LeftTop"), visible=corner is not None
    )
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        plot_legend=legend,
        axis_x=rrb.archetypes.TimeAxis(view_range=rr.TimeRange(start=start, end=end)),
        **more,
    )


def space(origin: str, name: str, eye: Point, target: Point, **more: Any) -> rrb.Spatial3DView:
    """Return a spatial view on a dark ground, with z upwards.

    Args:
        origin: entity whose children are shown.
        name: title of the view.
        eye: position of the camera.
        target: point that the camera looks at.
        more: further settings of the view.
    """
    controls = rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0, 0, 1))
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        eye_controls=controls,
        line_grid=False,
        background=_BACKGROUND,
        **more,
    )


def blueprint(content: rrb.Container, **time: Any) -> rrb.Blueprint:
    """Return a layout of these views, with all panels closed.

    Args:
        content: the views.
        time: further settings of the panel of time.
    """
    return rrb.Blueprint(
        content,
        rrb.TimePanel(timeline="sim_time", state="collapsed", **time),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )
