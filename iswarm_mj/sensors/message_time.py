"""Messages that take time: slots, photodiodes that are off, and senders that disturb each other.

In each control step all robots stand still for a window of slots, each as long as one message. A
robot lights its LEDs one after the other, front, left, back and right, in consecutive slots from a
first slot on that it draws in each control step; the window's last slot is followed by its first.
The slots of all robots begin at the same time, as in slotted ALOHA (Roberts 1975, Comput. Commun.
Rev. 5, 28); with clocks that are not synchronous a message could be disturbed in twice that time.

A side receives in a slot if its photodiodes are on. Any light that the side would understand alone
disturbs other messages in the same slot, since the photodiodes have one threshold. Of the messages
that a side understands in a window, that of the nearest sender counts ("one communication channel
per photodiode", section 4.3).
"""

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Int

from iswarm_mj.config.static import StaticOptics
from iswarm_mj.geometry.robot import PAPER_SIDES, Sides
from iswarm_mj.sensors.links import Links
from iswarm_mj.utils.arrays import Array


def draw_first_slots(optics: StaticOptics, key: Array, n_robots: int) -> Int[Array, "N"]:
    """Draw the slots in which robots light their front LED."""
    return jax.random.randint(key, (n_robots,), 0, optics.slots)


def sides_on(optics: StaticOptics, sides: Sides = PAPER_SIDES) -> Bool[Array, "S"]:
    """Return the sides whose photodiodes are on while their robot emits.

    They see walls that reflect its light.
    """
    is_on = {
        "front": sides.front,
        "none": (False,) * len(sides),
        "all": (True,) * len(sides),
    }
    return jnp.array(is_on[optics.photodiodes_while_emitting])


def listens(
    optics: StaticOptics,
    since: Int[Array, "*N S"],
    sides: Sides = PAPER_SIDES,
) -> Bool[Array, "*N S"]:
    """Return the sides that receive messages.

    Args:
        optics: which photodiodes are on when.
        since: number of slots since the robot lit its front LED, below `optics.slots`, for each of
            its sides.
        sides: the robots' sides.
    """
    side = jnp.arange(len(sides))
    listens_while_silent = (since % len(sides) == side) | (not optics.serial_photodiodes)
    emits = since < len(sides)
    listens_while_emitting = sides_on(optics, sides) & (since != side)
    return jnp.where(emits, listens_while_emitting, listens_while_silent)


def understood_links(
    optics: StaticOptics,
    links: Links,
    first_slot: Int[Array, "N"],
    sides: Sides = PAPER_SIDES,
) -> Links:
    """Return the nearest sender that each side understands.

    Args:
        optics: slots, photodiodes and capture.
        links: the K nearest senders in sight of each side (N, S, K), nearest first.
        first_slot: see `draw_first_slots`.
        sides: the robots' sides.

    Returns:
        Links (N, S); zero where a side understands nobody.
    """
    # Whether the side listens in the slot in which each sender lights the LED that faces it.
    slot = (first_slot[links.sender] + links.led) % optics.slots
    since = (slot - first_slot[:, None, None]) % optics.slots
    since_by_side = jnp.moveaxis(since, -1, -2)
    is_on = jnp.moveaxis(listens(optics, since_by_side, sides), -1, -2)

    # Sender q, on the last axis, disturbs sender k.
    n_senders = slot.shape[-1]
    is_other_sender = links.valid[..., None, :] & ~jnp.eye(n_senders, dtype=bool)
    disturbs = is_other_sender & (slot[..., None, :] == slot[..., :, None])
    if optics.capture_ratio:
        distance_of_q = links.true_distance[..., None, :]
        distance_of_k = links.true_distance[..., :, None]
        disturbs &= distance_of_q < optics.capture_ratio * distance_of_k

    is_clear = links.valid & is_on & ~disturbs.any(axis=-1)
    is_nearest_clear = is_clear & (jnp.cumsum(is_clear, axis=-1) == 1)

    def values_of_nearest(values: Array) -> Array:
        return jnp.where(is_nearest_clear, values, 0).sum(axis=-1, dtype=values.dtype)

    nearest = Links(*map(values_of_nearest, links))
    return nearest._replace(valid=is_clear.any(axis=-1))
