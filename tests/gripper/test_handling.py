"""Lifting, carrying and releasing: who has which ball."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.attempts import DUMP, GRIPPER, K, N, step
from support.sensing import lay

from iswarm_mj.gripper.handling import loaded

WEAK = replace(GRIPPER, grasp_voltage=5.0)
"""A gripper that lifts no ball."""
STICKY = replace(GRIPPER, release_voltage=5.0)
"""A gripper that releases no ball."""
TIP = 0.9
"""Distance of the tip ahead of the robot's centre [mm]."""
EDGE = DUMP / 2
"""Distance of the dump's edge from its centre [mm]."""


def holder_of(balls, ball=0):
    """Return the robot that holds a ball, or None."""
    return int(balls.holder[ball]) if balls.is_held[ball] else None


@pytest.mark.parametrize(("gap", "lifts"), [(0.19, True), (0.21, False)])
def test_the_tool_reaches_a_fifth_of_a_millimetre(gap, lifts):
    """It does in each direction; a ball out of reach is no failure."""
    for dx, dy in ((gap, 0), (-gap, 0), (0, gap), (0, -gap)):
        balls, failed = step(GRIPPER, lay((40 + TIP + dx, dy)), [(40, 0, 0)])
        assert (holder_of(balls) == 0) is lifts
        assert not failed[0]


@pytest.mark.parametrize("nearer", [0, 1])
def test_the_nearer_of_two_has_the_ball_and_the_other_fails(nearer):
    near_robot = (40 - TIP, 0.05, 0)
    far_robot = (40 + TIP, 0.10, 180)
    robots = [near_robot, far_robot] if nearer == 0 else [far_robot, near_robot]

    balls, failed = step(GRIPPER, lay((40.0, 0.0)), robots)

    assert holder_of(balls) == nearer
    np.testing.assert_array_equal(failed, [nearer == 1, nearer == 0])


def test_the_ball_hangs_at_the_tip():
    elsewhere = (60, 60, 0)
    holder_and_tip = [((40, 30, 90), (40, 30 + TIP)), ((41, 30, 180), (41 - TIP, 30))]
    balls = lay((0, 0), (7, 7), holders=[1, None])

    for count, (holder, tip) in enumerate(holder_and_tip, start=1):
        balls, _ = step(GRIPPER, balls, [elsewhere, holder])
        np.testing.assert_allclose(balls.position, [tip, (7, 7)], atol=1e-5)
        assert balls.carried_steps.tolist() == [count, 0]


@pytest.mark.parametrize(
    ("robot", "is_delivered"),
    [
        ((0, 0, 0), True),
        ((EDGE - 0.5, 0, 180), True),
        # The robot is on the dump, but the tip is beside it; and the other way round.
        ((EDGE - 0.5, 0, 0), False),
        ((EDGE + 0.5, 0, 180), False),
        ((40, 0, 0), False),
    ],
)
def test_balls_are_released_on_the_dump_with_the_tip_over_it(robot, is_delivered):
    balls, _ = step(GRIPPER, lay((0, 0), holders=[0]), [robot])
    assert bool(balls.is_delivered[0]) is is_delivered
    assert holder_of(balls) == (None if is_delivered else 0)


@pytest.mark.parametrize(
    ("robot", "is_delivered"),
    [((EDGE + 0.5, 0, 180), True), ((EDGE - 0.5, 0, 0), False), ((40, 0, 0), False)],
)
def test_a_ball_that_falls_on_the_dump_is_delivered(robot, is_delivered):
    """The tip must be over the dump, wherever the robot stands."""
    balls, _ = step(STICKY, lay((0, 0), holders=[0]), [robot], falls=True)
    assert holder_of(balls) is None
    assert bool(balls.is_delivered[0]) is is_delivered
    assert bool(balls.is_lying[0]) is not is_delivered

    x, _, heading = robot
    tip = x + TIP * np.cos(np.radians(heading))
    np.testing.assert_allclose(balls.position[0], [tip, 0], atol=1e-5)


COORDINATES = st.sampled_from([-1.8, -0.9, 0.0, 0.9, 6.6, 7.5, 8.4])
"""Coordinates on the dump and at its edge, a tip apart [mm]."""
ROBOTS = st.tuples(COORDINATES, COORDINATES, st.sampled_from([0, 90, 180, 270]))
STEPS = st.tuples(
    st.sampled_from([GRIPPER, GRIPPER, WEAK, STICKY]),
    st.lists(ROBOTS, min_size=N, max_size=N),
    st.lists(st.booleans(), min_size=N, max_size=N),
    st.lists(st.sampled_from([False, False, True]), min_size=K, max_size=K),
)


@settings(max_examples=25, deadline=None)
@given(
    st.lists(st.tuples(COORDINATES, COORDINATES), min_size=K, max_size=K),
    st.lists(STEPS, min_size=1, max_size=10),
)
def test_no_ball_is_lost_or_doubled_whatever_happens(positions, steps):
    after = lay(*positions)
    for gripper, robots, picks, falls in steps:
        before = after
        after, failed = step(gripper, before, robots, picks=picks, falls=falls)
        check_each_ball_is_somewhere(after)
        check_holders(after, failed)
        check_changes(before, after, picks)
        if gripper is WEAK:
            assert not picked_up(before, after).any()


def picked_up(before, after):
    """Return the balls that were picked up."""
    return np.asarray(after.is_held) & ~np.asarray(before.is_held)


def check_each_ball_is_somewhere(balls):
    """Check that each ball is held, delivered or lying, and that delivered ones are on the dump."""
    held = np.asarray(balls.is_held).astype(int)
    delivered = np.asarray(balls.is_delivered)
    lying = np.asarray(balls.is_lying)
    assert (held + delivered + lying == 1).all()
    assert abs(np.asarray(balls.position)[delivered]).max(initial=0) <= EDGE


def check_holders(balls, failed):
    """Check that each robot holds one ball at most, and that none with a ball has failed."""
    holders = np.asarray(balls.holder)[np.asarray(balls.is_held)].tolist()
    assert len(holders) == len(set(holders))
    assert all(0 <= holder < N for holder in holders)

    has_ball = np.isin(np.arange(N), holders)
    np.testing.assert_array_equal(loaded(balls, N), has_ball)
    assert not (failed & has_ball).any()


def check_changes(before, after, picks):
    """Check that balls change hands, place and state only in the allowed ways."""
    was_held = np.asarray(before.is_held)
    is_held = np.asarray(after.is_held)
    was_delivered = np.asarray(before.is_delivered)
    is_delivered = np.asarray(after.is_delivered)

    # Only robots that pick up dust have picked up balls, and carriers keep theirs.
    assert np.array(picks)[np.asarray(after.holder)[picked_up(before, after)]].all()
    stays_held = was_held & is_held
    np.testing.assert_array_equal(after.holder[stays_held], before.holder[stays_held])

    # Delivered balls stay so, and were brought by a robot that carried them.
    assert (is_delivered | ~was_delivered).all()
    assert (was_held | ~is_delivered | was_delivered).all()

    # Balls that nobody held have not moved.
    places_before = np.asarray(before.position)[~was_held]
    places_after = np.asarray(after.position)[~was_held]
    np.testing.assert_array_equal(places_after, places_before)

    np.testing.assert_array_equal(after.carried_steps, before.carried_steps + is_held)
    np.testing.assert_array_equal(after.was_picked, np.asarray(before.was_picked) | is_held)
