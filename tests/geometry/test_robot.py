"""Swarms of several kinds of robots: the kind of each robot, and how many may touch one."""

from dataclasses import replace

import pytest

from iswarm_mj.engines.arena import read_robot
from iswarm_mj.geometry.robot import Mixed

SQUARE = read_robot()
LONG = replace(SQUARE, half_edges=(3.0, 1.0, 0.5), mass=30.0)
SMALL = replace(SQUARE, half_edges=(0.5, 0.8, 0.5))


@pytest.mark.parametrize(
    ("kinds", "partners"), [((SQUARE, LONG), 18), ((LONG, SQUARE), 18), ((LONG, SMALL), 30)]
)
def test_the_largest_kind_has_the_most_partners_of_the_narrowest(kinds, partners):
    """They are half as many again as 2 (1 + 3) + 4 of inradius 1, or 2 (1 + 3) / 0.5 + 4 of 0.5."""
    assert Mixed(kinds, (0, 5)).most_partners == partners


def test_parts_of_a_swarm_have_their_own_numbers():
    swarm = Mixed((SQUARE, LONG, SMALL), (0, 8, 12))
    part = swarm.part(5, 10)
    assert part.kinds == swarm.kinds
    assert part.firsts == (0, 3, 7)
    kinds_of_part = [0] * 3 + [1] * 4 + [2] * 3
    assert part.kind_of(10).tolist() == swarm.kind_of(15)[5:].tolist() == kinds_of_part
    assert swarm.part(9, 3) is LONG
    assert swarm.part(10, 3).firsts == (0, 2)
    assert swarm.each("mass", 9).tolist() == [SQUARE.mass] * 8 + [30.0]
