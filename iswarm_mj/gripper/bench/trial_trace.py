"""The trace of one trial on the bench, sample by sample."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int


class Trace(NamedTuple):
    """T samples of one trial, at increasing times. SI units throughout; z up, the plate's surface at z = 0."""

    time: Float[np.ndarray, "T"]
    """Since the trial began [s]."""
    phase: Int[np.ndarray, "T"]
    """Indices into `phases`."""
    phases: tuple[str, ...]
    """Names of the phases: approach, ramp, ..."""
    voltage: Float[np.ndarray, "T"]
    """Of the probe against the plate [V]."""
    probe: Float[np.ndarray, "T 3"]
    """Centre of the tip's face [m]."""
    ball: Float[np.ndarray, "T 3"]
    """Centre of the ball [m]."""
    ball_quaternion: Float[np.ndarray, "T 4"]
    """Orientation of the ball, w first."""
    gap_tool: Float[np.ndarray, "T"]
    """Between probe and ball, negative where they are pressed together [m]."""
    gap_plate: Float[np.ndarray, "T"]
    """Between ball and plate, negative where they are pressed together [m]."""
    adhesion_tool: Float[np.ndarray, "T"]
    """Attraction of the ball by the probe, at least 0 [N]."""
    adhesion_plate: Float[np.ndarray, "T"]
    """Attraction of the ball by the plate, at least 0 [N]."""
    electrostatic: Float[np.ndarray, "T"]
    """Force on the ball, positive towards the probe, negative towards the plate [N]."""
    contact_tool: Float[np.ndarray, "T"]
    """Normal force between probe and ball, at least 0 [N]."""
    contact_plate: Float[np.ndarray, "T"]
    """Normal force between ball and plate, at least 0 [N]."""
    on_plate_potential: Bool[np.ndarray, "T"]
    """Whether the ball has the plate's potential; otherwise it has the probe's."""
    ball_voltage: Float[np.ndarray, "T"]
    """Of the ball against the plate [V]."""
    broken: Bool[np.ndarray, "T"]
    """Whether the oxide of the tool's contact is broken down."""
    drive: Float[np.ndarray, "T"]
    """Force of the drive on the tool, upwards [N]."""
    impact_loss: Float[np.ndarray, "T"]
    """Energy lost in an impact from which the ball rebounds [J]; 0 where there is none."""
    radius: float
    """Of the ball [m]."""
    probe_radius: float
    """[m]"""
    weight: float
    """Of the ball [N]."""
    probe_weight: float
    """Of the probe and what carries it [N]."""


def thinned(trace: Trace, limit: int) -> Trace:
    """Return a trace of about `limit` samples at most, dense where the ball moves or the electrostatic force changes.

    Samples are kept at even distances along a path to which time, the ball's height and the force contribute a third
    each, and so are the first sample of each phase and the last one of the trace.
    """
    if len(trace.time) <= limit:
        return trace
    path = np.zeros(len(trace.time))
    for values in (trace.time, trace.ball[:, 2], trace.electrostatic):
        length = np.cumsum(np.abs(np.diff(values, prepend=values[0])))
        path += length / max(length[-1], np.finfo(float).tiny)
    cell = np.floor(path / path[-1] * (limit - 1))
    is_new = (np.diff(cell, prepend=-1) > 0) | (np.diff(trace.phase, prepend=-1) != 0)
    is_new[-1] = True
    arrays = {name: value[is_new] for name, value in trace._asdict().items() if isinstance(value, np.ndarray)}
    return trace._replace(**arrays)
