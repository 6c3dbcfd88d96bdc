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


def every(trace: Trace, stride: int) -> Trace:
    """Return every `stride`-th sample of a trace, with the last one of each phase and of the trace."""
    count = len(trace.time)
    is_last = np.append(np.diff(trace.phase) != 0, True)
    kept = np.flatnonzero(is_last | (np.arange(count) % stride == 0))
    return Trace(*(value[kept] if isinstance(value, np.ndarray) else value for value in trace))
