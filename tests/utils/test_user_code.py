"""Errors of users' code in one sentence."""

from typing import NamedTuple

import pytest

from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.user_code import user_code


class Seen(NamedTuple):
    """What a robot sees."""

    sees_wall: bool = True


def sentence_of(act):
    """Return the sentence on what a function of a user raises."""
    with pytest.raises(UserError) as raised, user_code("Walk.act"):
        act()
    return str(raised.value)


def test_a_misspelt_attribute_is_named_with_the_one_that_is_meant():
    sentence = sentence_of(lambda: Seen().see_wall)
    assert "has no attribute 'see_wall' (perhaps you meant sees_wall) (" in sentence
    assert "`sentence = sentence_of(lambda: Seen().see_wall)`); correct it there" in sentence


@pytest.mark.parametrize("name", ["far", "sees_nothing_at_all"])
def test_other_attributes_are_named_without_a_guess(name):
    sentence = sentence_of(lambda: getattr(Seen(), name))
    assert "perhaps" not in sentence


def test_an_attribute_error_of_a_user_stays_as_it_is():
    def act():
        raise AttributeError("no light")

    assert "raised AttributeError: no light (" in sentence_of(act)
