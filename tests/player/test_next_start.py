"""What waits for a reset while a task, a strategy or an engine does not fit yet."""

import pytest
from support.page import SCENARIO
from support.sessions import PAGE_SCENARIO, begun

from iswarm_mj.player.next_start import NextStart
from iswarm_mj.player.session import Session
from iswarm_mj.utils.errors import UserError


@pytest.fixture
def session():
    """A session after a step, for which a strategy waits that does not fit the task."""
    session = begun()
    session.want("strategy", "beeclust")
    return session


def test_a_setting_that_both_have_is_applied_by_the_next_reset(session):
    session.want("seed", 9)
    assert session.pending == {"seed": "3 → 9"}
    session.reset()
    assert session.now.seed == session.wanted.seed == 9
    assert session.now.get("strategy") == "type1"
    assert session.wanted.get("strategy") == "beeclust"
    assert session.misfit.name == "strategy"


def test_a_value_with_which_no_run_can_begin_is_refused(session):
    before = session.next_start
    with pytest.raises(UserError, match="n_robots must be"):
        session.want("robots", 5000)
    assert session.next_start is before
    assert "Beeclust follows the light" in session.misfit.sentence
    session.want("strategy", "type1")
    assert not session.misfit
    assert not session.pending


def test_rules_of_what_runs_can_be_changed_before_the_first_step():
    session = Session(PAGE_SCENARIO)
    session.want("strategy", "beeclust")
    session.set("p_vector_forget", 0.75)
    session.work()
    assert session.now.genome.p_vector_forget == 0.75
    assert session.misfit


def test_settings_of_the_strategy_that_waits_are_kept(session):
    session.want("longest_wait", 33.0)
    session.reset()
    assert session.wanted.get("longest_wait") == 33.0
    with pytest.raises(UserError, match="have no setting nothing"):
        session.want("nothing", 1)


def test_settings_that_fit_are_those_that_are_wanted():
    next_start = NextStart.of(PAGE_SCENARIO).with_setting("seed", SCENARIO.seed + 1)
    assert next_start.wanted is next_start.fitting
