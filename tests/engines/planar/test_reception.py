"""Reception of light by one pair, against the rules for arrays."""

import math

import numpy as np
import pytest
from helpers_sensing import SHIFTED

from iswarm_mj.config import OpticsConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar.reception import facing_side, onto_side, power_reception, read_light, sector_distance
from iswarm_mj.sensors.optics import receive

ROBOT = read_robot()
OPTICS = [
    OpticsConfig(photodiode_aperture=80),
    OpticsConfig(mode="power"),
    OpticsConfig(mode="power", led_beam_aperture=40, photodiode_splay=20, communication_radius=4.5),
]


def views(n=4000, seed=0):
    """World vectors (n,) from receivers to senders [mm], and both headings; some along axes and diagonals."""
    rng = np.random.default_rng(seed)
    angle, distance = rng.uniform(-4, 4, n), rng.uniform(1.5, 13, n)
    yaws = rng.uniform(-4, 4, (2, n))
    for values in (angle, *yaws):
        values[: n // 4] = rng.integers(-4, 5, n // 4) * (math.pi / 4)
    return distance * np.cos(angle), distance * np.sin(angle), yaws


def one_pair(light, dx, dy, receiver, sender):
    """Side, LED, bearing and effective distance, by the functions of one pair; headings as (cos, sin)."""
    (c_r, s_r), (c_s, s_s) = receiver, sender
    at_receiver, at_sender = (c_r * dx + s_r * dy, c_r * dy - s_r * dx), (-c_s * dx - s_s * dy, s_s * dx - c_s * dy)
    side, led = facing_side(*at_receiver), facing_side(*at_sender)
    if not light.is_power:
        tans = light.photodiode_tan, light.led_tan
        return side, led, side * math.pi / 2, sector_distance(*at_receiver, *at_sender, *tans, light.reach)
    pair = *onto_side(*at_receiver, side), *onto_side(*at_sender, led)
    places = *onto_side(*light.receivers[side], side), *onto_side(*light.leds[led], led)
    turn, effective = power_reception(
        *pair, *places, light.lobe_order, light.splay_cos, light.splay_sin, light.splay_tan, light.reach
    )
    return side, led, side * math.pi / 2 + turn, effective


@pytest.mark.parametrize("robot", [ROBOT, SHIFTED], ids=["middle", "shifted"])
@pytest.mark.parametrize("optics", OPTICS, ids=["sector", "power", "narrow"])
def test_one_pair_has_the_reception_of_arrays(optics, robot):
    dx, dy, yaws = views()
    headings = [(np.cos(yaw), np.sin(yaw)) for yaw in yaws]
    expected = receive(dx, dy, *headings, robot, optics)
    light = read_light(robot, optics)
    for k in range(len(dx)):
        pair = [(float(c[k]), float(s[k])) for c, s in headings]
        side, led, bearing, effective = one_pair(light, float(dx[k]), float(dy[k]), *pair)
        assert (side, led) == (expected.side[k], expected.led[k])
        assert effective == pytest.approx(expected.effective_distance[k], rel=1e-13)
        if math.isfinite(effective):
            assert bearing == pytest.approx(expected.bearing[k], abs=1e-13)
            assert effective < light.reach and math.hypot(dx[k], dy[k]) <= light.farthest
    assert 200 < np.isfinite(expected.effective_distance).sum() < 2000
