"""The staircase of grasps on benches whose balls lift at known voltages; when a release is over."""

import numpy as np

from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.run_trials import staircase
from iswarm_mj.gripper.bench.script import Progress, Ramp, Watch, released


class Benches(MujocoBench):
    """Each lifts its ball between two voltages, and drops it at once at those where it `bounces`."""

    timestep, steps = 1e-6, 0

    def __init__(self, *ranges, bounces=()):
        self.low, self.high = np.array(ranges).T
        self.bounces, self.volts, self.hangs, self.tried = bounces, np.zeros(len(ranges)), None, []

    def move(self, phase, duration, tip, voltage, active=None):
        volts = np.broadcast_to(voltage, self.low.shape)
        if phase == "lift":
            self.volts = volts
            self.tried.append(volts[0])
        bounces = np.isin(self.volts, self.bounces)
        self.hangs = ((self.volts >= self.low) & (self.volts <= self.high)) | bounces
        nothing, gap = np.full(len(volts), -np.inf), np.where(self.hangs, 1e-6, 0.0)
        plate = np.where(self.hangs & ~bounces, np.inf, 0.0)
        return Watch(nothing, nothing, plate, nothing, np.where(self.hangs, 0.0, 1e-6), gap, nothing, gap >= 0)

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


def test_the_limit_of_a_flight_counts_from_the_last_touch():
    limit = Protocol().flight_limit
    was = Progress(1.0, 1.0 + limit / 2, np.inf, 0.0, 1.0, False, False, False)
    watch, now = Watch(-np.inf, -np.inf, np.inf, 0.0, 1e-4, 1e-4, 1.0, True), 1.0 + 1.25 * limit
    assert released(Protocol(), Ramp(1.0, 1.0, 9.0), 0.0, was, watch, now - 1e-6, now).is_over
