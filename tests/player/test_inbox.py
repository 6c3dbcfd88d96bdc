"""An inbox keeps the order of the calls that wait, and bounds their number."""

import pytest

from iswarm_mj.player.inbox import MOST_CLICKS, Inbox
from iswarm_mj.utils.errors import UserError


@pytest.fixture
def inbox():
    """An empty inbox."""
    return Inbox()


@pytest.fixture
def calls():
    """Names of the calls that were made, in their order."""
    return []


def post_click(inbox, calls, name):
    """Post a click that appends its name to the calls."""
    inbox.put_click(lambda: calls.append(name))


def post_value(inbox, calls, control, value):
    """Post a value of a control that appends both to the calls."""
    inbox.put_value(control, lambda: calls.append(f"{control}={value}"))


def work(inbox):
    """Make all calls that wait."""
    while (call := inbox.take()) is not None:
        call()


def test_calls_are_made_in_the_order_in_which_they_came(inbox, calls):
    post_value(inbox, calls, "speed", 1)
    post_click(inbox, calls, "step")
    post_value(inbox, calls, "seed", 2)
    post_click(inbox, calls, "reset")
    work(inbox)
    assert calls == ["speed=1", "step", "seed=2", "reset"]
    assert not inbox


def test_a_newer_value_of_a_control_replaces_the_one_that_waits(inbox, calls):
    for value in range(1000):
        post_value(inbox, calls, "speed", value)
        post_value(inbox, calls, "seed", value)
    assert len(inbox) == 2
    work(inbox)
    assert calls == ["speed=999", "seed=999"]


def test_a_value_before_a_click_is_not_replaced_by_one_after_it(inbox, calls):
    """Reset begins with the values that were set before it."""
    post_value(inbox, calls, "robots", 10)
    post_click(inbox, calls, "reset")
    post_value(inbox, calls, "robots", 20)
    work(inbox)
    assert calls == ["robots=10", "reset", "robots=20"]


def test_further_clicks_are_refused_until_some_are_done(inbox, calls):
    for number in range(MOST_CLICKS):
        post_click(inbox, calls, number)
    with pytest.raises(UserError, match="30 clicks wait already"):
        post_click(inbox, calls, "too many")
    post_value(inbox, calls, "speed", 5)  # values still pass

    inbox.take()()
    post_click(inbox, calls, "another")
    work(inbox)
    assert calls == [*range(MOST_CLICKS), "speed=5", "another"]
