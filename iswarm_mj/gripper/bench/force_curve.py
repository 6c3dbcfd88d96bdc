"""Force-distance curves: the tool approaches a ball, touches it and retracts, at a constant voltage."""

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
"""Columns of a curve and their units. `tip` is the height of the tool's face above its first touch of the ball at rest,
`gap` that between tool and ball, negative in contact. Forces act on the tool as in an AFM: attraction is negative,
`contact` positive, and `total` their sum."""
SLOWDOWN = 4.0
"""How much slower than in a trial the tool moves."""


def force_curve(trial: Trial, protocol: Protocol, voltage: float) -> list[dict[str, Any]]:
    """Samples of one curve, approach then retract; above its grasp voltage the ball comes along.

    The voltage is on from the start [V]. Returns one row per physics step: direction ("approach" or "retract"), and the
    columns of `UNITS`.
    """
    bench = MujocoBench([trial], protocol.start_gap, 1, is_recorded=True)
    far, pressed, peeled = protocol.start_gap, -protocol.press, protocol.peel
    bench.move("voltage", protocol.rise_time, far, voltage)
    bench.move("approach", SLOWDOWN * protocol.approach_time, pressed, voltage)
    bench.move("contact", protocol.dwell, pressed, voltage)
    bench.move("retract", SLOWDOWN * protocol.peel_time, peeled, voltage)
    bench.move("away", SLOWDOWN * protocol.approach_time, far, voltage)
    trace = trace_of(bench)
    directions = {"approach": "approach", "contact": "approach", "retract": "retract", "away": "retract"}
    adhesion, electrostatic = -trace.adhesion_tool, -np.maximum(0.0, trace.electrostatic)
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
    names = "direction", *columns
    values = [directions.get(trace.phases[k]) for k in trace.phase], *(column.tolist() for column in columns.values())
    return [dict(zip(names, row, strict=True)) for row in zip(*values, strict=True) if row[0]]
