"""How a receiver gets the light of a robot near it, for the compiled functions of CPUs."""

import math
from typing import Any

import numpy as np

from iswarm_mj.engines.planar.compiled import inlined
from iswarm_mj.engines.planar.reception import (
    Light,
    facing_side,
    is_in_cone,
    onto_axis,
    onto_side,
    power_reception,
    sector_distance,
)
from iswarm_mj.utils.robot import Point


@inlined
def receive(one: Any, c_r: float, s_r: float, c_s: float, s_s: float, light: Light) -> None:
    """Set how a receiver with heading (c_r, s_r) gets the light of a robot near it, with heading (c_s, s_s)."""
    dx, dy = one.dx, one.dy
    ahead_r, left_r = c_r * dx + s_r * dy, c_r * dy - s_r * dx
    ahead_s, left_s = -c_s * dx - s_s * dy, s_s * dx - c_s * dy
    if not light.is_regular:
        _receive_anywhere(one, ahead_r, left_r, ahead_s, left_s, light)
        return
    if light.is_power:
        _receive_power(one, ahead_r, left_r, ahead_s, left_s, light)
        return
    one.effective = sector_distance(ahead_r, left_r, ahead_s, left_s, light.photodiode_tan, light.led_tan, light.reach)
    if one.effective < np.inf:
        one.side, one.led = facing_side(ahead_r, left_r), facing_side(ahead_s, left_s)
        one.bearing = one.side * (math.pi / 2.0)


@inlined
def _receive_power(one: Any, ahead_r: float, left_r: float, ahead_s: float, left_s: float, light: Light) -> None:
    """As `receive`, in power mode; each sees the other at (ahead, left)."""
    side, led = facing_side(ahead_r, left_r), facing_side(ahead_s, left_s)
    along_r, across_r = onto_side(ahead_r, left_r, side)
    along_s, across_s = onto_side(ahead_s, left_s, led)
    out_r, aside_r = onto_side(light.receivers[side][0], light.receivers[side][1], side)
    out_s, aside_s = onto_side(light.leds[led][0], light.leds[led][1], led)
    turn, one.effective = power_reception(
        along_r, across_r, along_s, across_s, out_r, aside_r, out_s, aside_s,
        light.lobe_order, light.splay_cos, light.splay_sin, light.splay_tan, light.reach,
    )  # fmt: skip
    one.side, one.led, one.bearing = side, led, side * (math.pi / 2.0) + turn


@inlined
def _receive_anywhere(one: Any, ahead_r: float, left_r: float, ahead_s: float, left_s: float, light: Light) -> None:
    """As `receive`, of robots whose sides look in any directions; each sees the other at (ahead, left)."""
    side, led = _nearest_axis(ahead_r, left_r, light.axes), _nearest_axis(ahead_s, left_s, light.led_axes)
    axis, led_axis, receiver, emitter = light.axes[side], light.led_axes[led], light.receivers[side], light.leds[led]
    along_r, across_r = onto_axis(ahead_r, left_r, axis[0], axis[1])
    along_s, across_s = onto_axis(ahead_s, left_s, led_axis[0], led_axis[1])
    one.side, one.led, one.bearing = side, led, light.bearings[side]
    if light.is_power:
        out_r, aside_r = onto_axis(receiver[0], receiver[1], axis[0], axis[1])
        out_s, aside_s = onto_axis(emitter[0], emitter[1], led_axis[0], led_axis[1])
        turn, one.effective = power_reception(
            along_r, across_r, along_s, across_s, out_r, aside_r, out_s, aside_s,
            light.lobe_order, light.splay_cos, light.splay_sin, light.splay_tan, light.reach,
        )  # fmt: skip
        one.bearing += turn
        return
    distance = math.sqrt(ahead_r * ahead_r + left_r * left_r)
    is_lit = is_in_cone(along_r, across_r, light.photodiode_tan) and is_in_cone(along_s, across_s, light.led_tan)
    one.effective = distance if is_lit and distance < light.reach else np.inf


@inlined
def _nearest_axis(ahead: float, left: float, axes: tuple[Point, ...]) -> int:
    """Number of the axis nearest to a direction, of equally near ones the first."""
    side, nearest = 0, -np.inf
    for k in range(len(axes)):
        along = ahead * axes[k][0] + left * axes[k][1]
        if along > nearest:
            side, nearest = k, along
    return side
