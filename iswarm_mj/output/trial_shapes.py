"""Shapes of a trial on the bench as arrays, for recordings and for the page: SI in, micrometres out."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from iswarm_mj.gripper.bench.trial_trace import Trace
from iswarm_mj.output.trace_lines import UM

PROBE_LENGTH = 100.0
"""Length of the probe in the view [um]."""
ARROW_FORCE = 1e-6
"""Force whose arrow is one radius long; lengths go with the square root [N]."""


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
