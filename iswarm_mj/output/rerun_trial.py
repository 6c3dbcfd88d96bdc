"""Trace of a trial -> Rerun recording (.rrd): SI in, um and nN out; its look, what moves, and the viewer's layout."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from jaxtyping import Float

from iswarm_mj._version import __version__
from iswarm_mj.gripper.bench.tracing import Trace, thinned
from iswarm_mj.output import rerun_format as views
from iswarm_mj.output.palette import GREEN, GREY, ORANGE, PALE, PURPLE, SKY, WALL, YELLOW, rgb
from iswarm_mj.output.rerun_format import RrdFile, columns_of, durations, send_properties
from iswarm_mj.output.trial_shapes import LINES, NN, PROBE_LENGTH, UM, trial_shapes
from iswarm_mj.utils.files import atomic_write

SAMPLES = 4000
"""Longer traces are thinned to about this number of samples."""
_BLOCK = 1000
"""Samples per block, for quick seeking."""

Index = Callable[[Float[np.ndarray, "T"]], list[rr.TimeColumn]]
"""From times of samples [s] to their columns."""
PLATE, PROBE = "world/plate", "world/probe"
BALL, BALL_MARK, SHADOW, FORCES = "world/ball", "world/ball_mark", "world/shadow", "world/forces"
PHASE, PLACE, POTENTIAL = "states/phase", "states/ball", "states/potential"
KEY = "legend"

STATES = {
    PLACE: {"on the plate": ORANGE, "between tool and plate": GREY, "at the tool": GREEN, "free": SKY},
    POTENTIAL: {"plate's": ORANGE, "probe's": GREEN},
}
"""What the ball touches, the electrode whose potential it has, and their colours."""
_PLAYED = 15.0
"""Duration of the playback [s]."""

LEGEND = """**Green** what is between ball and tool, **orange** between ball and plate: gaps, adhesion, paler contact
forces. **Yellow** the electrostatic force, above 0 towards the tool; **grey** the weight; **blue** the voltage.

**Arrows** beside the ball: these forces on it. Their lengths go with the square root of the force: one radius for 1 µN.

**Ball**: orange while it has the plate's potential, green while it has the probe's; the dot turns with it.

Lengths are in µm and forces in nN; the trial plays in slow motion."""


def record_trace(path: str | Path, trace: Trace, settings: Mapping[str, Any]) -> None:
    """Write the recording of a trial, whole or not at all.

    Args:
        path: the file to write, by custom `*.rrd`; an existing one is replaced.
        trace: at least two samples; long ones are thinned.
        settings: stored with the package's version as property `settings`; may be nested.

    Raises:
        UserError: the file cannot be written, or recording is switched off by the environment.
    """
    path = Path(path)
    with atomic_write(path) as part:
        file = RrdFile("iswarm_mj_grasp", part, layout(trace), path)
        try:
            stream = file.stream
            stream.send_recording_name(path.stem)
            send_properties(stream, "settings", {"version": __version__, **settings})
            for entity, archetype in static_entities(trace):
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
    yield PROBE, rr.Cylinders3D, {"centers": shapes.probe[:, None]}
    yield BALL, rr.Points3D, {"positions": shapes.ball[:, None], "class_ids": classes[:, None]}
    yield SHADOW, rr.Cylinders3D, {"centers": (shapes.ball * np.array([1, 1, 0]))[:, None]}
    yield BALL_MARK, rr.Points3D, {"positions": shapes.mark[:, None]}
    yield FORCES, rr.Arrows3D, {"origins": shapes.origins, "vectors": shapes.arrows}
    for line in LINES:
        values = np.broadcast_to(np.asarray(getattr(trace, line.field) * line.factor, float), len(trace.time))
        yield f"series/{line.name}", rr.Scalars, {"scalars": values[:, None]}


def states_of(trace: Trace) -> dict[str, np.ndarray]:
    """Entity -> (T,) names of states."""
    plate, both, tool, free = STATES[PLACE]
    at_tool, at_plate = trace.gap_tool <= 0, trace.gap_plate <= 0
    return {
        PHASE: np.array(trace.phases)[trace.phase],
        PLACE: np.where(at_tool, np.where(at_plate, both, tool), np.where(at_plate, plate, free)),
        POTENTIAL: np.where(trace.on_plate_potential, *STATES[POTENTIAL]),
    }


def static_entities(trace: Trace) -> Iterator[tuple[str, Any]]:
    """Yield (entity, archetype) of all that does not change."""
    radius, probe_radius = trace.radius * UM, trace.probe_radius * UM
    yield "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP
    classes = [(i, name, rgb(colour)) for i, (name, colour) in enumerate(STATES[POTENTIAL].items())]
    yield "world", rr.AnnotationContext(classes)
    plate = (4 * radius, 4 * radius, 1)
    yield PLATE, rr.Boxes3D(centers=[(0, 0, -1)], half_sizes=[plate], colors=rgb(WALL), fill_mode="solid")
    cylinder, points = rr.Cylinders3D.from_fields, rr.Points3D.from_fields
    yield PROBE, cylinder(lengths=PROBE_LENGTH, radii=probe_radius, colors=rgb(PALE), fill_mode="solid")
    yield BALL, points(radii=radius, show_labels=False)
    yield BALL_MARK, points(colors=(40, 40, 40), radii=0.08 * radius)
    yield SHADOW, cylinder(lengths=0.1, radii=0.6 * radius, colors=(70, 72, 78), fill_mode="solid")
    yield FORCES, rr.Arrows3D.from_fields(colors=[*map(rgb, (YELLOW, GREEN, ORANGE))], radii=0.04 * radius)
    for line in LINES:
        yield f"series/{line.name}", rr.SeriesLines(names=line.label, colors=rgb(line.colour), widths=1.5)
    phases = {name: (SKY, PURPLE)[i % 2] for i, name in enumerate(trace.phases)}
    for entity, states in {PHASE: phases, **STATES}.items():
        colours = [*map(rgb, states.values())]
        yield entity, rr.StateConfiguration(values=list(states), labels=list(states), colors=colours)
    yield KEY, rr.TextDocument(LEGEND, media_type=rr.MediaType.MARKDOWN)


def states_view(root: str = "") -> rrb.StateTimelineView:
    """Return the lanes of the states, which lie below a root."""
    return rrb.StateTimelineView(origin=f"{root}states", name="Phase, and the ball's contacts and potential")


def plot(name: str, root: str = "", corner: str | None = None, **more: Any) -> rrb.TimeSeriesView:
    """Return the plot of some lines, which lie below a root, see `rerun_format.time_series`."""
    titles = {"voltage": "Voltage (V)", "gaps": "Gaps (µm)", "attraction": "Forces on the ball (nN)"}
    title = more.pop("title", titles.get(name, "Contact forces (nN)"))
    return views.time_series(f"{root}series/{name}", title, corner, **more)


def layout(trace: Trace) -> rrb.Blueprint:
    """Return the layout: bench, states and legend on the left; time series on the right.

    The plots have no legends of their own, which would lie on the short contact and on the landing.
    """
    radius = trace.radius * UM
    bench = views.space(
        "world", "Bench (µm)", (1.2 * radius, -6 * radius, 1.2 * radius), (0.2 * radius, 0, 1.5 * radius)
    )
    small = 1.3 * float(np.max(trace.adhesion_tool) * NN) or 1.0
    scale = rrb.ScalarAxis(range=(-small, small))
    plots = [plot(name) for name in ("voltage", "gaps", "attraction", "contact")]
    plots.insert(3, plot("attraction", title="Small forces on the ball (nN)", axis_y=scale))
    left = rrb.Vertical(bench, states_view(), rrb.TextDocumentView(origin=KEY, name="Legend"), row_shares=[9, 3, 4])
    right = rrb.Vertical(*plots, name="Time series")
    speed = float(trace.time[-1] - trace.time[0]) / _PLAYED
    return views.blueprint(rrb.Horizontal(left, right, column_shares=[1, 1]), playback_speed=speed, loop_mode="all")
