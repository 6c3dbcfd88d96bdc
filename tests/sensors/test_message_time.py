"""Messages that take time, worked by hand: who is lit, who listens, and what two senders do."""

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
from iswarm_mj.sensors.message_time import (
    draw_first_slots,
    listens,
    sides_on,
    understood_links,
)

SLOTS = 8
FRONT, LEFT, BACK, RIGHT = range(4)
NOBODY = -1

ANGLES_OF_SIX = np.arange(6) * np.pi / 3
AXES_OF_SIX = tuple((np.cos(angle), np.sin(angle)) for angle in ANGLES_OF_SIX)
SIX_SIDES = Sides(leds=AXES_OF_SIX, photodiodes=AXES_OF_SIX)

understood_here = jax.jit(understood_links, static_argnums=0)


@partial(jax.jit, static_argnums=0)
def understood_of_many(optics, links, first_slots):
    """Return links that robots understand with each of several sets of first slots."""
    return jax.vmap(partial(understood_links, optics, links))(first_slots)


def timed(**settings):
    """Return optics whose messages take time."""
    return OpticsConfig(**{"baud_rate": 1000.0, "slots": SLOTS, **settings})


def senders_understood(optics, poses, first_slots, sends=None):
    """Return senders (T, N, 4) that robots understand, `NOBODY` for none.

    Args:
        optics: slots and photodiodes.
        poses: (N, 3) of the robots.
        first_slots: (T, N) sets of slots in which robots light their front LED.
        sends: (1, N) which robots send light, by default all.
    """
    blocked = squares_in_the_way(poses[None])
    links_in_sight = find_links(poses[None], read_robot(), optics, blocked, sends)
    links_of_world = jax.tree.map(lambda values: values[0], links_in_sight)
    links = understood_of_many(optics, links_of_world, np.array(first_slots))

    is_silent = ~np.asarray(links.valid)
    for values in links:
        assert not np.asarray(values)[is_silent].any()
    return np.where(links.valid, links.sender, NOBODY)


@pytest.mark.parametrize(
    ("sides", "names", "settings", "expected"),
    [
        (
            PAPER_SIDES,
            "FLBR",
            {},
            ["", "F", "F", "F", "FLBR", "FLBR", "FLBR", "FLBR"],
        ),
        (
            PAPER_SIDES,
            "FLBR",
            {"photodiodes_while_emitting": "none"},
            ["", "", "", "", "FLBR", "FLBR", "FLBR", "FLBR"],
        ),
        (
            PAPER_SIDES,
            "FLBR",
            {"photodiodes_while_emitting": "all"},
            ["LBR", "FBR", "FLR", "FLB", "FLBR", "FLBR", "FLBR", "FLBR"],
        ),
        (
            PAPER_SIDES,
            "FLBR",
            {"serial_photodiodes": True},
            ["", "F", "F", "F", "F", "L", "B", "R"],
        ),
        (
            SIX_SIDES,
            "012345",
            {},
            ["", "0", "0", "0", "0", "0", "012345", "012345"],
        ),
        (
            SIX_SIDES,
            "012345",
            {"serial_photodiodes": True},
            ["", "0", "0", "0", "0", "0", "0", "1"],
        ),
    ],
)
def test_sides_that_listen_in_each_slot(sides, names, settings, expected):
    since = np.tile(np.arange(SLOTS)[:, None], (1, len(sides)))
    is_listening = np.asarray(listens(timed(**settings), since, sides))
    listening = ["".join(itertools.compress(names, row)) for row in is_listening]
    assert listening == expected


@pytest.mark.parametrize(
    ("photodiodes", "expected"),
    [("front", [True, False, False, False]), ("none", [False] * 4), ("all", [True] * 4)],
)
def test_walls_are_seen_by_photodiodes_that_are_on_while_the_robot_emits(photodiodes, expected):
    optics = timed(photodiodes_while_emitting=photodiodes)
    assert sides_on(optics).tolist() == expected


@pytest.mark.parametrize("side", [FRONT, LEFT, BACK, RIGHT])
@pytest.mark.parametrize("other_side", [FRONT, LEFT, BACK, RIGHT])
def test_two_robots_alone_exchange_everything_unless_they_emit_at_once(side, other_side):
    """A front hears but for the slot of its own LED, other sides while their robot is silent."""
    poses = place((0, 0, -90 * side), (6, 0, 180 - 90 * other_side))
    first_slots = list(itertools.product(range(SLOTS), repeat=2))
    understood = senders_understood(timed(), poses, first_slots)
    for first, senders in zip(first_slots, understood, strict=True):
        for receiver, sender, photodiode, led in (
            (0, 1, side, other_side),
            (1, 0, other_side, side),
        ):
            since = (first[sender] + led - first[receiver]) % SLOTS
            hears = since != FRONT if photodiode == FRONT else since >= 4
            assert senders[receiver, photodiode] == (sender if hears else NOBODY)
            assert (np.delete(senders[receiver], photodiode) == NOBODY).all()

        one_after_the_other = (first[0] - first[1]) % SLOTS == 4
        if one_after_the_other:
            assert senders[0, side] == 1
            assert senders[1, other_side] == 0


def test_a_sender_in_the_same_slot_jams():
    """Three senders before one front, whose light comes from their own fronts, nearest first."""
    poses = place((0, 0, 0), (4, 2.6, 213), (6, -2.6, 157), (8, 0, 180))

    def heard_by_front(*slots_of_senders):
        first_slots = [(4, *slots) for slots in slots_of_senders]
        return senders_understood(timed(), poses, first_slots)[:, 0, FRONT].tolist()

    two_alike = heard_by_front((0, 1, 2), (2, 1, 0), (0, 0, 2), (0, 2, 0), (2, 0, 0))
    assert two_alike == [1, 1, 3, 2, 1]
    all_alike = heard_by_front((0, 0, 0), (4, 4, 4), (4, 0, 0))
    assert all_alike == [NOBODY, NOBODY, NOBODY]
    # The own LED blinds the side to the nearest.
    assert heard_by_front((4, 0, 1), (4, 0, 4)) == [2, 2]


def test_slots_of_later_leds_go_round_the_window():
    """Robot 1 lights its back LED in slot 7 + 2 - 8, robot 2 its left LED in slot 0 + 1.

    Both shine on robot 0.
    """

    def heard_by_front(first_slots, leds):
        shape = (3, 4, 2)
        sender = np.zeros(shape, np.int32)
        led = np.zeros(shape, np.int32)
        distance = np.zeros(shape, np.float32)
        sender[0, FRONT] = [1, 2]
        led[0, FRONT] = leds
        distance[0, FRONT] = [5, 6]
        links = Links(sender, sender > 0, led, distance, distance)
        understood = understood_here(timed(), links, np.array(first_slots))
        return int(understood.sender[0, FRONT]) if understood.valid[0, FRONT] else NOBODY

    assert heard_by_front((4, 7, 0), (BACK, LEFT)) == NOBODY
    assert heard_by_front((4, 7, 0), (BACK, FRONT)) == 1
    assert heard_by_front((4, 6, 7), (RIGHT, BACK)) == NOBODY


def test_silent_robots_jam_nobody():
    """Engines leave out the light of robots that send none."""
    poses = place((0, 0, 0), (4, 2.6, 213), (6, -2.6, 157))
    sends = np.array([[True, False, True]])
    assert senders_understood(timed(), poses, [(4, 0, 0)], sends)[0, 0, FRONT] == 2
    assert senders_understood(timed(), poses, [(4, 0, 0)])[0, 0, FRONT] == NOBODY


def test_the_nearest_is_captured_if_the_other_is_far_enough():
    poses = place((0, 0, 0), (4, 2, 206.6), (7.5, -2, 165))
    ratio = np.hypot(7.5, 2) / np.hypot(4, 2)

    def heard_by_front(capture_ratio):
        optics = timed(capture_ratio=capture_ratio)
        return senders_understood(optics, poses, [(4, 0, 0)])[0, 0, FRONT]

    assert heard_by_front(0.0) == NOBODY
    assert heard_by_front(1.0) == 1
    assert heard_by_front(ratio - 0.01) == 1
    assert heard_by_front(ratio + 0.01) == NOBODY


def test_first_slots_are_drawn_evenly():
    n_slots = 13
    n_robots = 60_000
    first_slots = draw_first_slots(timed(slots=n_slots), jax.random.key(3), n_robots)
    counts = np.bincount(first_slots)
    expected = n_robots / n_slots
    assert len(counts) == n_slots
    assert (abs(counts - expected) < 4.5 * np.sqrt(expected)).all()
