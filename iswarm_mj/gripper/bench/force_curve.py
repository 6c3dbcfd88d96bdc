"""Force-distance curves: the tool approaches a ball, touches it and retracts, at a constant voltage."""

from typing import Any

from iswarm_mj.gripper.bench.engine_tracing import TraceBench
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.trial import Trial

SLOWDOWN = 4.0
"""How much slower than in a trial the tool moves."""


def force_curve(trial: Trial, protocol: Protocol, voltage: float) -> list[dict[str, Any]]:
    """Samples of one curve, approach then retract; above its grasp voltage the ball comes along.

    Args:
        trial: the ball.
        protocol: of which the start, the press and the speeds count.
        voltage: of the tool, from the start [V].

    Returns:
        One row per physics step: direction ("approach" or "retract"), voltage [V], radius, tip, gap [m], and the
        forces between tool and ball: adhesion and electrostatic (attractive), contact (repulsive), total [N].
    """
    bench = TraceBench(trial, protocol.start_gap)
    far, pressed, peeled = protocol.start_gap, -protocol.press, protocol.peel
    bench.move("voltage", protocol.rise_time, far, voltage)
    bench.move("approach", SLOWDOWN * protocol.approach_time, pressed, voltage)
    bench.move("contact", protocol.dwell, pressed, voltage)
    bench.move("retract", SLOWDOWN * protocol.peel_time, peeled, voltage)
    bench.move("away", SLOWDOWN * protocol.approach_time, far, voltage)
    trace = bench.trace()
    directions = {"approach": "approach", "contact": "approach", "retract": "retract", "away": "retract"}
    rows = []
    for i, phase in enumerate(trace.phases[k] for k in trace.phase):
        if phase not in directions:
            continue
        attraction = trace.adhesion_tool[i] + max(0.0, trace.electrostatic[i])
        numbers = {
            "voltage": voltage,
            "radius": trial.radius,
            "tip": trace.probe[i, 2] - 2 * trial.radius,
            "gap": trace.gap_tool[i],
            "adhesion": trace.adhesion_tool[i],
            "electrostatic": max(0.0, trace.electrostatic[i]),
            "contact": trace.contact_tool[i],
            "total": attraction - trace.contact_tool[i],
        }
        rows.append({"direction": directions[phase], **{name: float(value) for name, value in numbers.items()}})
    return rows
