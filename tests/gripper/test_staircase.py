"""The staircase of grasps on benches whose balls lift at known voltages; when a release is over."""

from dataclasses import replace

import numpy as np
import pytest

from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.run_trials import no_contact, staircase
from iswarm_mj.gripper.bench.script import START, Ramp, Watch, leap_limits, released


class Benches(MujocoBench):
    """Each lifts its ball between two voltages, and drops it at once at those where it `bounces`."""

    timestep, steps = 1e-6, 0

    def __init__(self, *ranges, bounces=(), breaks=np.inf):
        self.low, self.high = np.array(ranges).T
        self.bounces, self.volts, self.hangs, self.tried = bounces, np.zeros(len(ranges)), None, []
        self.breaks = np.array(breaks)

    def move(self, phase, duration, tip, voltage, active=None):
        volts = np.broadcast_to(voltage, self.low.shape)
        if phase in ("lift", "ramp"):
            self.volts = volts
            self.tried.append(volts[0])
        bounces = np.isin(self.volts, self.bounces)
        self.hangs = ((self.volts >= self.low) & (self.volts <= self.high)) | bounces
        nothing, gap = np.full(len(volts), -np.inf), np.where(self.hangs, 1e-6, 0.0)
        plate = np.where(self.hangs & ~bounces, np.inf, 0.0)
        is_active = np.broadcast_to(True if active is None else active, volts.shape)
        finite = ~is_active | (self.volts < self.breaks)
        return Watch(nothing, 0 * gap, plate, nothing, np.where(self.hangs, 0.0, 1e-6), gap, nothing, finite)

    def off_axis(self):
        return np.zeros(len(self.low))

    def save(self):
        return None

    def restore(self, state):
        self.hangs = None


def above(*voltages):
    return [(voltage, np.inf) for voltage in voltages]


def test_the_first_rung_that_lifts():
    """Also the one without voltage, and the last; in the end all balls hang that can be lifted."""
    benches = Benches(*above(0.0, 0.1, 4.2, 5.0, 9.9, 10.0, 10.1))
    found = staircase(benches, Protocol(step_voltage=1.0, grasp_limit=10.0), 7)
    np.testing.assert_array_equal(found.voltage, [0, 1, 5, 5, 10, 10, np.nan])
    np.testing.assert_array_equal(benches.hangs, [True] * 6 + [False])
    assert not found.faulty.any()
    limits = [(0.4, 1.1), (0.1, 0.3)]
    assert [Protocol(step_voltage=step, grasp_limit=limit).highest_rung for step, limit in limits] == [2, 3]


def test_what_lifts_below_a_gap_is_found_below_it():
    """Where a ball no longer lifts at higher voltages, bisection of the whole range finds a rung above the gap."""
    benches = Benches((28.2, 30.0), (28.2, np.inf), (3.3, 5.0))
    found = staircase(benches, Protocol(step_voltage=0.25, grasp_limit=80.0), 3)
    np.testing.assert_array_equal(found.voltage, [28.25, 28.25, 3.5])
    assert len(benches.tried) < 40


def test_a_ball_that_comes_down_again_is_not_lifted():
    """It bounces, and is at the tool just as it is looked at."""
    found = staircase(Benches((8.0, np.inf), bounces=(3.0, 5.0)), Protocol(step_voltage=1.0, grasp_limit=10.0), 1)
    np.testing.assert_array_equal(found.voltage, [8.0])


def test_a_bench_whose_state_is_not_finite_is_faulty():
    """The second one from 6 V on, the third never."""
    protocol = Protocol(step_voltage=1.0, grasp_limit=10.0, no_contact_limit=10.0)
    for ramp in (staircase, lambda bench, protocol, count: no_contact(bench, protocol, 1e-6, count)):
        found = ramp(Benches(*above(4.0, 9.0, 9.0), breaks=[6.0, 6.0, np.inf]), protocol, 3)
        assert found.faulty.tolist() == [False, True, False]
        np.testing.assert_allclose(found.voltage[[0, 2]], [4.0, 9.0], atol=0.41)


LOOK = 0.09e-3
HANGS = Watch(-np.inf, -np.inf, np.inf, 0.0, 0.0, 5e-6, 0.0, True)
"""A ball that hangs at the tool, 5 um above the plate."""
LEAVES = HANGS._replace(last_tool=0.03e-3, gap_tool=1e-6)
LANDS = Watch(-np.inf, 0.05e-3, 0.04e-3, 0.1, 3e-6, 1e-6, 5e-3, True)
"""It is at 5 mm/s, 1 um above the plate, and rises to 2.3 um."""
LIES = Watch(0.01e-3, 0.05e-3, 0.02e-3, 0.7, 5e-6, 0.0, 0.0, True)


def followed(*looks, low=0.0, **protocol):
    """Progress of a release, look by look."""
    ramp, at, found = Ramp(1e6, 50.0, 0.4e-3), START, []
    for k, watch in enumerate(looks):
        at = released(replace(Protocol(), **protocol), ramp, low, at, watch, k * LOOK, (k + 1) * LOOK)
        found.append(at)
    return found


def test_the_last_touch_the_first_landing_and_rest_end_a_release():
    """Later touches and landings do not count, and it must lie for 0.2 ms."""
    at = followed(HANGS._replace(last_tool=0.02e-3), LEAVES, LANDS, *[LIES] * 3)
    assert [each.is_over for each in at] == [False] * 5 + [True] and at[-1].succeeds and not at[-1].is_faulty
    assert at[-1].touched == pytest.approx(LOOK + 0.03e-3) and at[-1].freed == pytest.approx(2 * LOOK)
    assert at[-1].landed == pytest.approx(2 * LOOK + 0.04e-3) and at[-1].speed == 0.1
    assert at[-1].moved == pytest.approx(3 * LOOK)


@pytest.mark.parametrize(
    ("looks", "more", "over", "succeeds"),
    [
        ([HANGS] * 5, {}, 5, False),  # patience of 0.4 ms
        ([HANGS._replace(finite=False)], {}, 1, False),
        ([HANGS, LEAVES, LANDS, *[LIES] * 4], {"cut_delay": 1e-3}, None, True),  # the voltage is still on
        ([HANGS, LEAVES, LANDS, *[LIES] * 3], {"after_release": "held"}, 6, True),
        ([HANGS, LEAVES, LANDS, *[LIES._replace(gap_tool=0.0)] * 4], {}, None, False),  # between tool and plate
        ([HANGS, LEAVES, LANDS], {"low": 2.5e-6}, 3, True),  # bounces no higher
        ([HANGS, LEAVES, LANDS], {"low": 2e-6}, None, False),
        ([HANGS, LEAVES, LANDS], {"low": 2.5e-6, "cut_delay": 0.1e-3}, None, False),
        ([HANGS, LEAVES, *[LEAVES._replace(last_tool=-np.inf)] * 3], {"flight_limit": 0.3e-3}, 5, False),
        ([HANGS, LEAVES, *[LEAVES._replace(last_tool=-np.inf)] * 3], {"flight_limit": 0.35e-3}, None, False),
    ],
)
def test_when_a_release_is_over(looks, more, over, succeeds):
    at = followed(*looks, **more)
    assert ([each.is_over for each in at].index(True) + 1 if over else not at[-1].is_over) == (over or True)
    assert bool(at[-1].succeeds) is succeeds and at[-1].is_faulty is not looks[-1].finite


def test_a_release_leaps_while_the_voltage_stays():
    """Until its patience ends while the ball hangs, and while it bounces; 50 V are reached after 0.05 ms."""
    protocol, ramp, limit = Protocol(), Ramp(1e6, 50.0, 0.4e-3), Protocol().flight_limit
    at = START._replace(freed=0.1e-3)
    assert leap_limits(protocol, ramp, START, 0.04e-3) == (0.0, 0.0)
    assert leap_limits(protocol, ramp, START, 0.06e-3) == pytest.approx((0.34e-3, 0.0))
    assert leap_limits(protocol, ramp, at, 0.2e-3) == (0.0, 0.0)
    assert leap_limits(protocol, ramp, at._replace(landed=0.1e-3), 0.2e-3) == (0.0, limit)
    assert leap_limits(protocol, ramp, at._replace(landed=0.1e-3, is_over=True), 0.2e-3) == (0.0, 0.0)
