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
STICKY = replace(GRIPPER, release_voltage=5.0)


def hands(balls, *rows, gripper=GRIPPER, **given):
    """Balls and who lifted in vain after one step of robots at rows of x, y, heading [deg]."""
    return step(gripper, balls, rows, **given)


def owner(balls, ball=0):
    """Who holds the ball, or None."""
    return int(balls.holder[ball]) if balls.is_held[ball] else None


@pytest.mark.parametrize(("gap", "lifts"), [(0.19, True), (0.21, False)])
def test_the_tool_reaches_a_fifth_of_a_millimetre(gap, lifts):
    for dx, dy in ((gap, 0), (-gap, 0), (0, gap), (0, -gap)):
        balls, failed = hands(lay((40.9 + dx, dy)), (40, 0, 0))
        assert (owner(balls) == 0) is lifts
        assert not failed[0]  # out of reach is no failure


@pytest.mark.parametrize("nearer", [0, 1])
def test_the_nearer_of_two_has_the_ball_and_the_other_fails(nearer):
    rows = [(40 - 0.9, 0.05, 0), (40 + 0.9, 0.10, 180)]
    balls, failed = hands(lay((40.0, 0.0)), *(rows if nearer == 0 else rows[::-1]))
    assert owner(balls) == nearer
    np.testing.assert_array_equal(failed, [nearer == 1, nearer == 0])


def test_the_ball_hangs_at_the_tip():
    balls = lay((0, 0), (7, 7), holders=[1, None])
    for count, row in enumerate([(40, 30, 90), (41, 30, 180)], start=1):
        balls, _ = hands(balls, (60, 60, 0), row)
        tip = {1: (40, 30.9), 2: (40.1, 30)}[count]
        np.testing.assert_allclose(balls.position, [tip, (7, 7)], atol=1e-5)
        assert balls.carried_steps.tolist() == [count, 0]


EDGE = DUMP / 2


@pytest.mark.parametrize(
    ("row", "delivered"),
    [
        ((0, 0, 0), True),
        ((EDGE - 0.5, 0, 180), True),
        ((EDGE - 0.5, 0, 0), False),  # on the dump, but the tip is beside it
        ((EDGE + 0.5, 0, 180), False),  # the tip is over the dump, but the robot does not stand there
        ((40, 0, 0), False),
    ],
)
def test_balls_are_released_on_the_dump_with_the_tip_over_it(row, delivered):
    balls, _ = hands(lay((0, 0), holders=[0]), row)
    assert (bool(balls.is_delivered[0]), owner(balls)) == ((True, None) if delivered else (False, 0))


@pytest.mark.parametrize(
    ("row", "delivered"), [((EDGE + 0.5, 0, 180), True), ((EDGE - 0.5, 0, 0), False), ((40, 0, 0), False)]
)
def test_a_ball_that_falls_on_the_dump_is_delivered(row, delivered):
    balls, _ = hands(lay((0, 0), holders=[0]), row, gripper=STICKY, falls=True)
    assert owner(balls) is None
    assert bool(balls.is_delivered[0]) is delivered and bool(balls.is_lying[0]) is not delivered
    tip = row[0] + 0.9 * np.cos(np.radians(row[2]))
    np.testing.assert_allclose(balls.position[0], [tip, 0], atol=1e-5)


PLACES = st.sampled_from([-1.8, -0.9, 0.0, 0.9, 6.6, 7.5, 8.4])  # on the dump, at its edge, and a tip apart
ROWS = st.tuples(PLACES, PLACES, st.sampled_from([0, 90, 180, 270]))
STEPS = st.tuples(
    st.sampled_from([GRIPPER, GRIPPER, WEAK, STICKY]),
    st.lists(ROWS, min_size=N, max_size=N),
    st.lists(st.booleans(), min_size=N, max_size=N),
    st.lists(st.sampled_from([False, False, True]), min_size=K, max_size=K),
)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(PLACES, PLACES), min_size=K, max_size=K), st.lists(STEPS, min_size=1, max_size=10))
def test_no_ball_is_lost_or_doubled_whatever_happens(positions, steps):
    balls = lay(*positions)
    for gripper, rows, picks, falls in steps:
        before = balls
        balls, failed = hands(before, *rows, gripper=gripper, picks=picks, falls=falls)
        held, delivered = np.asarray(balls.is_held), np.asarray(balls.is_delivered)
        lying = np.asarray(balls.is_lying)
        assert (held.astype(int) + delivered + lying == 1).all()
        holders = np.asarray(balls.holder)[held].tolist()
        assert len(holders) == len(set(holders)) and all(0 <= h < N for h in holders)
        has_ball = np.isin(np.arange(N), holders)
        np.testing.assert_array_equal(loaded(balls, N), has_ball)
        assert not (failed & has_ball).any()
        was_held, was_delivered = np.asarray(before.is_held), np.asarray(before.is_delivered)
        assert np.array(picks)[np.asarray(balls.holder)[held & ~was_held]].all()
        assert (delivered | ~was_delivered).all()  # what is delivered stays
        assert (was_held | ~delivered | was_delivered).all()  # by somebody who carried it
        np.testing.assert_array_equal(np.asarray(balls.position)[~was_held], np.asarray(before.position)[~was_held])
        assert abs(np.asarray(balls.position)[delivered]).max(initial=0) <= DUMP / 2
        np.testing.assert_array_equal(balls.holder[was_held & held], before.holder[was_held & held])
        np.testing.assert_array_equal(balls.carried_steps, before.carried_steps + held)
        np.testing.assert_array_equal(balls.was_picked, np.asarray(before.was_picked) | held)
        if gripper is WEAK:
            assert (was_held | ~held).all()
