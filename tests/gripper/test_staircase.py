"""The staircase of grasps on benches whose balls lift at known voltages."""

import numpy as np

from iswarm_mj.gripper.bench.base import Watch
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.staircase import staircase


class Benches:
    """Each lifts its ball at its own voltage or above."""

    timestep, steps = 1e-6, 0

    def __init__(self, *lifting):
        self.lifting, self.lifted = np.array(lifting), None

    def move(self, phase, duration, tip, voltage, active=None):
        self.lifted = np.broadcast_to(voltage, self.lifting.shape) >= self.lifting
        nothing = np.full(len(self.lifting), np.nan)
        gap = np.where(self.lifted, 1e-6, 0.0)
        return Watch(nothing, nothing, nothing, nothing, -gap, gap, nothing, np.ones(len(gap), bool))

    def save(self):
        return None

    def restore(self, state):
        self.lifted = None


def test_the_lowest_rung_that_lifts():
    """Also the first, without voltage, and the last; in the end all balls hang that can be lifted."""
    benches = Benches(0.0, 0.1, 4.2, 5.0, 9.9, 10.0, 10.1)
    found = staircase(benches, Protocol(step_voltage=1.0, grasp_limit=10.0), 7)
    np.testing.assert_array_equal(found.voltage, [0, 1, 5, 5, 10, 10, np.nan])
    np.testing.assert_array_equal(benches.lifted, [True] * 6 + [False])
    assert not found.faulty.any()
