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

LIFTED_HEIGHT = 0.2e-6
"""A ball that is farther above the plate was lifted [m]."""
TOUCH = 5e-9
"""A ball that is nearer to the tool hangs at it [m]."""


@pytest.fixture(scope="module")
def balls_of_a_step():
    """Balls before and after a step with four attempts.

    Nobody tries at ball 0. Balls 1 and 2 are to be lifted, at 40 V and at 10 V; balls 3 and 4 are
    to be released, at 55 V and at 20 V. The capacitors of the second and the last robot are nearly
    empty.
    """
    gripper = replace(GRIPPER, tool_error=4e-6)
    balls = [(90.0, 0), (40.9, 0), (60.9, 0), (0.9, 0), (0.9, 3)]
    robots = [(40, 0, 0), (60, 0, 0), (0, 0, 0), (0, 3, 0)]
    capacitors = np.array([60.0, 10.0, 60.0, 20.0], np.float32)

    before = lay(*balls, holders=[None, None, None, 2, 3])
    after, _ = step(gripper, before, robots, decider=by_host, voltage=capacitors)
    return jax.device_get(before), after


def test_attempts_follow_from_the_balls(balls_of_a_step):
    before, after = balls_of_a_step
    tried = attempts_between(before, after)

    assert [attempt.ball for attempt in tried] == [1, 2, 3, 4]
    assert [attempt.is_lift for attempt in tried] == [True, True, False, False]
    assert [attempt.succeeded for attempt in tried] == [True, False, True, False]
    assert [attempt.voltage for attempt in tried] == [40, 10, 55, 20]
    assert tried[0].misalignment > 0
    assert tried[2].misalignment == 0


def test_balls_that_stay_as_they_are_show_no_attempts(balls_of_a_step):
    _, after = balls_of_a_step
    assert attempts_between(after, after) == []


def test_an_attempt_that_is_broken_off_is_none():
    gripper = replace(GRIPPER, grasp_time=0.5)
    balls = lay((40.9, 0))
    for x in (40, 60):
        before = jax.device_get(balls)
        balls, _ = step(gripper, balls, [(x, 0, 0)])
        assert attempts_between(before, balls) == []

    assert balls.statistics.broken_off.tolist() == [1]
    assert not balls.statistics.last_attempt.any()


def test_a_trace_shows_what_was_decided(balls_of_a_step):
    before, after = balls_of_a_step
    for attempt in attempts_between(before, after):
        trace, succeeded = trace_attempt(attempt, GRIPPER)

        assert succeeded == attempt.succeeded
        assert trace.phases == PHASES
        assert np.all(np.diff(trace.time) > 0)
        assert trace.voltage.max() == pytest.approx(attempt.voltage)
        assert trace.probe[-1, 0] == pytest.approx(attempt.misalignment, abs=1e-8)

        # Physics without leaps looks at a ball at other times; patience ends at a look, or by
        # rounding at the next one.
        work_time = float(after.statistics.work_time[attempt.ball])
        excess = trace.time[-1] - trace.time[0] - work_time
        look = 0.0 if attempt.is_lift else PROTOCOL.watch_time
        earlier = 0.0 if succeeded else look
        assert -1.1 * TIMESTEP - earlier < excess < look + 0.1 * TIMESTEP

        # Off the plate are balls that were lifted, and those that were not released.
        limit = LIFTED_HEIGHT if attempt.is_lift else GRIPPER.release_gap / 2
        is_off_plate = trace.gap_plate[-1] > limit
        assert is_off_plate == (attempt.succeeded == attempt.is_lift)


def test_a_lifted_ball_hangs_at_the_tool(balls_of_a_step):
    before, after = balls_of_a_step
    lift = attempts_between(before, after)[0]
    trace, _ = trace_attempt(lift, GRIPPER)
    assert trace.gap_tool[-1] < TOUCH
    assert trace.gap_plate[-1] > LIFTED_HEIGHT
