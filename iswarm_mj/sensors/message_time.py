"""Messages that take time: slots, photodiodes that are off, and senders that disturb each other.

In each control step all robots stand still for a window of slots, each as long as one message. A robot lights its LEDs
one after the other, front, left, back and right, in consecutive slots from a first slot on that it draws in each
control step; the window's last slot is followed by its first. The slots of all robots begin at the same time, as in
slotted ALOHA (Roberts 1975, Comput. Commun. Rev. 5, 28); with clocks that are not synchronous a message could be
disturbed in twice that time.

A side receives in a slot if its photodiodes are on. Light that would be understood alone is what disturbs another
sender's: the threshold of the photodiodes is one for both. Of the messages that a side understands in a window, that
of the nearest sender counts ("one communication channel per photodiode", section 4.3).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Int

from iswarm_mj.config.static import StaticOptics
from iswarm_mj.geometry.robot import PAPER_SIDES, Sides
from iswarm_mj.sensors.links import Links
from iswarm_mj.utils.arrays import Array


def draw_first_slots(optics: StaticOptics, key: Array, n_robots: int) -> Int[Array, "N"]:
    """Slots in which robots light their front LED."""
    return jax.random.randint(key, (n_robots,), 0, optics.slots)


def sides_on(optics: StaticOptics, sides: Sides = PAPER_SIDES) -> Bool[Array, "S"]:
    """Sides whose photodiodes are on while their robot emits, and see the wall that reflects its light."""
    on = {"front": sides.front, "none": (False,) * len(sides), "all": (True,) * len(sides)}
    return jnp.array(on[optics.photodiodes_while_emitting])


def listens(optics: StaticOptics, since: Int[Array, "*N S"], sides: Sides = PAPER_SIDES) -> Bool[Array, "*N S"]:
    """Whether each side receives messages.

    Args:
        optics: which photodiodes are on when.
        since: number of slots since the robot lit its front LED, below `optics.slots`, for each of its sides.
        sides: of the robots.
    """
    side = jnp.arange(len(sides))
    while_silent = (since % len(sides) == side) | (not optics.serial_photodiodes)
    return jnp.where(since < len(sides), sides_on(optics, sides) & (since != side), while_silent)


def understood(optics: StaticOptics, in_sight: Links, first_slot: Int[Array, "N"], sides: Sides = PAPER_SIDES) -> Links:
    """The nearest sender that each side understands.

    Args:
        optics: slots, photodiodes and capture.
        in_sight: the K nearest senders in sight of each side (N, S, K), nearest first.
        first_slot: see `draw_first_slots`.
        sides: of the robots.

    Returns:
        Links (N, S); zero where a side understands nobody.
    """
    slot = (first_slot[in_sight.sender] + in_sight.led) % optics.slots
    since = (slot - first_slot[:, None, None]) % optics.slots
    is_on = jnp.moveaxis(listens(optics, jnp.moveaxis(since, -1, -2), sides), -1, -2)
    # Sender q, on the last axis, disturbs sender k.
    is_other = in_sight.valid[..., None, :] & ~jnp.eye(slot.shape[-1], dtype=bool)
    disturbs = is_other & (slot[..., None, :] == slot[..., :, None])
    if optics.capture_ratio:
        disturbs &= in_sight.true_distance[..., None, :] < optics.capture_ratio * in_sight.true_distance[..., :, None]
    is_clear = in_sight.valid & is_on & ~disturbs.any(axis=-1)
    is_first = is_clear & (jnp.cumsum(is_clear, axis=-1) == 1)
    found = Links(*(jnp.where(is_first, values, 0).sum(axis=-1, dtype=values.dtype) for values in in_sight))
    return found._replace(valid=is_clear.any(axis=-1))
