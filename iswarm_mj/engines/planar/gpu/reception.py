"""Light from one robot at another, as `planar.reception`."""

import numpy as np
import warp as wp

from iswarm_mj.engines.planar import reception
from iswarm_mj.engines.planar.gpu import functions

_facing_side, _onto_side = functions.light.facing_side, functions.light.onto_side
_onto_axis, _is_in_cone = functions.light.onto_axis, functions.light.is_in_cone
_sector_distance, _power_reception = functions.light.sector_distance, functions.light.power_reception


@wp.struct
class Light:
    """Optics, as `reception.Light`."""

    is_power: bool
    needs_sight: bool
    reach: float
    farthest: float
    photodiode_tan: float
    led_tan: float
    lobe_order: float
    splay_cos: float
    splay_sin: float
    splay_tan: float
    wall_reach: float
    optical_offset: float
    n_senders: int
    is_regular: bool
    points: wp.array(dtype=wp.vec2)
    """(5 S,) see `points_of`."""
    n_sides: int


@wp.func
def light_of(values: wp.array(dtype=float), points: wp.array(dtype=wp.vec2)) -> Light:
    """Optics from the numbers of a `reception.Light`, one after the other."""
    light = Light()
    light.is_power = values[0] != 0.0
    light.needs_sight = values[1] != 0.0
    light.reach = values[2]
    light.farthest = values[3]
    light.photodiode_tan = values[4]
    light.led_tan = values[5]
    light.lobe_order = values[6]
    light.splay_cos = values[7]
    light.splay_sin = values[8]
    light.splay_tan = values[9]
    light.wall_reach = values[10]
    light.optical_offset = values[11]
    light.n_senders = int(values[12])
    light.is_regular = values[13] != 0.0
    light.points = points
    light.n_sides = points.shape[0] // 5
    return light


def points_of(light: reception.Light) -> np.ndarray:
    """Pairs of numbers of S sides (5 S, 2): the LEDs, where each side receives light, the axes of the LEDs and of the
    photodiodes, and the bearings of these, beside a zero."""
    bearings = [(bearing, 0.0) for bearing in light.bearings]
    return np.array([*light.leds, *light.receivers, *light.led_axes, *light.axes, *bearings], np.float32)


@wp.struct
class Reception:
    """How a robot gets light from another one."""

    side: int
    led: int
    effective: float
    """Effective distance, infinite without light [mm]."""
    turn: float
    """Measured direction, from the side's normal [rad]."""


@wp.func
def _nearest_axis(ahead: float, left: float, light: Light, first: int) -> int:
    """Number of the axis nearest to a direction, of those that begin at `first` in the points."""
    side, nearest = int(0), float(-wp.inf)
    for k in range(light.n_sides):
        axis = light.points[first + k]
        along = ahead * axis[0] + left * axis[1]
        if along > nearest:
            side = k
            nearest = along
    return side


@wp.func
def _receive_anywhere(ahead_r: float, left_r: float, ahead_s: float, left_s: float, light: Light) -> Reception:
    """As `receive`, of robots whose sides look in any directions; each sees the other at (ahead, left)."""
    one, n = Reception(), light.n_sides
    one.side = _nearest_axis(ahead_r, left_r, light, 3 * n)
    one.led = _nearest_axis(ahead_s, left_s, light, 2 * n)
    one.turn = 0.0
    axis, led_axis = light.points[3 * n + one.side], light.points[2 * n + one.led]
    along_r, across_r = _onto_axis(ahead_r, left_r, axis[0], axis[1])
    along_s, across_s = _onto_axis(ahead_s, left_s, led_axis[0], led_axis[1])
    if light.is_power:
        receiver, emitter = light.points[n + one.side], light.points[one.led]
        out_r, aside_r = _onto_axis(receiver[0], receiver[1], axis[0], axis[1])
        out_s, aside_s = _onto_axis(emitter[0], emitter[1], led_axis[0], led_axis[1])
        turn, effective = _power_reception(
            along_r, across_r, along_s, across_s, out_r, aside_r, out_s, aside_s,
            light.lobe_order, light.splay_cos, light.splay_sin, light.splay_tan, light.reach,
        )  # fmt: skip
        one.turn = turn
        one.effective = effective
    else:
        distance = wp.sqrt(ahead_r * ahead_r + left_r * left_r)
        is_lit = _is_in_cone(along_r, across_r, light.photodiode_tan) and _is_in_cone(along_s, across_s, light.led_tan)
        one.effective = wp.where(is_lit and distance < light.reach, distance, wp.inf)
    return one


@wp.func
def receive(p: wp.vec4, q: wp.vec4, dx: float, dy: float, light: Light) -> Reception:
    """How a robot at p gets light from one at q, (dx, dy) away."""
    one = Reception()
    ahead_r, left_r = p[2] * dx + p[3] * dy, p[2] * dy - p[3] * dx
    ahead_s, left_s = -q[2] * dx - q[3] * dy, q[3] * dx - q[2] * dy
    if not light.is_regular:
        return _receive_anywhere(ahead_r, left_r, ahead_s, left_s, light)
    one.side = _facing_side(ahead_r, left_r)
    one.led = _facing_side(ahead_s, left_s)
    one.turn = 0.0
    if light.is_power:
        along_r, across_r = _onto_side(ahead_r, left_r, one.side)
        along_s, across_s = _onto_side(ahead_s, left_s, one.led)
        receiver, emitter = light.points[light.n_sides + one.side], light.points[one.led]
        out_r, aside_r = _onto_side(receiver[0], receiver[1], one.side)
        out_s, aside_s = _onto_side(emitter[0], emitter[1], one.led)
        turn, effective = _power_reception(
            along_r, across_r, along_s, across_s, out_r, aside_r, out_s, aside_s,
            light.lobe_order, light.splay_cos, light.splay_sin, light.splay_tan, light.reach,
        )  # fmt: skip
        one.turn = turn
        one.effective = effective
    else:
        one.effective = _sector_distance(
            ahead_r, left_r, ahead_s, left_s, light.photodiode_tan, light.led_tan, light.reach
        )
    return one
