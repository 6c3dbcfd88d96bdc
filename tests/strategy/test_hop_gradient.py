"""Robots that follow hop counts."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_sensing import senses_nothing
from hop_gradient import FAR, HopGradient

POLICY = HopGradient(wander=20.0, distance=4.0, step=1.25, reach=0.75)


def sees(n=1, dust=FAR, dump=FAR, **changed):
    counts = {name: jnp.broadcast_to(jnp.asarray(hops), (n, 4)) for name, hops in (("dust", dust), ("dump", dump))}
    return senses_nothing(n)._replace(payload=counts, **changed)


def does(seen, dust=FAR, dump=FAR, key=0):
    n = len(seen.at_dust)
    memory = {name: jnp.broadcast_to(jnp.asarray(hops), (n,)) for name, hops in (("dust", dust), ("dump", dump))}
    return POLICY.act(memory, seen, jax.random.key(key))


def test_begin_and_message():
    memory = POLICY.init(3, jax.random.key(0))
    assert {name: hops.tolist() for name, hops in memory.items()} == {"dust": 3 * [FAR], "dump": 3 * [FAR]}
    assert POLICY.say(memory, jnp.ones(3, bool)) is memory and POLICY.picks(memory).tolist() == 3 * [True]
    assert {name: 2**field.bits - 1 for name, field in POLICY.payload.items()} == {"dust": FAR, "dump": FAR}


@pytest.mark.parametrize(
    ("heard", "own", "expected"),
    [
        ([5, 3, FAR, 9], FAR, 6),  # the 3 came to a side that hears nothing
        ([5, 3, FAR, 9], 2, 3),
        ([FAR, 0, FAR, FAR], FAR, FAR),
        ([FAR, 0, 30, FAR], FAR, FAR),
    ],
)
@pytest.mark.parametrize("place", ["dust", "dump"])
def test_counts(heard, own, expected, place):
    is_heard = jnp.array([[True, False, True, True]])
    hops, _ = does(sees(is_heard=is_heard, **{place: [heard]}), **{place: own})
    other = {"dust": "dump", "dump": "dust"}[place]
    assert hops[place].tolist() == [expected] and hops[other].tolist() == [FAR]


def test_zero_at_the_place():
    """Only empty robots that have not failed find dust; the dump is where it is for all."""
    yes, seen = jnp.ones(4, bool), {"is_loaded": jnp.arange(4) == 1, "grasp_failed": jnp.arange(4) == 2}
    hops, _ = does(sees(4, at_dust=yes, on_dump=jnp.arange(4) == 3, **seen), dust=7, dump=7)
    assert hops["dust"].tolist() == [0, 8, 8, 0] and hops["dump"].tolist() == [8, 8, 8, 0]


def test_they_turn_to_the_least_of_what_they_need():
    """The first is empty, the second loaded; turns end at 90 degrees."""
    bearing = jnp.tile(jnp.array([0.1, 0.7, 3.0, -1.2]), (2, 1))
    seen = sees(
        2,
        is_heard=jnp.ones((2, 4), bool),
        bearing=bearing,
        is_loaded=jnp.array([False, True]),
        dust=[[5, 2, 9, 4]] * 2,
        dump=[[5, 8, 9, 4]] * 2,
    )
    _, command = does(seen)
    np.testing.assert_allclose(command.turn, [0.7, -1.2], rtol=1e-6)
    np.testing.assert_allclose(command.forward, 1.25)
    _, back = does(seen._replace(payload={"dust": seen.payload["dust"].at[:, 2].set(0), "dump": seen.payload["dump"]}))
    np.testing.assert_allclose(back.turn, [np.pi / 2, -1.2], rtol=1e-6)


def test_they_walk_at_random_where_they_hear_of_nothing():
    _, command = does(sees(2000))
    turn = np.degrees(np.asarray(command.turn))
    assert -20 <= turn.min() < -19 and 19 < turn.max() <= 20 and abs(turn.mean()) < 1.5


def test_they_turn_away_from_what_is_ahead():
    """Nearer than 4 mm, or a wall, at the front alone; what is needed counts less; to both sides."""
    n = 64
    front, left = (jnp.zeros((n, 4), bool).at[:, side].set(True) for side in (0, 1))
    knows = {"dust": [[FAR, 2, FAR, FAR]] * n, "bearing": jnp.tile(jnp.array([0.0, 0.6, 3.0, -1.2]), (n, 1))}
    distance = jnp.full((n, 4), 6.0)
    near = {side: distance.at[:, side].set(3.9) for side in (0, 1)}
    blocked = [
        {"sees_wall": front, "is_heard": left},
        {"is_heard": front | left, "distance": near[0]},
    ]
    for seen in blocked:
        _, command = does(sees(n, **(knows | {"distance": distance} | seen)))
        turn = np.asarray(command.turn)
        np.testing.assert_allclose(np.abs(turn), np.pi / 2, rtol=1e-6)
        assert 10 < (turn > 0).sum() < 54
    free = [
        {"sees_wall": left, "is_heard": left},
        {"is_heard": front | left, "distance": near[1]},
        {"is_heard": left, "distance": near[0]},
    ]
    for seen in free:
        _, command = does(sees(n, **(knows | {"distance": distance} | seen)))
        np.testing.assert_allclose(command.turn, 0.6, rtol=1e-6)


def test_they_go_to_a_ball():
    """The tip reaches it; where it is behind, they turn first; before a wall, too; loaded ones leave it."""
    ball = jnp.array([[1.0, -1.0], [-3.0, 0.5], [1.0, -1.0], [0.0, 2.0]])
    wall = jnp.zeros((4, 4), bool).at[3, 0].set(True)
    loaded = jnp.arange(4) == 2
    _, command = does(sees(4, at_dust=jnp.ones(4, bool), ball_vector=ball, is_loaded=loaded, sees_wall=wall))
    np.testing.assert_allclose(command.turn[jnp.array([0, 1, 3])], [-np.pi / 4, np.pi / 2, np.pi / 2], rtol=1e-6)
    np.testing.assert_allclose(command.forward, [np.sqrt(2) - 0.75, 0, 1.25, 2 - 0.75], rtol=1e-6)
    assert abs(float(command.turn[2])) <= np.radians(20)
