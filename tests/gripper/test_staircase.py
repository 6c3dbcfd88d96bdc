"""The staircase of grasps on benches whose balls lift at known voltages; the end of a release."""

from dataclasses import replace

import numpy as np
import pytest

from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.run_trials import no_contact, staircase
from iswarm_mj.gripper.bench.script import START, Ramp, Watch, leap_limits, released

WHOLE_VOLTS = Protocol(step_voltage=1.0, grasp_limit=10.0, no_contact_limit=10.0)
"""A protocol with rungs of 1 V up to 10 V."""
NEVER = np.inf


class KnownBenches(MujocoBench):
    """Benches without physics: each lifts its ball between two voltages.

    Attributes:
        hangs: (B,) balls that hang at the tool.
        tried: voltages of the first bench, one after the other [V].
    """

    timestep = 1e-6
    steps = 0

    def __init__(self, *ranges, bounces=(), breaks=np.inf):
        """Set what happens at which voltage.

        Args:
            ranges: lowest and highest voltage that lifts, of each bench.
            bounces: voltages at which the ball is dropped at once.
            breaks: voltage from which on the state is not finite, of each bench.
        """
        self.low, self.high = np.array(ranges).T
        self.bounces = bounces
        self.breaks = np.array(breaks)
        self.voltage = np.zeros(len(ranges))
        self.hangs = None
        self.tried = []

    def move(self, phase, duration, tip, voltage, active=None):
        volts = np.broadcast_to(voltage, self.low.shape)
        if phase in ("lift", "ramp"):
            self.voltage = volts
            self.tried.append(volts[0])

        bounces = np.isin(self.voltage, self.bounces)
        is_lifted = (self.voltage >= self.low) & (self.voltage <= self.high)
        self.hangs = is_lifted | bounces
        stays_up = self.hangs & ~bounces
        is_active = np.broadcast_to(True if active is None else active, volts.shape)
        never = np.full(len(volts), -np.inf)
        return Watch(
            last_tool=never,
            last_plate=np.zeros(len(volts)),
            first_plate=np.where(stays_up, NEVER, 0.0),
            landing_speed=never,
            gap_tool=np.where(self.hangs, 0.0, 1e-6),
            gap_plate=np.where(self.hangs, 1e-6, 0.0),
            speed=never,
            finite=~is_active | (self.voltage < self.breaks),
        )

    def off_axis(self):
        return np.zeros(len(self.low))

    def save(self):
        return None

    def restore(self, state):
        self.hangs = None


def above(*voltages):
    """Return the ranges of balls that are lifted from a voltage on."""
    return [(voltage, np.inf) for voltage in voltages]


def test_the_first_rung_that_lifts():
    """It can be the one without voltage, or the last; in the end all those balls hang."""
    benches = KnownBenches(*above(0.0, 0.1, 4.2, 5.0, 9.9, 10.0, 10.1))
    grasp = staircase(benches, WHOLE_VOLTS, 7)
    np.testing.assert_array_equal(grasp.voltage, [0, 1, 5, 5, 10, 10, np.nan])
    np.testing.assert_array_equal(benches.hangs, [True] * 6 + [False])
    assert not grasp.faulty.any()


@pytest.mark.parametrize(("step", "limit", "highest"), [(0.4, 1.1, 2), (0.1, 0.3, 3)])
def test_the_highest_rung_is_within_the_limit(step, limit, highest):
    assert Protocol(step_voltage=step, grasp_limit=limit).highest_rung == highest


def test_a_lift_below_a_gap_is_found_below_it():
    """Bisection of all rungs would find one above the gap, where a higher one fails to lift."""
    benches = KnownBenches((28.2, 30.0), (28.2, np.inf), (3.3, 5.0))
    grasp = staircase(benches, Protocol(step_voltage=0.25, grasp_limit=80.0), 3)
    np.testing.assert_array_equal(grasp.voltage, [28.25, 28.25, 3.5])
    assert len(benches.tried) < 40


def test_a_ball_that_comes_down_again_is_not_lifted():
    """It bounces, and is at the tool just as it is looked at."""
    benches = KnownBenches((8.0, np.inf), bounces=(3.0, 5.0))
    grasp = staircase(benches, WHOLE_VOLTS, 1)
    np.testing.assert_array_equal(grasp.voltage, [8.0])


def ramp_without_contact(bench, protocol, count):
    """Return the outcome of a ramp 1 um above the balls."""
    return no_contact(bench, protocol, 1e-6, count)


@pytest.mark.parametrize("lift", [staircase, ramp_without_contact])
def test_a_bench_whose_state_is_not_finite_is_faulty(lift):
    """The second one from 6 V on, before it lifts its ball; the third never."""
    benches = KnownBenches(*above(4.0, 9.0, 9.0), breaks=[6.0, 6.0, np.inf])
    grasp = lift(benches, WHOLE_VOLTS, 3)
    assert grasp.faulty.tolist() == [False, True, False]
    np.testing.assert_allclose(grasp.voltage[[0, 2]], [4.0, 9.0], atol=0.41)


LOOK = 0.09e-3
"""Time between two looks [s]."""
RAMP = Ramp(rate=1e6, limit=50.0, patience=0.4e-3)
"""A ramp that rises within 0.05 ms."""
HANGS = Watch(
    last_tool=-np.inf,
    last_plate=-np.inf,
    first_plate=np.inf,
    landing_speed=0.0,
    gap_tool=0.0,
    gap_plate=5e-6,
    speed=0.0,
    finite=True,
)
"""A ball that hangs at the tool, 5 um above the plate."""
LEAVES = HANGS._replace(last_tool=0.03e-3, gap_tool=1e-6)
"""The ball is 1 um below the tool."""
FLIES = LEAVES._replace(last_tool=-np.inf)
LANDS = Watch(
    last_tool=-np.inf,
    last_plate=0.05e-3,
    first_plate=0.04e-3,
    landing_speed=0.1,
    gap_tool=3e-6,
    gap_plate=1e-6,
    speed=5e-3,
    finite=True,
)
"""The ball has bounced: it is at 5 mm/s, 1 um above the plate, and rises to 2.3 um."""
LIES = Watch(
    last_tool=0.01e-3,
    last_plate=0.05e-3,
    first_plate=0.02e-3,
    landing_speed=0.7,
    gap_tool=5e-6,
    gap_plate=0.0,
    speed=0.0,
    finite=True,
)
IS_SQUEEZED = LIES._replace(gap_tool=0.0)
"""The ball is between tool and plate."""


def follow_release(*looks, low=0.0, **protocol):
    """Return the progress of a release after each look."""
    progress = START
    progress_of_looks = []
    for k, watch in enumerate(looks):
        progress = released(
            protocol=replace(Protocol(), **protocol),
            ramp=RAMP,
            low=low,
            was=progress,
            watch=watch,
            last_look=k * LOOK,
            time=(k + 1) * LOOK,
        )
        progress_of_looks.append(progress)
    return progress_of_looks


def test_the_last_touch_the_first_landing_and_rest_end_a_release():
    """Later touches and landings do not count, and the ball must lie for 0.2 ms."""
    touches = HANGS._replace(last_tool=0.02e-3)
    *earlier, last = follow_release(touches, LEAVES, LANDS, LIES, LIES, LIES)

    assert not any(progress.is_over for progress in earlier)
    assert last.is_over
    assert last.succeeds
    assert not last.is_faulty
    assert last.touched == pytest.approx(LOOK + LEAVES.last_tool)
    assert last.freed == pytest.approx(2 * LOOK)
    assert last.landed == pytest.approx(2 * LOOK + LANDS.first_plate)
    assert last.speed == LANDS.landing_speed
    assert last.moved == pytest.approx(3 * LOOK)


@pytest.mark.parametrize(
    ("looks", "settings", "last_look", "succeeds"),
    [
        pytest.param([HANGS] * 5, {}, 5, False, id="patience of 0.4 ms"),
        pytest.param([HANGS._replace(finite=False)], {}, 1, False, id="faulty"),
        pytest.param(
            [HANGS, LEAVES, LANDS, *[LIES] * 4],
            {"cut_delay": 1e-3},
            None,
            True,
            id="the voltage is still on",
        ),
        pytest.param(
            [HANGS, LEAVES, LANDS, *[LIES] * 3],
            {"after_release": "held"},
            6,
            True,
            id="the voltage is held",
        ),
        pytest.param(
            [HANGS, LEAVES, LANDS, *[IS_SQUEEZED] * 4],
            {},
            None,
            False,
            id="between tool and plate",
        ),
        pytest.param([HANGS, LEAVES, LANDS], {"low": 2.5e-6}, 3, True, id="bounces no higher"),
        pytest.param([HANGS, LEAVES, LANDS], {"low": 2e-6}, None, False, id="bounces higher"),
        pytest.param(
            [HANGS, LEAVES, LANDS],
            {"low": 2.5e-6, "cut_delay": 0.1e-3},
            None,
            False,
            id="bounces under voltage",
        ),
        pytest.param(
            [HANGS, LEAVES, *[FLIES] * 3],
            {"flight_limit": 0.3e-3},
            5,
            False,
            id="flies too long",
        ),
        pytest.param(
            [HANGS, LEAVES, *[FLIES] * 3],
            {"flight_limit": 0.35e-3},
            None,
            False,
            id="still flies",
        ),
    ],
)
def test_when_a_release_is_over(looks, settings, last_look, succeeds):
    """It is at the last look, counted from 1, or not at all."""
    progress = follow_release(*looks, **settings)
    is_over = [bool(each.is_over) for each in progress]
    if last_look is None:
        assert not is_over[-1]
    else:
        assert is_over.index(True) + 1 == last_look
    assert bool(progress[-1].succeeds) is succeeds
    assert progress[-1].is_faulty is not looks[-1].finite


def test_a_release_leaps_while_the_voltage_stays():
    """It leaps until its patience ends while the ball hangs, and while it bounces."""
    protocol = Protocol()
    assert leap_limits(protocol, RAMP, START, 0.04e-3) == (0.0, 0.0)
    assert leap_limits(protocol, RAMP, START, 0.06e-3) == pytest.approx((0.34e-3, 0.0))

    freed = START._replace(freed=0.1e-3)
    assert leap_limits(protocol, RAMP, freed, 0.2e-3) == (0.0, 0.0)

    bounces = freed._replace(landed=0.1e-3)
    assert leap_limits(protocol, RAMP, bounces, 0.2e-3) == (0.0, protocol.flight_limit)

    is_over = bounces._replace(is_over=True)
    assert leap_limits(protocol, RAMP, is_over, 0.2e-3) == (0.0, 0.0)
