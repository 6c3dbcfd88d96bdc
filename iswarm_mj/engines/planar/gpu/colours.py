"""Colours of contacts: those of one colour share no body, so threads can solve them in parallel.

Variables that change in loops begin as `int(0)` or `bool(True)`, as Warp demands (`planar.kinds`).
"""

import warp as wp

from iswarm_mj.engines.planar.gpu.block import (
    NO_SUM,
    barrier,
    barrier_of,
    sum_if_any,
    threads_for,
)
from iswarm_mj.engines.planar.gpu.contacts import n_contacts
from iswarm_mj.engines.planar.gpu.records import record_of
from iswarm_mj.engines.planar.gpu.world import (
    COLOUR,
    FAILURE,
    FIRST,
    N_COLOURS,
    N_CONTACTS,
    SECOND,
    World,
)
from iswarm_mj.utils.errors import FaultKind

MAX_COLOURS = 31
"""Number of colours, as many as a body's used colours have bits."""
_MAX_COLOURS = wp.constant(MAX_COLOURS)
_MAX_ROUNDS = wp.constant(100)
_NO_KEY = wp.constant(wp.int64(9223372036854775807))
_TOO_MANY_CONTACTS = wp.constant(int(FaultKind.TOO_MANY_CONTACTS))


@wp.func
def colour_contacts(w: World, lane: int):
    """Colour all contacts, the same way whatever their order in the list, and sort them by colour.

    In each round those contacts win that have the least key at both ends, and take their least
    free colour (Jones & Plassmann 1993, SIAM J. Sci. Comput. 14, 654). Walls and obstacles, which
    do not move, may be shared. Threads without a contact wait.
    """
    n = n_contacts(w)
    n_lanes = threads_for(n)
    if lane < n_lanes:
        _forget_colours(w, n, lane, n_lanes)
        is_open = _play_rounds(w, n, lane, n_lanes)
        if is_open:  # a heap of robots, which is not solved
            if lane == 0:
                wp.atomic_or(w.counts, FAILURE, _TOO_MANY_CONTACTS)
                w.counts[N_CONTACTS] = 0
        else:
            _sort(w, n, lane, n_lanes)
    barrier()


@wp.func
def _forget_colours(w: World, n: int, lane: int, n_lanes: int):
    """Forget the colours of the step before."""
    for colour in range(lane, _MAX_COLOURS + 1, n_lanes):
        w.colour_ends[colour] = 0
    for k in range(lane, n, n_lanes):
        for end in range(2):
            body = w.contacts[k][end]
            if body < w.places.shape[0]:
                w.used_colours[body] = 0
                w.least_keys[body] = _NO_KEY
    barrier_of(n_lanes)


@wp.func
def _play_rounds(w: World, n: int, lane: int, n_lanes: int) -> bool:
    """Colour contacts in rounds; return whether any is left without colour.

    Each round has two parts, for contacts without colour. All offer their keys (`_key`) to both
    bodies, of which each keeps the least in `w.least_keys`; then those whose keys were kept by both
    take a colour.

    Args:
        w: the world.
        n: number of contacts.
        lane: index of this thread, which has every `n_lanes`-th contact.
        n_lanes: number of threads that have contacts.
    """
    round = int(0)
    is_open = bool(True)
    while is_open and round < _MAX_ROUNDS:
        for k in range(lane, n, n_lanes):
            if w.contacts[k][COLOUR] < 0:
                _offer_key(w, w.contacts[k], round)
        barrier_of(n_lanes)

        # Of this thread's contacts. The call, which colours a contact, comes first in any case.
        is_left = bool(False)
        for k in range(lane, n, n_lanes):
            if w.contacts[k][COLOUR] < 0:
                is_left = not _takes_colour(w, k, round) or is_left

        # Is any contact of any thread left? The sum is of zeros: only its flag counts. It is a
        # barrier, too, before the offers of the next round.
        is_open = sum_if_any(is_left, wp.int64(0), n_lanes) != NO_SUM
        round += 1
    return is_open


@wp.func
def _offer_key(w: World, contact: wp.vec3i, round: int):
    """Offer a contact's key to both ends, which keep the least."""
    n_bodies = w.places.shape[0]
    key = _key(contact, n_bodies, round)
    wp.atomic_min(w.least_keys, contact[SECOND], key)
    if contact[FIRST] < n_bodies:
        wp.atomic_min(w.least_keys, contact[FIRST], key)


@wp.func
def _takes_colour(w: World, k: int, round: int) -> bool:
    """Give a contact its colour if it wins at both ends; return whether it does."""
    n_bodies = w.places.shape[0]
    first = w.contacts[k][FIRST]
    second = w.contacts[k][SECOND]
    key = _key(w.contacts[k], n_bodies, round)
    used = w.used_colours[second]
    if w.least_keys[second] != key:
        return False
    if first < n_bodies:
        if w.least_keys[first] != key:
            return False
        used = used | w.used_colours[first]

    # The least colour that is free at both ends.
    colour = int(0)
    while colour < _MAX_COLOURS - 1 and _is_used(used, colour):
        colour += 1
    if _is_used(used, colour):
        wp.atomic_or(w.counts, FAILURE, _TOO_MANY_CONTACTS)
    w.contacts[k] = wp.vec3i(first, second, colour)
    w.used_colours[second] = w.used_colours[second] | (1 << colour)
    if first < n_bodies:
        w.used_colours[first] = w.used_colours[first] | (1 << colour)
    wp.atomic_add(w.colour_ends, colour, 1)
    return True


@wp.func
def _is_used(used_colours: int, colour: int) -> bool:
    """Return whether a colour is among the bits of used ones."""
    return (used_colours >> colour) & 1 == 1


@wp.func
def _sort(w: World, n: int, lane: int, n_lanes: int):
    """Sort the contacts by colour: add up how many there are of each, then write."""
    if lane == 0:
        begin = int(0)
        for colour in range(_MAX_COLOURS + 1):
            count = w.colour_ends[colour]
            w.colour_ends[colour] = begin
            if count > 0:
                w.counts[N_COLOURS] = colour + 1
            begin += count
    barrier_of(n_lanes)

    # Each contact takes the next free place of its colour, whose end moves on.
    for k in range(lane, n, n_lanes):
        index = wp.atomic_add(w.colour_ends, w.contacts[k][COLOUR], 1)
        record = record_of(w, index)
        record[0].first = w.contacts[k][FIRST]
        record[0].second = w.contacts[k][SECOND]


@wp.func
def begin_of(w: World, colour: int) -> int:
    """Return the number of contacts of the colours before this one."""
    if colour == 0:
        return 0
    return w.colour_ends[colour - 1]


@wp.func
def _key(contact: wp.vec3i, n_bodies: int, round: int) -> wp.int64:
    """Return the key of a contact: distinct, scattered, and less in later rounds.

    The bits are, from the highest: the rounds that are left; 23 scattered bits (by multiplication
    with the constants of two congruential generators); and the number of the pair, 32 bits.
    """
    number = wp.uint32(contact[FIRST] * n_bodies + contact[SECOND])
    mixed = number * wp.uint32(1103515245)
    mixed = (mixed ^ (mixed >> wp.uint32(15))) * wp.uint32(1664525)
    scattered = wp.int64(mixed >> wp.uint32(9))
    rounds_left = wp.int64(_MAX_ROUNDS - round)
    return (rounds_left << wp.int64(55)) | (scattered << wp.int64(32)) | wp.int64(number)
