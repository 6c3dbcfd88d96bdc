"""What figures, recordings and the page show of a trial on the bench: lines over time, and shapes. V, um and nN."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from iswarm_mj.gripper.bench.tracing import Trace
from iswarm_mj.output.palette import GREEN, GREY, ORANGE, PALE_GREEN, PALE_ORANGE, SKY, YELLOW

UM, NN = 1e6, 1e9
"""Micrometres per metre, nanonewtons per newton."""
PROBE_LENGTH = 100.0
"""Length of the probe in the view [um]."""
ARROW_FORCE = 1e-6
"""Force whose arrow is one radius long; lengths go with the square root [N]."""


class Line(NamedTuple):
    """A quantity of a trace."""

    name: str
    """Of its plot and of itself, as the end of its entity."""
    field: str
    """Of the trace."""
    factor: float
    """From SI to its unit."""
    label: str
    """In the legend."""
    colour: str


LINES = (
    Line("voltage/voltage", "voltage", 1.0, "voltage", SKY),
    Line("gaps/tool", "gap_tool", UM, "tool to ball", GREEN),
    Line("gaps/plate", "gap_plate", UM, "ball to plate", ORANGE),
    Line("attraction/electrostatic", "electrostatic", NN, "electrostatic, positive to the tool", YELLOW),
    Line("attraction/tool", "adhesion_tool", NN, "adhesion to the tool", GREEN),
    Line("attraction/plate", "adhesion_plate", NN, "adhesion to the plate", ORANGE),
    Line("attraction/weight", "weight", NN, "weight", GREY),
    Line("contact/tool", "contact_tool", NN, "contact with the tool", PALE_GREEN),
    Line("contact/plate", "contact_plate", NN, "contact with the plate", PALE_ORANGE),
)


class TrialShapes(NamedTuple):
    """Where everything is in T samples."""

    ball: Float[np.ndarray, "T 3"]
    mark: Float[np.ndarray, "T 3"]
    """Dot on the ball, which turns with it."""
    probe: Float[np.ndarray, "T 3"]
    """Centre of the probe, whose face is half its length below."""
    origins: Float[np.ndarray, "T 3 3"]
    """Of the arrows beside the ball: electrostatic force, adhesion to the tool, adhesion to the plate."""
    arrows: Float[np.ndarray, "T 3 3"]


def trial_shapes(trace: Trace) -> TrialShapes:
    """Return the shapes of a trial."""
    ball, radius = trace.ball * UM, trace.radius * UM
    mark = ball + radius * Rotation.from_quat(trace.ball_quaternion, scalar_first=True).apply([0.3, -0.8, 0.52])
    forces = np.stack([trace.electrostatic, trace.adhesion_tool, -trace.adhesion_plate], axis=1)
    arrows = np.zeros((*forces.shape, 3))
    arrows[..., 2] = np.sign(forces) * np.sqrt(np.abs(forces) / ARROW_FORCE) * radius
    origins = ball[:, None] + np.array([[1.3, 0, 0], [1.55, 0, 0], [1.8, 0, 0]]) * radius
    return TrialShapes(ball, mark, trace.probe * UM + np.array([0, 0, PROBE_LENGTH / 2]), origins, arrows)
