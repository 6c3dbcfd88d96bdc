"""What is said of faults of batched runs."""

import numpy as np
from iswarm_mj.simulation.step_mjx import NOT_FINITE, OUTSIDE, Fault

from iswarm_mj.engines.mjx.arena import Capacities
from iswarm_mj.engines.mjx.motion import TOO_MANY_CONTACTS, TOO_MANY_PAIRS
from iswarm_mj.simulation.faults import describe

ROOM = Capacities(pairs=20, contacts=80)


def said(bits, step=3, robot=7):
    bits = np.array(bits)
    return describe(Fault(bits, np.full_like(bits, step), np.full_like(bits, robot)), ROOM)


def test_no_fault():
    assert said([0, 0]) == ""


def test_who_when_where_and_what():
    assert said([0, OUTSIDE]) == "step 3, world 1: robot 7 left the arena"
    assert said([NOT_FINITE | OUTSIDE]) == "step 3, world 0: robot 7 has no finite pose and robot 7 left the arena"


def test_the_remedy_is_told_once():
    text = said([TOO_MANY_PAIRS | TOO_MANY_CONTACTS, TOO_MANY_PAIRS])
    assert text == (
        "step 3, world 0: more than 20 pairs of robots near enough to touch and more than 80 contact points; "
        "step 3, world 1: more than 20 pairs of robots near enough to touch; "
        "there is no room for so many: give more --contact-room"
    )


def test_of_many_worlds_the_first_five_are_named():
    text = said([OUTSIDE] * 12)
    assert text.count("left the arena") == 5 and text.endswith("world 4: robot 7 left the arena; and 7 more worlds")
