"""Beams and photodiodes: what light from one robot does at another (sections 3.1 and 4.3 of the paper).

Each side of a robot carries one LED in its middle and two photodiodes beside it. Sides are numbered 0 front,
1 left, 2 back, 3 right. The functions act on arrays of pairs, with NumPy and JAX arrays alike; lengths in mm,
angles in rad. Whether something stands in between is not their concern: see `links`.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.config import OpticsConfig
from iswarm_mj.units import mm_from_rd

HALF_WIDTH = 1.0
"""Distance from a robot's centre to each of its sides [mm]."""

N_SIDES = 4
"""Number of LEDs, and of photodiode sectors (Table 1: 4)."""


class Reception(NamedTuple):
    """How receivers get light from senders. All arrays (P,), one entry a pair."""

    side: Any
    """int, the receiver's side that faces the sender."""
    led: Any
    """int, the sender's LED that shines towards the receiver."""
    bearing: Any
    """Direction of the sender in the receiver's frame, as far as the photodiodes tell [rad]."""
    effective_distance: Any
    """Distance at which a sender on both axes would be received alike; infinite where nothing arrives [mm]."""


def into_frame(dx: Any, dy: Any, yaw: Any) -> tuple[Any, Any]:
    """Components ahead and to the left, in a frame at `yaw`, of world vectors (dx, dy)."""
    xp = _namespace(yaw)
    c, s = xp.cos(yaw), xp.sin(yaw)
    return c * dx + s * dy, c * dy - s * dx


def facing_side(ahead: Any, left: Any) -> Any:
    """Number of the side that looks towards (ahead, left)."""
    xp = _namespace(ahead)
    front_or_back = xp.abs(ahead) >= xp.abs(left)
    return xp.where(front_or_back, xp.where(ahead > 0, 0, 2), xp.where(left > 0, 1, 3))


def receive(dx: Any, dy: Any, receiver_yaw: Any, sender_yaw: Any, optics: OpticsConfig) -> Reception:
    """Reception of light for pairs whose sender is at (dx, dy) from the receiver [mm], in world axes."""
    ahead, left = into_frame(dx, dy, receiver_yaw)
    side = facing_side(ahead, left)
    led = facing_side(*into_frame(-dx, -dy, sender_yaw))
    if optics.mode == "sector":
        return _receive_in_sector(dx, dy, receiver_yaw, sender_yaw, side, led, optics)
    return _receive_power(dx, dy, receiver_yaw, sender_yaw, side, led, optics)


def _receive_in_sector(dx, dy, receiver_yaw, sender_yaw, side, led, optics: OpticsConfig) -> Reception:
    """Paper's reception: within range, in the receiver's sector and in the sender's beam, or not at all."""
    xp = _namespace(dx)
    distance = xp.hypot(dx, dy)
    along, across = into_frame(dx, dy, receiver_yaw + side * (math.pi / 2))
    seen = xp.abs(across) <= along * math.tan(math.radians(optics.photodiode_aperture / 2))
    along, across = into_frame(-dx, -dy, sender_yaw + led * (math.pi / 2))
    lit = xp.abs(across) <= along * math.tan(math.radians(optics.led_beam_aperture / 2))
    received = seen & lit & (distance < mm_from_rd(optics.communication_radius))
    return Reception(side, led, side * (math.pi / 2), xp.where(received, distance, math.inf))


def _receive_power(dx, dy, receiver_yaw, sender_yaw, side, led, optics: OpticsConfig) -> Reception:
    """Reception by a threshold of power: Lambertian lobe, inverse square, acceptance of the photodiodes.

    The lobe is cos^m with half its power at half the beam's aperture, m = -ln 2 / ln cos(aperture / 2) (Kahn &
    Barry 1997, Eq. 8). Each of a side's two photodiodes accepts cos(angle) about an axis splayed from the side's
    normal; their powers a and b tell the bearing, tan(bearing) tan(splay) = (a - b) / (a + b). The threshold is
    such that a sender on both axes is received up to `communication_radius`, from centre to centre.
    """
    xp = _namespace(dx)
    receiver_axis = receiver_yaw + side * (math.pi / 2)
    sender_axis = sender_yaw + led * (math.pi / 2)
    gap_x = dx + HALF_WIDTH * (xp.cos(sender_axis) - xp.cos(receiver_axis))
    gap_y = dy + HALF_WIDTH * (xp.sin(sender_axis) - xp.sin(receiver_axis))
    gap = xp.maximum(xp.hypot(gap_x, gap_y), 1e-6)
    order = -math.log(2) / math.log(math.cos(math.radians(optics.led_beam_aperture / 2)))
    along, _ = into_frame(-gap_x, -gap_y, sender_axis)
    lobe = xp.clip(along / gap, 0.0, 1.0) ** order
    along, across = into_frame(gap_x, gap_y, receiver_axis)
    splay = math.radians(optics.photodiode_splay)
    a = xp.maximum(along * math.cos(splay) + across * math.sin(splay), 0.0) / gap
    b = xp.maximum(along * math.cos(splay) - across * math.sin(splay), 0.0) / gap
    total = a + b
    bearing = side * (math.pi / 2) + xp.arctan((a - b) / xp.maximum(total, 1e-9) / math.tan(splay))
    gain = lobe * total / (2 * math.cos(splay))
    effective = gap / xp.sqrt(xp.maximum(gain, 1e-12)) + 2 * HALF_WIDTH
    received = effective < mm_from_rd(optics.communication_radius)
    return Reception(side, led, bearing, xp.where(received, effective, math.inf))


def side_centre(x: Any, y: Any, yaw: Any, side: Any) -> tuple[Any, Any]:
    """World position (x, y) of the middle of a side, where the LED sits [mm]."""
    xp = _namespace(yaw)
    axis = yaw + side * (math.pi / 2)
    return x + HALF_WIDTH * xp.cos(axis), y + HALF_WIDTH * xp.sin(axis)


def _namespace(array: Any) -> Any:
    """Return the array module of `array`: NumPy's, or JAX's for its arrays."""
    if isinstance(array, np.ndarray | float | int | np.generic):
        return np
    return array.__array_namespace__()
