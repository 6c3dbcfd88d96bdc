"""The trace of an attempt that a swarm made: its trial once more, sample by sample."""

import numpy as np

from iswarm_mj.gripper.bench.attempt_log import Tried
from iswarm_mj.gripper.bench.engine_tracing import TraceBench
from iswarm_mj.gripper.bench.swarm_trials import PROTOCOL, TIMESTEP, drop_on, lift_on
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.bench.trial_trace import Trace

PHASES = ("approach", "contact", "voltage", "retract", "lift", "off", "rise", "wait", "cut", "fall")
"""Of lifts, then of releases, in their order."""


def trace_attempt(tried: Tried, gap: float) -> tuple[Trace, bool]:
    """Trace of an attempt, whose phases are `PHASES`, and whether it succeeded.

    Args:
        tried: the attempt.
        gap: of releases [m].
    """
    works = tried.work_tool_object, tried.work_object_substrate
    trial = Trial(tried.radius, *works, 10.0, misalignment=tried.misalignment)  # whose factor of humidity is 1
    bench = TraceBench(trial, PROTOCOL.start_gap, None if tried.is_lift else gap, TIMESTEP)
    succeeded = lift_on(bench, tried.voltage)[0] if tried.is_lift else drop_on(bench, tried.voltage, gap)[0]
    trace = bench.trace()
    places = np.array([PHASES.index(name) for name in trace.phases])
    return trace._replace(phase=places[trace.phase], phases=PHASES), succeeded
