"""Changes of a run have a text; they put balls and robots where they say, or change nothing."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.page import CONFIG
from support.sessions import PAGE_SCENARIO, assert_same, begun, state

from iswarm_mj.player.changes import Change, edit_of_swarm
from iswarm_mj.player.scenario import PageScenario
from iswarm_mj.player.session import Session
from iswarm_mj.tasks.aggregation import Aggregation, Beeclust
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.units import RD

PLACE = np.array([9.0, 9.0])
"""Place of a ball that is dropped [rd]."""
DROP = Change(1, "ball", "9.0,9.0")
"""Drops it."""


@pytest.fixture(scope="module")
def session():
    """A session after a step, which no test changes."""
    return begun()


def test_a_change_is_read_from_its_text():
    change = Change(5, "kill", "1")
    assert str(change) == "5:kill=1"
    assert Change.parse(str(change)) == change


@pytest.mark.parametrize("text", ["", "5", "x:kill=1", "5:kill", "-1:kill=2"])
def test_other_texts_are_refused(text):
    with pytest.raises(UserError, match="STEP:SETTING=VALUE"):
        Change.parse(text)


@pytest.mark.parametrize(
    "words",
    [
        "kill=20",
        "kill=x",
        "revive=-1",
        "ball=99,0",
        "ball=nan,0",
        "ball=3",
        "ball=a",
        "move=3,99,0",
        "move=99,0,0",
        "move=1,2",
        "fail=1.5",
        "fail=nan",
        "nothing=1",
        "robots=3",
        "p_vector_forget=2",
        "use_hop_count=1",
    ],
)
def test_an_impossible_change_begins_no_session_and_changes_nothing_later(session, words):
    change = Change.parse(f"4:{words}")
    with pytest.raises(UserError):
        Session(PAGE_SCENARIO, [change])

    before = state(session.run)
    session.post(lambda: session.change(change.name, change.value))
    session.work()
    assert session.messages.get_nowait()
    assert not session.changes
    assert_same(state(session.run), before)


def test_balls_are_refused_where_a_task_has_none():
    scenario = PageScenario(strategy=Beeclust(), task=Aggregation(), robots=4)
    with pytest.raises(UserError, match="Aggregation has no balls"):
        Session(scenario, [Change.parse("9:ball=0,0")])


def test_a_ball_lies_where_it_was_dropped():
    session = begun()
    session.change(DROP.name, DROP.value)
    balls = session.run.task_state
    distance = np.linalg.norm(balls.position[0] - PLACE * 2 * np.sqrt(2), axis=-1)
    ball = distance.argmin()
    assert distance[ball] < 1e-4
    assert balls.is_lying[0, ball]


class TestWhichBall:
    """The farthest ball that no robot holds is dropped, of those delivered if there are any."""

    @pytest.fixture
    def swarm(self, session):
        """The swarm of the session, whose arrays a test may change."""
        return jax.tree.map(np.array, session.run.arrays()[1].swarm)

    @pytest.fixture
    def nearest_first(self, swarm):
        """Numbers of the balls by their distance from the place."""
        distance = np.linalg.norm(swarm.task.position[0] - PLACE * RD, axis=-1)
        return np.argsort(distance)

    @staticmethod
    def drop(session, swarm):
        """Drop a ball; return its number and the balls."""
        balls = edit_of_swarm(session.run, DROP)(swarm).task
        has_moved = (balls.position != swarm.task.position).any(axis=-1)[0]
        (ball,) = np.flatnonzero(has_moved)
        np.testing.assert_allclose(balls.position[0, ball], PLACE * RD, rtol=1e-6)
        return ball, balls

    def test_balls_on_the_floor(self, session, swarm, nearest_first):
        swarm.task.is_held[0, nearest_first[-1]] = True
        ball, balls = self.drop(session, swarm)
        assert ball == nearest_first[-2]
        assert not balls.is_delivered.any()

    def test_balls_that_were_delivered(self, session, swarm, nearest_first):
        swarm.task.is_delivered[0, nearest_first[:3]] = True
        ball, balls = self.drop(session, swarm)
        assert ball == nearest_first[2]
        assert balls.is_delivered.sum() == 2
        assert not balls.is_delivered[0, ball]


def test_a_share_of_the_living_robots_fails_the_same_way_each_time(session):
    run = session.run
    _, state = run.arrays()
    once = edit_of_swarm(run, Change.parse("4:fail=0.25"))(state.swarm)
    again = edit_of_swarm(run, Change.parse("4:fail=0.25"))(state.swarm)
    np.testing.assert_array_equal(once.is_alive, again.is_alive)
    assert once.is_alive.sum() == 15
    assert edit_of_swarm(run, Change.parse("4:fail=0.2"))(once).is_alive.sum() == 12
    with pytest.raises(UserError, match="fail must be between 0 and 1"):
        edit_of_swarm(run, Change.parse("4:fail=1.5"))


def test_a_robot_is_moved_and_the_others_stay_where_they_are():
    session = begun(n=2)
    before = session.run.poses()[0]
    session.change("move", "3,9.0,-9.0")
    after = session.run.poses()[0]
    np.testing.assert_allclose(after[3, :2], [9.0 * RD * 1e-3, -9.0 * RD * 1e-3], rtol=1e-5)
    assert after[3, 2] == before[3, 2]
    others = np.arange(20) != 3
    np.testing.assert_array_equal(after[others], before[others])
    np.testing.assert_allclose(session.snapshots[-1].frames.pose[0], after, rtol=1e-6)
    session.advance()
    moved = session.snapshots[-1].frames.pose[0, 3, :2] - after[3, :2]
    assert np.linalg.norm(moved) < 0.51 * RD * 1e-3  # a step of half a robot


@pytest.mark.parametrize(
    ("place", "sentence"),
    [
        ("99,0", "such that robots stand within the walls"),
        ("nan,0", "such that robots stand within the walls"),
        ("OTHER", "such that no robots overlap"),
    ],
)
def test_a_robot_is_not_moved_where_it_cannot_stand(session, place, sentence):
    if place == "OTHER":
        x, y = session.run.poses()[0, 5, :2] / (RD * 1e-3)
        place = f"{x:.3f},{y:.3f}"
    before = state(session.run)
    with pytest.raises(UserError, match=sentence):
        session.change("move", f"3,{place}")
    assert_same(state(session.run), before)


@pytest.mark.parametrize("kind", ["obstacles", "boxes"])
def test_a_robot_is_not_moved_into_an_obstacle_or_a_box(kind):
    box = (6.0, 0.0, 1.0, 1.0, 0.0)
    if kind == "boxes":
        box = (*box, 1e-5, 0.1)
    config = replace(CONFIG, arena=replace(CONFIG.arena, **{kind: (box,)}))
    session = Session(replace(PAGE_SCENARIO, config=config, robots=4))
    with pytest.raises(
        UserError, match=r"outside obstacles|no robot stands in an obstacle or a box"
    ):
        session.change("move", "3,6.9,0")
    session.change("move", "3,7.6,0")

    scheduled = [Change.parse("9:move=3,6.9,0")]
    if kind == "boxes":  # which robots may have pushed away by then
        Session(replace(PAGE_SCENARIO, config=config, robots=4), scheduled)
    else:
        with pytest.raises(UserError, match="within the walls and outside obstacles"):
            Session(replace(PAGE_SCENARIO, config=config, robots=4), scheduled)
