"""Traces of attempts against the trials that decided about them in the swarm."""

import jax
import numpy as np
import pytest

from iswarm_mj.config import GripperConfig
from iswarm_mj.gripper.attempts import Attempts
from iswarm_mj.gripper.bench.attempt_log import listening
from iswarm_mj.gripper.bench.attempt_trace import PHASES, trace_attempt
from iswarm_mj.gripper.bench.deciders import by_host

GRIPPER = GripperConfig()


@pytest.fixture(scope="module")
def heard():
    """Two lifts at 40 and 10 V, a release at 55 V, and a ball that nothing is tried at, in two worlds alike."""
    lifts, releases = np.array([True, True, False, False]), np.array([False, False, True, False])
    volts, ones = np.array([40.0, 10.0, 55.0, 40.0], np.float32), np.ones(4, np.float32)
    miss = np.array([4e-6, 0, 0, 0], np.float32)
    rows = Attempts(lifts, releases, volts, 20e-6 * ones, 1.41e-3 * ones, 14.7e-3 * ones, miss)
    both = jax.tree.map(lambda a: np.stack([a, a]), rows)
    decide = jax.jit(jax.vmap(lambda *arrays: by_host(GRIPPER, Attempts(*arrays))))
    with listening() as tried:
        found = jax.block_until_ready(decide(*both))
    jax.block_until_ready(decide(*both))  # nobody listens
    return tried, found


def test_attempts_are_heard_once_with_their_outcomes(heard):
    tried, found = heard
    assert [(t.ball, t.is_lift, t.succeeded) for t in tried] == [(0, True, True), (1, True, False), (2, False, True)]
    assert [t.voltage for t in tried] == [40, 10, 55]
    for t in tried:
        assert t.duration == float(found.duration[0, t.ball]) > 0 and t.impact == float(found.impact[0, t.ball])


def test_a_trace_shows_what_was_decided(heard):
    for tried in heard[0]:
        trace, succeeded = trace_attempt(tried, GRIPPER.release_gap)
        assert succeeded == tried.succeeded and trace.phases == PHASES
        assert np.all(np.diff(trace.time) > 0)
        assert trace.time[-1] - trace.time[0] == pytest.approx(tried.duration, abs=5e-6)
        assert trace.voltage.max() == pytest.approx(tried.voltage)
        assert trace.probe[-1, 0] == pytest.approx(tried.misalignment, abs=1e-8)
        limit = 0.2e-6 if tried.is_lift else GRIPPER.release_gap / 2
        assert (trace.gap_plate[-1] > limit) == (tried.succeeded == tried.is_lift)
    lift, _ = trace_attempt(heard[0][0], GRIPPER.release_gap)
    assert lift.gap_tool[-1] < 5e-9 and lift.gap_plate[-1] > 0.2e-6
