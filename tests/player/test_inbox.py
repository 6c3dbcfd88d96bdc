"""What waits for the thread of a session is bounded, and keeps its order."""

import pytest

from iswarm_mj.player.inbox import MOST_CLICKS, Inbox
from iswarm_mj.utils.errors import UserError


@pytest.fixture
def inbox():
    return Inbox()


@pytest.fixture
def done():
    """Names of the calls that were made, in their order."""
    return []


def post_click(inbox, done, name):
    inbox.put_click(lambda: done.append(name))


def post_value(inbox, done, control, value):
    inbox.put_value(control, lambda: done.append(f"{control}={value}"))


def work(inbox):
    """Make all calls that wait."""
    while (call := inbox.take()) is not None:
        call()


def test_calls_are_made_in_the_order_in_which_they_came(inbox, done):
    post_value(inbox, done, "speed", 1)
    post_click(inbox, done, "step")
    post_value(inbox, done, "seed", 2)
    post_click(inbox, done, "reset")
    work(inbox)
    assert done == ["speed=1", "step", "seed=2", "reset"]
    assert not inbox


def test_a_newer_value_of_a_control_replaces_the_one_that_waits(inbox, done):
    for value in range(1000):
        post_value(inbox, done, "speed", value)
        post_value(inbox, done, "seed", value)
    assert len(inbox) == 2
    work(inbox)
    assert done == ["speed=999", "seed=999"]


def test_a_value_before_a_click_is_not_replaced_by_one_after_it(inbox, done):
    """Reset begins with the values that were set before it."""
    post_value(inbox, done, "robots", 10)
    post_click(inbox, done, "reset")
    post_value(inbox, done, "robots", 20)
    work(inbox)
    assert done == ["robots=10", "reset", "robots=20"]


def test_further_clicks_are_refused_until_some_are_done(inbox, done):
    for number in range(MOST_CLICKS):
        post_click(inbox, done, number)
    with pytest.raises(UserError, match="30 clicks wait already"):
        post_click(inbox, done, "too many")
    post_value(inbox, done, "speed", 5)  # values still pass

    inbox.take()()
    post_click(inbox, done, "another")
    work(inbox)
    assert done == [*range(MOST_CLICKS), "speed=5", "another"]
