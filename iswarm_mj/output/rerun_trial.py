"""Rerun recording (.rrd) of a trial on the bench: its entities, what moves, the viewer's layout.

Input is in SI units, output in um and nN.
"""

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
from iswarm_mj.output.palette import (
    GREEN,
    GREY,
    ORANGE,
    PALE,
    PURPLE,
    SKY,
    WALL,
    YELLOW,
    rgb,
)
from iswarm_mj.output.rerun_format import RrdFile, columns_of, durations, send_properties
from iswarm_mj.output.trial_shapes import LINES, NN, PROBE_LENGTH, UM, trial_shapes
from iswarm_mj.utils.files import atomic_write

SAMPLES = 4000
"""Number of samples to which longer traces are thinned, approximately."""
_BLOCK = 1000
"""Number of samples of a block, small enough for quick seeking."""
_PLAYBACK_TIME = 15.0
"""Duration of the playback of a trial [s]."""
_MARK_COLOUR = (40, 40, 40)
_SHADOW_COLOUR = (70, 72, 78)

Index = Callable[[Float[np.ndarray, "T"]], list[rr.TimeColumn]]
"""Function from times of samples [s] to columns of time."""

# Entities in space.
PLATE = "world/plate"
PROBE = "world/probe"
BALL = "world/ball"
BALL_MARK = "world/ball_mark"
SHADOW = "world/shadow"
FORCES = "world/forces"

# Lanes of states: the phase of the trial, what the ball touches, and whose potential it has.
PHASE = "states/phase"
PLACE = "states/ball"
POTENTIAL = "states/potential"
LEGEND_ENTITY = "legend"

STATES = {
    PLACE: {
        "on the plate": ORANGE,
        "between tool and plate": GREY,
        "at the tool": GREEN,
        "free": SKY,
    },
    POTENTIAL: {"plate's": ORANGE, "probe's": GREEN},
}
"""States and their colours, by lane."""

LEGEND = """**Green** what is between ball and tool, **orange** between ball and plate: gaps,
adhesion, paler contact forces. **Yellow** the electrostatic force, above 0 towards the tool;
**grey** the weight; **blue** the voltage.

**Arrows** beside the ball: these forces on it. Their lengths go with the square root of the force:
one radius for 1 µN.

**Ball**: orange while it has the plate's potential, green while it has the probe's; the dot turns
with it.

Lengths are in µm and forces in nN; the trial plays in slow motion."""


def record_trace(path: str | Path, trace: Trace, settings: Mapping[str, Any]) -> None:
    """Write the recording of a trial, completely or not at all.

    Args:
        path: the file to write, by custom `*.rrd`; an existing one is replaced.
        trace: at least two samples; long traces are thinned.
        settings: values of the property `settings`, to which the package's version is added; may be
            nested.

    Raises:
        UserError: the file cannot be written, or the environment disables recordings.
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
    """Write everything that changes in a trial.

    Args:
        stream: stream of the recording.
        trace: trace of the trial.
        index: function that makes the columns of time.
        root: prefix of the names of the trial's entities.
    """
    # Bodies, forces and time series, block after block.
    moving = list(_moving(trace))
    for start in range(0, len(trace.time), _BLOCK):
        block = slice(start, start + _BLOCK)
        times = index(trace.time[block])
        for entity, archetype, fields in moving:
            columns = _columns_of_block(archetype, fields, block)
            stream.send_columns(root + entity, times, columns, strict=True)

    # Of the states only the changes, the first state included.
    for entity, states in states_of(trace).items():
        changes = np.flatnonzero(np.append(True, states[1:] != states[:-1]))
        words = [str(state) for state in states[changes]]
        times = index(trace.time[changes])
        columns = rr.StateChange.columns(state=words)
        stream.send_columns(root + entity, times, columns, strict=True)


def _columns_of_block(
    archetype: Any, fields: Mapping[str, np.ndarray], block: slice
) -> list[rr.ComponentColumn]:
    """Return the columns of some samples of an entity.

    Args:
        archetype: archetype of the entity.
        fields: fields of the archetype (T, instances, ...).
        block: the samples.
    """
    parts = {name: values[block] for name, values in fields.items()}
    n_rows, n_instances = next(iter(parts.values())).shape[:2]
    instances = {name: part.reshape(-1, *part.shape[2:]) for name, part in parts.items()}
    shown = archetype.from_fields(**instances)
    return columns_of(shown, {}, n_rows, n_instances)


def _moving(trace: Trace) -> Iterator[tuple[str, Any, dict[str, np.ndarray]]]:
    """Yield entity, archetype and fields (T, instances, ...) of bodies, forces and time series."""
    shapes = trial_shapes(trace)

    # Probe, ball with the colour of its potential, and the ball's shadow and mark.
    yield PROBE, rr.Cylinders3D, {"centers": shapes.probe[:, None]}
    class_of_potential = np.where(trace.on_plate_potential, 0, 1).astype(np.uint16)
    ball_fields = {"positions": shapes.ball[:, None], "class_ids": class_of_potential[:, None]}
    yield BALL, rr.Points3D, ball_fields
    below_ball = shapes.ball * np.array([1, 1, 0])
    yield SHADOW, rr.Cylinders3D, {"centers": below_ball[:, None]}
    yield BALL_MARK, rr.Points3D, {"positions": shapes.mark[:, None]}

    # Forces on the ball.
    yield FORCES, rr.Arrows3D, {"origins": shapes.origins, "vectors": shapes.arrows}

    # Time series; the weight is a single number.
    for line in LINES:
        values = np.asarray(getattr(trace, line.field) * line.factor, float)
        values_in_time = np.broadcast_to(values, len(trace.time))
        yield f"series/{line.name}", rr.Scalars, {"scalars": values_in_time[:, None]}


def states_of(trace: Trace) -> dict[str, np.ndarray]:
    """Return the names of states (T,) by lane."""
    on_plate, between, at_tool, free = STATES[PLACE]
    plates, probes = STATES[POTENTIAL]
    touches_tool = trace.gap_tool <= 0
    touches_plate = trace.gap_plate <= 0
    touching_tool = np.where(touches_plate, between, at_tool)
    away_from_tool = np.where(touches_plate, on_plate, free)
    return {
        PHASE: np.array(trace.phases)[trace.phase],
        PLACE: np.where(touches_tool, touching_tool, away_from_tool),
        POTENTIAL: np.where(trace.on_plate_potential, plates, probes),
    }


def static_entities(trace: Trace) -> Iterator[tuple[str, Any]]:
    """Yield entity and archetype of everything that does not change."""
    radius = trace.radius * UM
    probe_radius = trace.probe_radius * UM

    # Axes and colours of the potentials.
    yield "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP
    potentials = STATES[POTENTIAL].items()
    classes = [(number, name, rgb(colour)) for number, (name, colour) in enumerate(potentials)]
    yield "world", rr.AnnotationContext(classes)

    # The looks of the bodies.
    plate_size = (4 * radius, 4 * radius, 1)
    yield (
        PLATE,
        rr.Boxes3D(
            centers=[(0, 0, -1)], half_sizes=[plate_size], colors=rgb(WALL), fill_mode="solid"
        ),
    )
    yield (
        PROBE,
        rr.Cylinders3D.from_fields(
            lengths=PROBE_LENGTH, radii=probe_radius, colors=rgb(PALE), fill_mode="solid"
        ),
    )
    yield BALL, rr.Points3D.from_fields(radii=radius, show_labels=False)
    yield BALL_MARK, rr.Points3D.from_fields(colors=_MARK_COLOUR, radii=0.08 * radius)
    yield (
        SHADOW,
        rr.Cylinders3D.from_fields(
            lengths=0.1, radii=0.6 * radius, colors=_SHADOW_COLOUR, fill_mode="solid"
        ),
    )
    arrow_colours = [rgb(YELLOW), rgb(GREEN), rgb(ORANGE)]
    yield FORCES, rr.Arrows3D.from_fields(colors=arrow_colours, radii=0.04 * radius)

    # The looks of time series and lanes, and the legend.
    for line in LINES:
        look = rr.SeriesLines(names=line.label, colors=rgb(line.colour), widths=1.5)
        yield f"series/{line.name}", look
    phases = {name: (SKY, PURPLE)[number % 2] for number, name in enumerate(trace.phases)}
    for entity, states in {PHASE: phases, **STATES}.items():
        names = list(states)
        colours = [rgb(colour) for colour in states.values()]
        yield entity, rr.StateConfiguration(values=names, labels=names, colors=colours)
    yield LEGEND_ENTITY, rr.TextDocument(LEGEND, media_type=rr.MediaType.MARKDOWN)


def states_view(root: str = "") -> rrb.StateTimelineView:
    """Return the lanes of the states.

    Args:
        root: prefix of the names of the trial's entities.
    """
    name = "Phase, and the ball's contacts and potential"
    return rrb.StateTimelineView(origin=f"{root}states", name=name)


_PLOT_TITLES = {
    "voltage": "Voltage (V)",
    "gaps": "Gaps (µm)",
    "attraction": "Forces on the ball (nN)",
    "contact": "Contact forces (nN)",
}
"""Titles of plots, by the first part of the names of their lines."""


def plot(
    name: str, root: str = "", corner: str | None = None, title: str = "", **more: Any
) -> rrb.TimeSeriesView:
    """Return the plot of some lines.

    Args:
        name: first part of the names of the lines.
        root: prefix of the names of the trial's entities.
        corner: corner of the legend, see `rerun_format.time_series`.
        title: title of the plot; by default that of `_PLOT_TITLES`.
        more: further arguments of `rerun_format.time_series`.
    """
    origin = f"{root}series/{name}"
    return views.time_series(origin, title or _PLOT_TITLES[name], corner, **more)


def layout(trace: Trace) -> rrb.Blueprint:
    """Return the layout: bench, states and legend on the left; time series on the right.

    The plots have no legends of their own, which would cover the short contact and the landing.
    """
    radius = trace.radius * UM
    bench = views.space(
        "world",
        "Bench (µm)",
        eye=(1.2 * radius, -6 * radius, 1.2 * radius),
        target=(0.2 * radius, 0, 1.5 * radius),
    )
    legend = rrb.TextDocumentView(origin=LEGEND_ENTITY, name="Legend")
    left = rrb.Vertical(bench, states_view(), legend, row_shares=[9, 3, 4])

    small_force = 1.3 * float(np.max(trace.adhesion_tool) * NN) or 1.0
    small_forces = plot(
        "attraction",
        title="Small forces on the ball (nN)",
        axis_y=rrb.ScalarAxis(range=(-small_force, small_force)),
    )
    right = rrb.Vertical(
        plot("voltage"),
        plot("gaps"),
        plot("attraction"),
        small_forces,
        plot("contact"),
        name="Time series",
    )

    duration = float(trace.time[-1] - trace.time[0])
    return views.blueprint(
        rrb.Horizontal(left, right, column_shares=[1, 1]),
        playback_speed=duration / _PLAYBACK_TIME,
        loop_mode="all",
    )
