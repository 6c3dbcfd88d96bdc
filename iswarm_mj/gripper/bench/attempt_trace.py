"""Attempts that a swarm made, and the trace of one: its trial once more, sample by sample."""

from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.ramps import release
from iswarm_mj.gripper.bench.script import hangs
from iswarm_mj.gripper.bench.staircase import rung, touch
from iswarm_mj.gripper.bench.swarm_trials import PROTOCOL, TIMESTEP, ramp_to
from iswarm_mj.gripper.bench.tracing import trace_of
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.bench.trial_trace import Trace
from iswarm_mj.gripper.handling import Balls

PHASES = ("approach", "contact", "voltage", "retract", "lift", "off", "ramp", "flight", "rest")
"""Of lifts, then of releases, in their order."""


class Tried(NamedTuple):
    """An attempt that was made, and its outcome. SI units."""

    ball: int
    """Its index."""
    is_lift: bool
    """To lift it; otherwise to release it."""
    succeeded: bool
    """Lifted, or released and stayed on the floor."""
    radius: float
    """Of the ball [m]."""
    voltage: float
    """Of the tool [V]."""
    work_tool_object: float
    """Of this attempt, at the air's humidity [J/m^2]."""
    work_object_substrate: float
    """[J/m^2]"""
    misalignment: float
    """Lateral offset of the tool's axis from the ball's [m]."""


def attempts_between(before: Balls, after: Balls) -> list[Tried]:
    """Attempts of a world in a control step, by balls; those that were broken off are left out.

    Args:
        before: the K balls as the step began, as NumPy arrays.
        after: as it ended.
    """
    lifts, releases = after.attempts > before.attempts, after.releases > before.releases
    failed = (after.failed_grasps > before.failed_grasps) | (after.failed_releases > before.failed_releases)
    made = (lifts | releases) & (after.broken_off == before.broken_off)
    return [
        Tried(int(ball), bool(lifts[ball]), not failed[ball], float(after.radius[ball]), *map(float, after.tried[ball]))
        for ball in np.flatnonzero(made)
    ]


def trace_attempt(tried: Tried, gap: float) -> tuple[Trace, bool]:
    """Trace of an attempt, whose phases are `PHASES`, and whether it succeeded; nothing is leapt over.

    Args:
        tried: the attempt.
        gap: of releases [m].
    """
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
