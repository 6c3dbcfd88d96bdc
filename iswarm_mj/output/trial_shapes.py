"""Lines over time and shapes of a trial on the bench, for figures, recordings and the page.

Units are V, um and nN.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from iswarm_mj.gripper.bench.tracing import Trace
from iswarm_mj.output.palette import (
    GREEN,
    GREY,
    ORANGE,
    PALE_GREEN,
    PALE_ORANGE,
    SKY,
    YELLOW,
)

UM = 1e6
"""Micrometres per metre."""
NN = 1e9
"""Nanonewtons per newton."""
PROBE_LENGTH = 100.0
"""Length of the probe in the view [um]."""
ARROW_FORCE = 1e-6
"""Force whose arrow is one radius long; lengths go with the square root [N]."""
ARROW_POSITIONS = ((1.3, 0, 0), (1.55, 0, 0), (1.8, 0, 0))
"""Origins of the arrows relative to the ball's centre, in radii of the ball."""
MARK_DIRECTION = (0.3, -0.8, 0.52)
"""Direction from the ball's centre to the dot on it, in the ball's own frame; of about length 1."""


class Line(NamedTuple):
    """A quantity of a trace that is drawn over time."""

    name: str
    """Name of its plot and name of the line, which end the name of its entity."""
    field: str
    """Field of the trace."""
    factor: float
    """Factor from SI to its unit."""
    label: str
    """Label in the legend."""
    colour: str


LINES = (
    Line("voltage/voltage", "voltage", 1.0, "voltage", SKY),
    Line("gaps/tool", "gap_tool", UM, "tool to ball", GREEN),
    Line("gaps/plate", "gap_plate", UM, "ball to plate", ORANGE),
    Line(
        "attraction/electrostatic",
        "electrostatic",
        NN,
        "electrostatic, positive to the tool",
        YELLOW,
    ),
    Line("attraction/tool", "adhesion_tool", NN, "adhesion to the tool", GREEN),
    Line("attraction/plate", "adhesion_plate", NN, "adhesion to the plate", ORANGE),
    Line("attraction/weight", "weight", NN, "weight", GREY),
    Line("contact/tool", "contact_tool", NN, "contact with the tool", PALE_GREEN),
    Line("contact/plate", "contact_plate", NN, "contact with the plate", PALE_ORANGE),
)


class TrialShapes(NamedTuple):
    """Positions of ball, probe and arrows in T samples [um]."""

    ball: Float[np.ndarray, "T 3"]
    """Centre of the ball."""
    mark: Float[np.ndarray, "T 3"]
    """Dot on the ball, which turns with it."""
    probe: Float[np.ndarray, "T 3"]
    """Centre of the probe, whose face is half its length below."""
    origins: Float[np.ndarray, "T 3 3"]
    """Origins of the arrows: electrostatic force, adhesion to the tool, adhesion to the plate."""
    arrows: Float[np.ndarray, "T 3 3"]
    """Arrows of these forces."""


def trial_shapes(trace: Trace) -> TrialShapes:
    """Return the shapes of a trial."""
    ball = trace.ball * UM
    radius = trace.radius * UM
    rotation = Rotation.from_quat(trace.ball_quaternion, scalar_first=True)
    probe_face = trace.probe * UM

    # Arrows are vertical; upwards is towards the tool.
    forces = np.stack([trace.electrostatic, trace.adhesion_tool, -trace.adhesion_plate], axis=1)
    arrows = np.zeros((*forces.shape, 3))
    arrows[..., 2] = np.sign(forces) * np.sqrt(np.abs(forces) / ARROW_FORCE) * radius

    return TrialShapes(
        ball=ball,
        mark=ball + radius * rotation.apply(MARK_DIRECTION),
        probe=probe_face + np.array([0, 0, PROBE_LENGTH / 2]),
        origins=ball[:, None] + np.array(ARROW_POSITIONS) * radius,
        arrows=arrows,
    )
