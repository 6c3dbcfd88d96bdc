"""The look of a trial's recording: static entities and the layout of the viewer. Lengths in um, forces in nN."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from iswarm_mj.gripper.bench.trial_trace import Trace
from iswarm_mj.output.rerun_format import blueprint, settings_document, space, time_series

UM, NN = 1e6, 1e9
"""Micrometres per metre, nanonewtons per newton."""

PLATE, PROBE = "world/plate", "world/probe"
BALL, BALL_MARK, SHADOW, FORCES = "world/ball", "world/ball_mark", "world/shadow", "world/forces"
PHASE, PLACE, POTENTIAL = "states/phase", "states/ball", "states/potential"
SETTINGS = "settings"
KEY = "legend"

PROBE_LENGTH = 100.0
"""Length of the probe in the view [um]."""

_GREEN, _ORANGE, _YELLOW = (0, 175, 125), (235, 110, 35), (240, 190, 40)
_PALE_GREEN, _PALE_ORANGE, _GREY = (150, 225, 200), (250, 190, 150), (170, 175, 180)


class Line(NamedTuple):
    """A time series."""

    field: str
    """Of the trace."""
    factor: float
    """From SI to its unit."""
    name: str
    """In the legend."""
    colour: tuple[int, int, int]


SERIES = {
    "series/voltage/voltage": Line("voltage", 1.0, "voltage", (90, 160, 250)),
    "series/gaps/tool": Line("gap_tool", UM, "tool to ball", _GREEN),
    "series/gaps/plate": Line("gap_plate", UM, "ball to plate", _ORANGE),
    "series/attraction/electrostatic": Line("electrostatic", NN, "electrostatic, + to the tool", _YELLOW),
    "series/attraction/tool": Line("adhesion_tool", NN, "adhesion to the tool", _GREEN),
    "series/attraction/plate": Line("adhesion_plate", NN, "adhesion to the plate", _ORANGE),
    "series/attraction/weight": Line("weight", NN, "weight", _GREY),
    "series/contact/tool": Line("contact_tool", NN, "contact with the tool", _PALE_GREEN),
    "series/contact/plate": Line("contact_plate", NN, "contact with the plate", _PALE_ORANGE),
}
"""Time series by their entities."""
PLACES = {"on the plate": _ORANGE, "between tool and plate": _GREY, "at the tool": _GREEN, "free": (90, 160, 250)}
"""What the ball touches, and its colour then."""

POTENTIALS = {"plate's": _ORANGE, "probe's": _GREEN}
"""The electrode whose potential the ball has, and its colour then."""

_PHASES = ((70, 110, 170), (120, 90, 160))
"""Colours of the phases, in turn."""

_PLAYED = 15.0
"""Duration of the playback [s]."""

LEGEND = """**Green** what is between ball and tool, **orange** between ball and plate: gaps, adhesion, paler contact
forces. **Yellow** the electrostatic force, above 0 towards the tool; **grey** the weight; **blue** the voltage.

**Arrows** beside the ball: these forces on it. Their lengths go with the square root of the force: one radius for 4 µN.

**Ball**: orange while it has the plate's potential, green while it has the probe's; the dot turns with it.

Lengths are in µm and forces in nN; the trial plays in slow motion."""


def static_entities(trace: Trace, settings: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield (entity, archetype) of all that does not change."""
    radius, probe_radius = trace.radius * UM, trace.probe_radius * UM
    yield "world", rr.ViewCoordinates.RIGHT_HAND_Z_UP
    classes = [(i, name, colour) for i, (name, colour) in enumerate(POTENTIALS.items())]
    yield "world", rr.AnnotationContext(classes)
    half = 4 * radius
    plate = {"centers": [(0, 0, -1)], "half_sizes": [(half, half, 1)], "colors": (120, 124, 130), "fill_mode": "solid"}
    yield PLATE, rr.Boxes3D(**plate)
    length, shape = PROBE_LENGTH, {"colors": (205, 210, 218), "fill_mode": "solid"}
    yield PROBE, rr.Cylinders3D.from_fields(lengths=length, radii=probe_radius, **shape)
    yield BALL, rr.Points3D.from_fields(radii=radius, show_labels=False)
    yield BALL_MARK, rr.Points3D.from_fields(colors=(40, 40, 40), radii=0.08 * radius)
    shadow = {"lengths": 0.1, "radii": 0.6 * radius, "colors": (70, 72, 78), "fill_mode": "solid"}
    yield SHADOW, rr.Cylinders3D.from_fields(**shadow)
    yield FORCES, rr.Arrows3D.from_fields(colors=[_YELLOW, _GREEN, _ORANGE], radii=0.04 * radius)
    for entity, line in SERIES.items():
        yield entity, rr.SeriesLines(names=line.name, colors=line.colour, widths=1.5)
    phases = {name: _PHASES[i % 2] for i, name in enumerate(trace.phases)}
    for entity, states in ((PHASE, phases), (PLACE, PLACES), (POTENTIAL, POTENTIALS)):
        yield entity, rr.StateConfiguration(values=list(states), labels=list(states), colors=list(states.values()))
    yield KEY, rr.TextDocument(LEGEND, media_type=rr.MediaType.MARKDOWN)
    yield SETTINGS, settings_document(LEGEND, "Setting", settings)


def layout(trace: Trace) -> rrb.Blueprint:
    """Return the layout: bench, states and legend on the left; time series or settings on the right.

    The plots have no legends of their own, which would lie on the short contact and on the landing.
    """
    radius = trace.radius * UM
    bench = space("world", "Bench (µm)", (1.2 * radius, -6 * radius, 1.2 * radius), (0.2 * radius, 0, 1.5 * radius))
    states = rrb.StateTimelineView(origin="states", name="Phase, and the ball's contacts and potential")
    small = 1.3 * float(np.max(trace.adhesion_tool) * NN) or 1.0
    plots = rrb.Vertical(
        time_series("series/voltage", "Voltage (V)", None),
        time_series("series/gaps", "Gaps (µm)", None),
        time_series("series/attraction", "Forces on the ball (nN)", None),
        time_series(
            "series/attraction", "Small forces on the ball (nN)", None, axis_y=rrb.ScalarAxis(range=(-small, small))
        ),
        time_series("series/contact", "Contact forces (nN)", None),
        name="Time series",
    )
    left = rrb.Vertical(bench, states, rrb.TextDocumentView(origin=KEY, name="Legend"), row_shares=[9, 3, 4])
    right = rrb.Tabs(plots, rrb.TextDocumentView(origin=SETTINGS, name="Settings"), active_tab=0)
    speed = float(trace.time[-1] - trace.time[0]) / _PLAYED
    return blueprint(rrb.Horizontal(left, right, column_shares=[1, 1]), playback_speed=speed, loop_mode="all")
