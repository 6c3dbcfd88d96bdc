"""Trace of an attempt that a swarm made: its trial once more, sample by sample."""

import numpy as np

from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.run_trials import release, rung, touch
from iswarm_mj.gripper.bench.script import hangs
from iswarm_mj.gripper.bench.swarm_trials import PROTOCOL, TIMESTEP, ramp_to
from iswarm_mj.gripper.bench.tracing import trace_of
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.bench.trial_trace import Trace
from iswarm_mj.gripper.handling import Tried

PHASES = ("approach", "contact", "voltage", "retract", "lift", "off", "ramp", "flight", "rest")
"""Of lifts, then of releases, in their order."""


def trace_attempt(tried: Tried, gap: float) -> tuple[Trace, bool]:
    """Trace of an attempt, whose phases are `PHASES`, and whether it succeeded; releases are at a gap [m]."""
    works = tried.work_tool_object, tried.work_object_substrate
    trial = Trial(tried.radius, *works, 10.0, misalignment=tried.misalignment)  # whose factor of humidity is 1
    bench = MujocoBench(
        [trial], PROTOCOL.start_gap, 1, TIMESTEP, is_recorded=True, hanging=None if tried.is_lift else gap
    )
    if tried.is_lift:
        touch(bench, PROTOCOL)
        watch = rung(bench, PROTOCOL, tried.voltage)
        succeeded = hangs(watch.gap_tool, watch.gap_plate, PROTOCOL)
    else:
        succeeded = release(bench, PROTOCOL, np.array([True]), gap, ramp_to(tried.voltage)).landed
    trace = trace_of(bench)
    places = np.array([PHASES.index(name) for name in trace.phases])
    return trace._replace(phase=places[trace.phase], phases=PHASES), bool(succeeded[0])
