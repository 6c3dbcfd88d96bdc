"""Messages that take time: who is lit and who listens when, and what two senders in one slot do. Worked by hand."""

import itertools
from functools import partial

import jax
import numpy as np
import pytest
from support.sensing import place, squares_in_the_way

from iswarm_mj.config.swarm import OpticsConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.geometry.robot import PAPER_SIDES, Sides
from iswarm_mj.sensors.links import Links, find_links
from iswarm_mj.sensors.message_time import draw_first_slots, listens, sides_on, understood

SLOTS = 8
FRONT, LEFT, BACK, RIGHT = range(4)


understood_here = jax.jit(understood, static_argnums=0)


@partial(jax.jit, static_argnums=0)
def of_many(optics, in_sight, first_slots):
    return jax.vmap(partial(understood, optics, in_sight))(first_slots)


def timed(**own):
    return OpticsConfig(**{"baud_rate": 1000.0, "slots": SLOTS, **own})


def heard(optics, poses, first_slots, sends=None):
    """Senders (T, N, 4) that robots at (N, 3) understand with each of T sets of first slots (T, N), -1 for none."""
    in_sight = find_links(poses[None], read_robot(), optics, squares_in_the_way(poses[None]), sends)
    links = of_many(optics, jax.tree.map(lambda a: a[0], in_sight), np.array(first_slots))
    assert [np.asarray(values)[~np.asarray(links.valid)].any() for values in links] == [False] * 5
    return np.where(links.valid, links.sender, -1)


SIX = Sides(*[tuple((np.cos(angle), np.sin(angle)) for angle in np.arange(6) * np.pi / 3)] * 2)


@pytest.mark.parametrize(
    ("own", "table"),
    [
        ({}, ["", "F", "F", "F", "FLBR", "FLBR", "FLBR", "FLBR"]),
        ({"photodiodes_while_emitting": "none"}, ["", "", "", "", "FLBR", "FLBR", "FLBR", "FLBR"]),
        ({"photodiodes_while_emitting": "all"}, ["LBR", "FBR", "FLR", "FLB", "FLBR", "FLBR", "FLBR", "FLBR"]),
        ({"serial_photodiodes": True}, ["", "F", "F", "F", "F", "L", "B", "R"]),
        ({}, ["", "0", "0", "0", "0", "0", "012345", "012345"]),
        ({"serial_photodiodes": True}, ["", "0", "0", "0", "0", "0", "0", "1"]),
    ],
)
def test_sides_that_listen_in_each_slot(own, table):
    """Of the paper's robots, or of some with six sides."""
    names, sides = ("FLBR", PAPER_SIDES) if "F" in "".join(table) else ("012345", SIX)
    since = np.tile(np.arange(SLOTS)[:, None], (1, len(sides)))
    on = np.asarray(listens(timed(**own), since, sides))
    assert ["".join(name for name, is_on in zip(names, row, strict=True) if is_on) for row in on] == table


def test_walls_are_seen_by_photodiodes_that_are_on_while_the_robot_emits():
    rows = [sides_on(timed(photodiodes_while_emitting=which)).tolist() for which in ("front", "none", "all")]
    assert rows == [[True, False, False, False], [False] * 4, [True] * 4]


@pytest.mark.parametrize("side", [FRONT, LEFT, BACK, RIGHT])
@pytest.mark.parametrize("theirs", [FRONT, LEFT, BACK, RIGHT])
def test_two_robots_alone_exchange_everything_unless_they_emit_at_once(side, theirs):
    """A front hears but for the slot of its own LED, other sides while their robot is silent."""
    poses = place((0, 0, -90 * side), (6, 0, 180 - 90 * theirs))
    firsts = list(itertools.product(range(SLOTS), repeat=2))
    for first, senders in zip(firsts, heard(timed(), poses, firsts), strict=True):
        for receiver, sender, at, led in ((0, 1, side, theirs), (1, 0, theirs, side)):
            since = (first[sender] + led - first[receiver]) % SLOTS
            hears = since != FRONT if at == FRONT else since >= 4
            assert senders[receiver, at] == (sender if hears else -1)
            assert (np.delete(senders[receiver], at) == -1).all()
        if (first[0] - first[1]) % SLOTS == 4:  # one after the other
            assert senders[0, side] == 1 and senders[1, theirs] == 0


def test_a_sender_in_the_same_slot_jams():
    """Three senders before one front, whose light comes from their own fronts, nearest first."""
    poses = place((0, 0, 0), (4, 2.6, 213), (6, -2.6, 157), (8, 0, 180))

    def front(*first_slots):
        return heard(timed(), poses, [(4, *slots) for slots in first_slots])[:, 0, FRONT].tolist()

    assert front((0, 1, 2), (2, 1, 0), (0, 0, 2), (0, 2, 0), (2, 0, 0)) == [1, 1, 3, 2, 1]
    assert front((0, 0, 0), (4, 4, 4), (4, 0, 0)) == [-1, -1, -1]
    assert front((4, 0, 1), (4, 0, 4)) == [2, 2]  # the own LED blinds the side to the nearest


def test_slots_of_later_leds_go_round_the_window():
    """Robot 1 lights its back LED in slot 7 + 2 - 8, robot 2 its left LED in slot 0 + 1; both shine on robot 0."""

    def front(first_slots, leds):
        shape = (3, 4, 2)
        sender, led, distance = np.zeros((3, *shape), np.int32)
        sender[0, FRONT], led[0, FRONT], distance[0, FRONT] = [1, 2], leds, [5, 6]
        links = understood_here(
            timed(), Links(sender, sender > 0, led, *np.float32([distance] * 2)), np.array(first_slots)
        )
        return int(links.sender[0, FRONT]) if links.valid[0, FRONT] else -1

    assert front((4, 7, 0), (BACK, LEFT)) == -1
    assert front((4, 7, 0), (BACK, FRONT)) == 1
    assert front((4, 6, 7), (RIGHT, BACK)) == -1


def test_silent_robots_jam_nobody():
    """Engines leave out the light of robots that send none."""
    poses, sends = place((0, 0, 0), (4, 2.6, 213), (6, -2.6, 157)), np.array([[True, False, True]])
    assert heard(timed(), poses, [(4, 0, 0)], sends)[0, 0, FRONT] == 2
    assert heard(timed(), poses, [(4, 0, 0)])[0, 0, FRONT] == -1


def test_the_nearest_is_captured_if_the_other_is_far_enough():
    poses = place((0, 0, 0), (4, 2, 206.6), (7.5, -2, 165))
    ratio = np.hypot(7.5, 2) / np.hypot(4, 2)
    caught = [
        heard(timed(capture_ratio=r), poses, [(4, 0, 0)])[0, 0, FRONT] for r in (0.0, 1.0, ratio - 0.01, ratio + 0.01)
    ]
    assert caught == [-1, 1, 1, -1]


def test_first_slots_are_drawn_evenly():
    counts = np.bincount(draw_first_slots(timed(slots=13), jax.random.key(3), 60_000))
    assert len(counts) == 13 and (abs(counts - 60_000 / 13) < 4.5 * np.sqrt(60_000 / 13)).all()
