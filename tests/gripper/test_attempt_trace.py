"""Traces of attempts against the trials that decided about them in the swarm."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.attempts import GRIPPER, step
from support.sensing import lay

from iswarm_mj.gripper.bench.swarm_trials import PROTOCOL, TIMESTEP, by_host
from iswarm_mj.gripper.bench.tracing import PHASES, trace_attempt
from iswarm_mj.gripper.handling import attempts_between

PLACES = [(40, 0, 0), (60, 0, 0), (0, 0, 0), (0, 3, 0)]


@pytest.fixture(scope="module")
def made():
    """Balls before and after a step: nothing is tried, a lift at 40 V, one at 10 V, a release at 55 V, one at 20 V.

    The trials are told from the balls alone; the capacitors of the second and of the last robot are nearly empty.
    """
    gripper = replace(GRIPPER, tool_error=4e-6)
    before = lay((90.0, 0), (40.9, 0), (60.9, 0), (0.9, 0), (0.9, 3), holders=[None, None, None, 2, 3])
    volts = np.array([60.0, 10.0, 60.0, 20.0], np.float32)
    after, _ = step(gripper, before, PLACES, decider=by_host, voltage=volts)
    return jax.device_get(before), after


def test_attempts_follow_from_the_balls(made):
    tried = attempts_between(*made)
    found = [(1, True, True), (2, True, False), (3, False, True), (4, False, False)]
    assert [(t.ball, t.is_lift, t.succeeded) for t in tried] == found
    assert [t.voltage for t in tried] == [40, 10, 55, 20] and tried[2].misalignment == 0 < tried[0].misalignment
    assert attempts_between(made[1], made[1]) == []


def test_an_attempt_that_is_broken_off_is_none():
    gripper, balls, found = replace(GRIPPER, grasp_time=0.5), lay((40.9, 0)), []
    for x in (40, 60):
        before, (balls, _) = jax.device_get(balls), step(gripper, balls, [(x, 0, 0)])
        found += attempts_between(before, balls)
    assert balls.broken_off.tolist() == [1] and found == [] and not balls.tried.any()


def test_a_trace_shows_what_was_decided(made):
    for tried in attempts_between(*made):
        trace, succeeded = trace_attempt(tried, GRIPPER.release_gap)
        assert succeeded == tried.succeeded and trace.phases == PHASES
        assert np.all(np.diff(trace.time) > 0)
        later = trace.time[-1] - trace.time[0] - float(made[1].work_time[tried.ball])
        look = 0.0 if tried.is_lift else PROTOCOL.watch_time  # physics without leaps looks at a ball at other times
        earlier = 0.0 if succeeded else look  # patience ends at a look, or by rounding at the next one
        assert -1.1 * TIMESTEP - earlier < later < look + 0.1 * TIMESTEP
        assert trace.voltage.max() == pytest.approx(tried.voltage)
        assert trace.probe[-1, 0] == pytest.approx(tried.misalignment, abs=1e-8)
        limit = 0.2e-6 if tried.is_lift else GRIPPER.release_gap / 2
        assert (trace.gap_plate[-1] > limit) == (tried.succeeded == tried.is_lift)
    lift, _ = trace_attempt(attempts_between(*made)[0], GRIPPER.release_gap)
    assert lift.gap_tool[-1] < 5e-9 and lift.gap_plate[-1] > 0.2e-6
