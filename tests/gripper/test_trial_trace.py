"""Thinning of traces: no event is lost."""

import numpy as np
from support.trace import bench_trace

from iswarm_mj.gripper.bench.tracing import thinned


def test_samples_are_samples_of_the_trace():
    limit = 100
    trace = bench_trace()
    few = thinned(trace, limit)
    assert len(few.time) <= limit + len(trace.phases) + 1

    kept = np.searchsorted(trace.time, few.time)
    for values, values_kept in zip(trace, few, strict=True):
        if isinstance(values, np.ndarray):
            np.testing.assert_array_equal(values[kept], values_kept)
        else:
            assert values == values_kept


def test_ends_and_phases_stay():
    trace = bench_trace()
    few = thinned(trace, 20)
    assert few.time[0] == trace.time[0]
    assert few.time[-1] == trace.time[-1]

    begins_of_phases = trace.time[np.flatnonzero(np.diff(trace.phase, prepend=-1))]
    assert len(begins_of_phases) == len(trace.phases)
    assert np.isin(begins_of_phases, few.time).all()


def test_flight_is_seen_closely():
    """The fall of 5 um takes a sixtieth of the trial, and gets far more of the samples."""
    few = thinned(bench_trace(), 200)
    is_ramp = few.phase == few.phases.index("release ramp")
    is_falling = is_ramp & (few.gap_tool > 0) & (few.gap_plate > 0)
    assert is_falling.sum() > 20
    assert np.diff(few.ball[is_falling, 2]).min() > -0.5e-6
