"""Faults of batched runs, decoded."""

import numpy as np

from iswarm_mj.engines.mjx.arena import Capacities
from iswarm_mj.engines.mjx.motion import TOO_MANY_CONTACTS, TOO_MANY_PAIRS
from iswarm_mj.simulation.step_mjx import NOT_FINITE, OUTSIDE, Fault

MOST_TOLD = 5
"""Worlds of which a sentence tells."""


def describe(fault: Fault, room: Capacities) -> str:
    """One sentence on what went wrong in which worlds, with the remedy; empty if nothing did.

    Args:
        fault: of all worlds, arrays (B,): bits, control step from 1, and the first robot that is concerned.
        room: what there was for contacts.
    """
    worlds = np.flatnonzero(fault.bits)
    texts = [
        (TOO_MANY_PAIRS, f"more than {room.pairs} pairs of robots near enough to touch"),
        (TOO_MANY_CONTACTS, f"more than {room.contacts} contact points"),
        (NOT_FINITE, "robot {robot} has no finite pose"),
        (OUTSIDE, "robot {robot} left the arena"),
    ]
    told = []
    for world in worlds[:MOST_TOLD]:
        what = " and ".join(text for bit, text in texts if fault.bits[world] & bit)
        told.append(f"step {fault.step[world]}, world {world}: {what.format(robot=fault.robot[world])}")
    if len(worlds) > MOST_TOLD:
        told.append(f"and {len(worlds) - MOST_TOLD} more worlds")
    if (np.asarray(fault.bits) & (TOO_MANY_PAIRS | TOO_MANY_CONTACTS)).any():
        told.append("there is no room for so many: give more --contact-room")
    return "; ".join(told)
