"""A real trial on the bench: grasp at 40 V, then release by a ramp at a gap of 5 um.

It takes about 6 ms, 2000 samples.
"""

from functools import cache

import numpy as np

from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.tracing import Trace, trace_of
from iswarm_mj.gripper.bench.trial import Contacts, Trial
from iswarm_mj.gripper.laws.detachment import WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT

SCRIPT = (
    ("approach", 0.5, -0.025, 0.0),
    ("ramp", 1.0, -0.025, 40.0),
    ("retract", 1.0, 5.0, 40.0),
    ("voltage off", 0.3, 5.0, 0.0),
    ("release ramp", 2.5, 5.0, 50.0),
    ("rest", 0.7, 5.0, 0.0),
)
"""Phases with their durations [ms], and at their ends the height of the tool above its first touch
[um] and the voltage [V]."""
RADIUS = 20e-6
"""Radius of the ball [m]."""


@cache
def bench_trace() -> Trace:
    """Return every third step of the script."""
    contacts = Contacts(leak=0.0, restitution=0.0)
    trial = Trial(RADIUS, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE, contacts=contacts)
    bench = MujocoBench([trial], 5e-6, 1, is_recorded=True)
    for phase, duration, tip, voltage in SCRIPT:
        bench.move(phase, duration * 1e-3, tip * 1e-6, voltage)

    trace = trace_of(bench)
    every_third = {}
    for name, values in trace._asdict().items():
        if isinstance(values, np.ndarray):
            every_third[name] = values[::3]
    return trace._replace(**every_third)
