"""The look of a trial's recording: static entities and the layout of the viewer. Lengths in um, forces in nN."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from iswarm_mj.gripper.bench.trial_trace import Trace
from iswarm_mj.output.palette import GREEN, GREY, ORANGE, PALE, PURPLE, SKY, WALL, YELLOW, rgb
from iswarm_mj.output.rerun_format import blueprint, settings_document, space, time_series
from iswarm_mj.output.trace_lines import LINES, NN, UM
from iswarm_mj.output.trial_shapes import PROBE_LENGTH

PLATE, PROBE = "world/plate", "world/probe"
BALL, BALL_MARK, SHADOW, FORCES = "world/ball", "world/ball_mark", "world/shadow", "world/forces"
PHASE, PLACE, POTENTIAL = "states/phase", "states/ball", "states/potential"
SETTINGS, KEY = "settings", "legend"

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


def static_entities(trace: Trace, settings: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
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
    yield SETTINGS, settings_document(LEGEND, "Setting", settings)


def states_view(root: str = "") -> rrb.StateTimelineView:
    """Return the lanes of the states, which lie below a root."""
    return rrb.StateTimelineView(origin=f"{root}states", name="Phase, and the ball's contacts and potential")


def plot(name: str, root: str = "", corner: str | None = None, **more: Any) -> rrb.TimeSeriesView:
    """Return the plot of some lines, which lie below a root, see `rerun_format.time_series`."""
    titles = {"voltage": "Voltage (V)", "gaps": "Gaps (µm)", "attraction": "Forces on the ball (nN)"}
    title = more.pop("title", titles.get(name, "Contact forces (nN)"))
    return time_series(f"{root}series/{name}", title, corner, **more)


def layout(trace: Trace) -> rrb.Blueprint:
    """Return the layout: bench, states and legend on the left; time series or settings on the right.

    The plots have no legends of their own, which would lie on the short contact and on the landing.
    """
    radius = trace.radius * UM
    bench = space("world", "Bench (µm)", (1.2 * radius, -6 * radius, 1.2 * radius), (0.2 * radius, 0, 1.5 * radius))
    small = 1.3 * float(np.max(trace.adhesion_tool) * NN) or 1.0
    scale = rrb.ScalarAxis(range=(-small, small))
    plots = [plot(name) for name in ("voltage", "gaps", "attraction", "contact")]
    plots.insert(3, plot("attraction", title="Small forces on the ball (nN)", axis_y=scale))
    left = rrb.Vertical(bench, states_view(), rrb.TextDocumentView(origin=KEY, name="Legend"), row_shares=[9, 3, 4])
    shown = rrb.Vertical(*plots, name="Time series")
    right = rrb.Tabs(shown, rrb.TextDocumentView(origin=SETTINGS, name="Settings"), active_tab=0)
    speed = float(trace.time[-1] - trace.time[0]) / _PLAYED
    return blueprint(rrb.Horizontal(left, right, column_shares=[1, 1]), playback_speed=speed, loop_mode="all")
