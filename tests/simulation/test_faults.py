"""From the bits of a state to faults with world, step, robot and kind, and a sentence about them."""

import numpy as np
import pytest

from iswarm_mj.simulation.standing import MAX_LISTED, decode, summary
from iswarm_mj.simulation.state import Fault
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.errors import FaultKind


def faults_of(bits, step=3, robot=7, first=0):
    bits = np.array(bits)
    worlds = [World(Genome(), 9, index=first + k) for k in range(len(bits))]
    each = decode(Fault(bits, np.full_like(bits, step), np.full_like(bits, robot)), worlds)
    assert [fault is not None for fault in each] == [bool(b) for b in bits]
    return [fault for fault in each if fault is not None]


def test_no_fault():
    assert faults_of([0, 0]) == [] and summary([]) == ""


def test_who_when_where_and_what():
    (fault,) = faults_of([0, FaultKind.OUTSIDE])
    assert (fault.step, fault.world, fault.robots, fault.kind) == (3, 1, (7,), FaultKind.OUTSIDE)
    assert str(fault).startswith("step 3, world 1: robot 7 left the arena; ")


def test_worlds_have_their_own_numbers():
    """A process of several has a share of the worlds."""
    assert [fault.world for fault in faults_of([FaultKind.OUTSIDE, 0, FaultKind.OUTSIDE], first=10)] == [10, 12]


@pytest.mark.parametrize("kind", FaultKind)
def test_only_faults_of_robots_name_one(kind):
    (fault,) = faults_of([kind])
    of_robots = {FaultKind.POSE_NOT_FINITE, FaultKind.OUTSIDE, FaultKind.COMMAND_NOT_FINITE}
    assert fault.robots == ((7,) if kind in of_robots else ())
    assert ("robot 7" in str(fault)) == (kind in of_robots)


def test_of_many_worlds_the_first_five_are_listed():
    text = summary(faults_of([FaultKind.OUTSIDE] * 12))
    assert text.count("left the arena") == MAX_LISTED == 5
    assert "world 4: robot 7 left the arena" in text and text.endswith("; and 7 more worlds")
