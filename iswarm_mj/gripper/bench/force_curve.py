"""Force-distance curves: the tool approaches a ball, touches it and retracts at a voltage."""

from typing import Any

import numpy as np

from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.tracing import trace_of
from iswarm_mj.gripper.bench.trial import Trial

UNITS = {
    "voltage": "V",
    "radius": "m",
    "tip": "m",
    "gap": "m",
    "adhesion": "N",
    "electrostatic": "N",
    "contact": "N",
    "total": "N",
}
"""Columns of a curve and their units.

`tip` is the height of the tool's face above its first touch of the ball at rest, `gap` that between
tool and ball, negative in contact. Forces act on the tool as in an AFM: attraction is negative,
`contact` positive, and `total` their sum.
"""
SLOWDOWN = 4.0
"""Factor by which the tool moves more slowly than in a trial."""
_DIRECTIONS = {
    "approach": "approach",
    "contact": "approach",
    "retract": "retract",
    "away": "retract",
}
"""Direction of the phases that belong to the curve."""


def force_curve(trial: Trial, protocol: Protocol, voltage: float) -> list[dict[str, Any]]:
    """Measure one curve, approach then retract; above its grasp voltage the ball comes along.

    Args:
        trial: ball, tool and surroundings of the trial.
        protocol: distances and times of the tool.
        voltage: on from the start [V].

    Returns:
        One row per physics step: direction ("approach" or "retract"), and the columns of `UNITS`.
    """
    bench = MujocoBench([trial], protocol.start_gap, threads=1, is_recorded=True)
    # Heights of the tool above its first touch of the ball.
    far = protocol.start_gap
    pressed = -protocol.press

    bench.move("voltage", protocol.rise_time, far, voltage)
    bench.move("approach", SLOWDOWN * protocol.approach_time, pressed, voltage)
    bench.move("contact", protocol.dwell, pressed, voltage)
    bench.move("retract", SLOWDOWN * protocol.peel_time, protocol.peel, voltage)
    bench.move("away", SLOWDOWN * protocol.approach_time, far, voltage)

    trace = trace_of(bench)
    adhesion = -trace.adhesion_tool
    electrostatic = -np.maximum(0.0, trace.electrostatic)
    columns = {
        "voltage": np.full_like(trace.time, voltage),
        "radius": np.full_like(trace.time, trial.radius),
        "tip": trace.probe[:, 2] - 2 * trial.radius,
        "gap": trace.gap_tool,
        "adhesion": adhesion,
        "electrostatic": electrostatic,
        "contact": trace.contact_tool,
        "total": adhesion + electrostatic + trace.contact_tool,
    }

    rows = []
    values_of_steps = zip(*(column.tolist() for column in columns.values()), strict=True)
    for phase, values in zip(trace.phase, values_of_steps, strict=True):
        name = trace.phases[phase]
        if name in _DIRECTIONS:
            row = dict(zip(columns, values, strict=True))
            rows.append({"direction": _DIRECTIONS[name], **row})
    return rows
