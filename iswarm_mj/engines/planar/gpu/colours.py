"""Colours of contacts: those of one colour share no robot, so that threads can solve them side by side."""

import warp as wp

from iswarm_mj.engines.planar.gpu.block import NO_SUM, barrier, barrier_of, sum_if_any, threads_for
from iswarm_mj.engines.planar.gpu.contacts import n_contacts
from iswarm_mj.engines.planar.gpu.records import record_of
from iswarm_mj.engines.planar.gpu.world import FAILURE, N_COLOURS, N_CONTACTS, World
from iswarm_mj.utils.errors import FaultKind

MAX_COLOURS = 31
"""Bits of a robot's used colours."""
_MAX_ROUNDS = wp.constant(100)
_MAX_COLOURS, _TOO_MANY = wp.constant(MAX_COLOURS), wp.constant(int(FaultKind.TOO_MANY_CONTACTS))


@wp.func
def colour_contacts(w: World, lane: int):
    """Colour all contacts, the same way whatever their order in the list, and sort them by colour.

    In each round those contacts win that have the least key at both ends, and take their least free colour (Jones &
    Plassmann 1993, SIAM J. Sci. Comput. 14, 654). Walls, which do not move, may be shared. Threads without a contact
    wait.
    """
    n = n_contacts(w)
    n_lanes = threads_for(n)
    if lane < n_lanes:
        _begin(w, n, lane, n_lanes)
        round, is_open = int(0), bool(True)
        while is_open and round < _MAX_ROUNDS:
            for k in range(lane, n, n_lanes):
                if w.found[k][2] < 0:
                    _claim(w, w.found[k], round)
            barrier_of(n_lanes)
            is_left = bool(False)
            for k in range(lane, n, n_lanes):
                if w.found[k][2] < 0:
                    is_left = not _takes_colour(w, k, round) or is_left
            is_open = sum_if_any(is_left, wp.int64(0), n_lanes) != NO_SUM
            round += 1
        if is_open:  # a heap of robots, which is not solved
            if lane == 0:
                wp.atomic_or(w.count, FAILURE, _TOO_MANY)
                w.count[N_CONTACTS] = 0
        else:
            _sort(w, n, lane, n_lanes)
    barrier()


@wp.func
def _begin(w: World, n: int, lane: int, n_lanes: int):
    """Forget the colours of the step before."""
    for colour in range(lane, _MAX_COLOURS + 1, n_lanes):
        w.end[colour] = 0
    for k in range(lane, n, n_lanes):
        for end in range(2):
            i = w.found[k][end]
            if i < w.place.shape[0]:
                w.used[i] = 0
                w.claim[i] = wp.int64(9223372036854775807)
    barrier_of(n_lanes)


@wp.func
def _claim(w: World, pair: wp.vec3i, round: int):
    """PluginKind a contact's key to both ends."""
    key = _key(pair, w.place.shape[0], round)
    wp.atomic_min(w.claim, pair[1], key)
    if pair[0] < w.place.shape[0]:
        wp.atomic_min(w.claim, pair[0], key)


@wp.func
def _takes_colour(w: World, k: int, round: int) -> bool:
    """Whether a contact wins at both ends, and so gets its colour."""
    i, j, n_robots = w.found[k][0], w.found[k][1], w.place.shape[0]
    key = _key(w.found[k], n_robots, round)
    used = w.used[j]
    if w.claim[j] != key:
        return False
    if i < n_robots:
        if w.claim[i] != key:
            return False
        used = used | w.used[i]
    colour = int(0)
    while colour < _MAX_COLOURS - 1 and (used >> colour) & 1 == 1:
        colour += 1
    if (used >> colour) & 1 == 1:
        wp.atomic_or(w.count, FAILURE, _TOO_MANY)
    w.found[k] = wp.vec3i(i, j, colour)
    w.used[j] = w.used[j] | (1 << colour)
    if i < n_robots:
        w.used[i] = w.used[i] | (1 << colour)
    wp.atomic_add(w.end, colour, 1)
    return True


@wp.func
def _sort(w: World, n: int, lane: int, n_lanes: int):
    """Sort the contacts by colour: add up how many there are of each, then write."""
    if lane == 0:
        at = int(0)
        for colour in range(_MAX_COLOURS + 1):
            count = w.end[colour]
            w.end[colour] = at
            if count > 0:
                w.count[N_COLOURS] = colour + 1
            at += count
    barrier_of(n_lanes)
    for k in range(lane, n, n_lanes):
        at = wp.atomic_add(w.end, w.found[k][2], 1)
        record = record_of(w, at)
        record[0].first = w.found[k][0]
        record[0].second = w.found[k][1]


@wp.func
def begin_of(w: World, colour: int) -> int:
    """Number of contacts of the colours before this one."""
    if colour == 0:
        return 0
    return w.end[colour - 1]


@wp.func
def _key(pair: wp.vec3i, n_robots: int, round: int) -> wp.int64:
    """Distinct for each contact, scattered, and less in later rounds."""
    number = wp.uint32(pair[0] * n_robots + pair[1])
    mixed = number * wp.uint32(1103515245)
    mixed = (mixed ^ (mixed >> wp.uint32(15))) * wp.uint32(1664525)
    scattered = wp.int64(mixed >> wp.uint32(9))
    return (wp.int64(_MAX_ROUNDS - round) << wp.int64(55)) | (scattered << wp.int64(32)) | wp.int64(number)
