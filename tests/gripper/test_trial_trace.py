"""Thinning of traces: nothing happens unseen."""

import numpy as np
from support.trace import bench_trace

from iswarm_mj.gripper.bench.tracing import thinned


def test_samples_are_samples_of_the_trace():
    trace = bench_trace()
    few = thinned(trace, 100)
    assert len(few.time) <= 100 + len(trace.phases) + 1
    at = np.searchsorted(trace.time, few.time)
    for whole, part in zip(trace, few, strict=True):
        assert np.array_equal(whole[at], part) if isinstance(whole, np.ndarray) else whole == part


def test_ends_and_phases_stay():
    trace = bench_trace()
    few = thinned(trace, 20)
    assert few.time[0] == trace.time[0] and few.time[-1] == trace.time[-1]
    begins = trace.time[np.flatnonzero(np.diff(trace.phase, prepend=-1))]
    assert len(begins) == len(trace.phases) and np.isin(begins, few.time).all()


def test_flight_is_seen_closely():
    """The fall of 5 um takes a sixtieth of the trial, and gets far more than a sixtieth of the samples."""
    trace = bench_trace()
    few = thinned(trace, 200)
    falling = (few.phases.index("release ramp") == few.phase) & (few.gap_tool > 0) & (few.gap_plate > 0)
    assert falling.sum() > 20
    assert np.diff(few.ball[falling, 2]).min() > -0.5e-6
