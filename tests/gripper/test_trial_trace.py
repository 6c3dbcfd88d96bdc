"""Thinning of traces: nothing happens unseen."""

import numpy as np
from helpers_trace import bench_trace

from iswarm_mj.gripper.bench.trial_trace import Trace, thinned


def straight(count):
    """A trace in which nothing happens but the passing of time."""
    zero = np.zeros(count)
    arrays = {name: zero for name in Trace._fields} | {"time": np.arange(count) * 1e-6, "phase": zero.astype(int)}
    arrays |= {"probe": np.zeros((count, 3)), "ball": np.zeros((count, 3)), "ball_quaternion": np.zeros((count, 4))}
    numbers = {"phases": ("rest",), "radius": 20e-6, "probe_radius": 13e-6, "weight": 2.4e-9, "probe_weight": 1e-6}
    return Trace(**arrays | numbers | {name: zero.astype(bool) for name in ("on_plate_potential", "broken")})


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


def test_quiet_traces_are_thinned_evenly():
    few = thinned(straight(1000), 10)
    assert 9 <= len(few.time) <= 12
    assert np.ptp(np.diff(few.time)[:-1]) < 2.1e-6
