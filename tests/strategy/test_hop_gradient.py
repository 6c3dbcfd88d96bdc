"""Robots that follow hop counts."""

import jax
import numpy as np
import pytest
from helpers_sensing import senses_nothing
from hop_gradient import FAR, HopGradient

POLICY = HopGradient(wander=20.0, distance=4.0, step=1.25, reach=0.75)
act_here = jax.jit(POLICY.act)


def sees(n=1, dust=FAR, dump=FAR, **changed):
    counts = {name: np.broadcast_to(hops, (n, 4)) for name, hops in (("dust", dust), ("dump", dump))}
    return senses_nothing(n)._replace(payload=counts, **changed)


def does(seen, dust=FAR, dump=FAR):
    n = len(seen.at_dust)
    return act_here({"dust": np.full(n, dust), "dump": np.full(n, dump)}, seen, jax.random.key(0))


@pytest.mark.parametrize(("heard", "own", "expected"), [(5, FAR, 6), (5, 2, 3), (30, FAR, FAR), (FAR, FAR, FAR)])
@pytest.mark.parametrize("place", ["dust", "dump"])
def test_counts(heard, own, expected, place):
    """What comes to a side that hears nothing does not count."""
    is_heard = np.array([[True, False, True, True]])
    hops, _ = does(sees(is_heard=is_heard, **{place: [[heard, 0, FAR, 30]]}), **{place: own})
    other = {"dust": "dump", "dump": "dust"}[place]
    assert hops[place].tolist() == [expected] and hops[other].tolist() == [FAR]


def test_zero_at_the_place():
    """Only empty robots that have not failed find dust; the dump is where it is for all."""
    yes, seen = np.ones(4, bool), {"is_loaded": np.arange(4) == 1, "grasp_failed": np.arange(4) == 2}
    hops, _ = does(sees(4, at_dust=yes, on_dump=np.arange(4) == 3, **seen), dust=7, dump=7)
    assert hops["dust"].tolist() == [0, 8, 8, 0] and hops["dump"].tolist() == [8, 8, 8, 0]


def test_they_turn_to_the_least_of_what_they_need():
    """Of four, two are loaded; a wall ahead counts more."""
    seen = sees(
        4,
        is_heard=np.ones((4, 4), bool),
        bearing=np.tile([0.1, 0.7, 3.0, -1.2], (4, 1)),
        is_loaded=np.array([False, True, False, True]),
        sees_wall=np.arange(4)[:, None] + np.zeros((4, 4)) >= 2,
        dust=[[5, 2, 9, 4]] * 4,
        dump=[[5, 8, 9, 4]] * 4,
    )
    _, command = does(seen)
    np.testing.assert_allclose(command.turn[:2], [0.7, -1.2], rtol=1e-6)
    np.testing.assert_allclose(np.abs(command.turn[2:]), np.pi / 2, rtol=1e-6)
    np.testing.assert_allclose(command.forward, 1.25)


def test_they_go_to_a_ball():
    """The tip reaches it; where it is behind, they turn first; loaded ones leave it."""
    ball, loaded = np.array([[1.0, -1.0], [-3.0, 0.5], [1.0, -1.0], [0.0, 2.0]]), np.arange(4) == 2
    _, command = does(sees(4, at_dust=np.ones(4, bool), ball_vector=ball, is_loaded=loaded))
    np.testing.assert_allclose(command.turn[np.array([0, 1, 3])], [-np.pi / 4, np.pi / 2, np.pi / 2], rtol=1e-6)
    np.testing.assert_allclose(command.forward, [np.sqrt(2) - 0.75, 0, 1.25, 2 - 0.75], rtol=1e-6)
    assert abs(float(command.turn[2])) <= np.radians(20)
