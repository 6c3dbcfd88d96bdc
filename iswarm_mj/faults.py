"""Faults of batched runs, decoded."""

from iswarm_mj.batch_step import NOT_FINITE, OUTSIDE
from iswarm_mj.engines.mjx_arena import Capacities
from iswarm_mj.engines.mjx_motion import TOO_MANY_CONTACTS, TOO_MANY_PAIRS


def describe(world: int, bits: int, step: int, robot: int, room: Capacities) -> str:
    """One sentence on what went wrong in a world.

    Args:
        world: its number.
        bits: what went wrong, at least one.
        step: control step, from 1.
        robot: the first that is concerned.
        room: what there was for contacts.
    """
    remedy = "for which there is no room: give more --contact-room"
    texts = {
        TOO_MANY_PAIRS: f"more than {room.pairs} pairs of robots near enough to touch {remedy}",
        TOO_MANY_CONTACTS: f"more than {room.contacts} contact points {remedy}",
        NOT_FINITE: f"robot {robot} has no finite pose",
        OUTSIDE: f"robot {robot} left the arena",
    }
    return f"step {step}, world {world}: " + " and ".join(text for bit, text in texts.items() if bits & bit)
