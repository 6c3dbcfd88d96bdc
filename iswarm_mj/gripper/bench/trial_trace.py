"""What happened in one trial of the gripper bench, sample by sample."""

from typing import NamedTuple

import numpy as np


class Trace(NamedTuple):
    """T samples of one trial, at increasing times. SI units throughout; z up, the plate's surface at z = 0."""

    time: np.ndarray
    """(T,) since the trial began [s]."""
    phase: np.ndarray
    """(T,) integers, indices into `phases`."""
    phases: tuple[str, ...]
    """Names of the phases: approach, ramp, ..."""
    voltage: np.ndarray
    """(T,) of the probe against the plate [V]."""
    probe: np.ndarray
    """(T, 3) centre of the tip's face [m]."""
    ball: np.ndarray
    """(T, 3) centre of the ball [m]."""
    ball_quaternion: np.ndarray
    """(T, 4) orientation of the ball, w first."""
    gap_tool: np.ndarray
    """(T,) between probe and ball; below 0 they are pressed together [m]."""
    gap_plate: np.ndarray
    """(T,) between ball and plate; below 0 they are pressed together [m]."""
    adhesion_tool: np.ndarray
    """(T,) attraction of the ball by the probe, at least 0 [N]."""
    adhesion_plate: np.ndarray
    """(T,) attraction of the ball by the plate, at least 0 [N]."""
    electrostatic: np.ndarray
    """(T,) force on the ball, positive towards the probe, negative towards the plate [N]."""
    contact_tool: np.ndarray
    """(T,) normal force between probe and ball, at least 0 [N]."""
    contact_plate: np.ndarray
    """(T,) normal force between ball and plate, at least 0 [N]."""
    on_plate_potential: np.ndarray
    """(T,) bool: the ball has the plate's potential, otherwise the probe's."""
    radius: float
    """Of the ball [m]."""
    probe_radius: float
    """Of the probe [m]."""
    weight: float
    """Of the ball [N]."""


def thinned(trace: Trace, limit: int) -> Trace:
    """Return a trace of at most about `limit` samples, dense where the ball moves or the electrostatic force changes.

    Samples are kept at even distances along a path to which time, the ball's height and the force contribute a third
    each; in addition the first of each phase, and the trace's last.
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
