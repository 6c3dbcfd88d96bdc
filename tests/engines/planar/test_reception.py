"""Reception of light by one pair: against the rules for arrays, and the same functions compiled by NVIDIA Warp."""

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


@pytest.fixture(scope="module")
def by_warp():
    """Side, components along and to the left of it, and reception in both modes: numbers (P, 6) of P pairs."""
    wp = pytest.importorskip("warp")
    side_of, onto, sector, power = (wp.func(f) for f in (facing_side, onto_side, sector_distance, power_reception))

    @wp.kernel
    def kernel(ahead: wp.array2d(dtype=float), constants: wp.array(dtype=float), out: wp.array2d(dtype=float)):  # type: ignore[valid-type]
        k = wp.tid()
        side = side_of(ahead[k, 0], ahead[k, 1])
        led = side_of(ahead[k, 2], ahead[k, 3])
        along_r, across_r = onto(ahead[k, 0], ahead[k, 1], side)
        along_s, across_s = onto(ahead[k, 2], ahead[k, 3], led)
        turn, effective = power(
            along_r,
            across_r,
            along_s,
            across_s,
            1.0,
            0.3,
            1.0,
            -0.2,
            constants[0],
            constants[1],
            constants[2],
            constants[3],
            constants[4],
        )
        out[k, 0] = float(side)
        out[k, 1] = along_r
        out[k, 2] = across_r
        out[k, 3] = turn
        out[k, 4] = effective
        out[k, 5] = sector(ahead[k, 0], ahead[k, 1], ahead[k, 2], ahead[k, 3], constants[5], constants[6], constants[4])

    def run(ahead, constants):
        out = wp.zeros((len(ahead), 6), dtype=float, device="cpu")
        given = [wp.array(np.asarray(a, np.float32), dtype=float, device="cpu") for a in (ahead, constants)]
        wp.launch(kernel, len(ahead), given, [out], device="cpu")
        return out.numpy()

    return run


def test_warp_compiles_them_in_single_precision(by_warp):
    dx, dy, yaws = (values[..., 1000:] for values in views(seed=1))  # rounding decides where headings are aligned
    (c_r, c_s), (s_r, s_s) = np.cos(yaws), np.sin(yaws)
    ahead = np.stack([c_r * dx + s_r * dy, c_r * dy - s_r * dx, -c_s * dx - s_s * dy, s_s * dx - c_s * dy], axis=-1)
    ahead = ahead.astype(np.float32).astype(float)
    light = read_light(ROBOT, OPTICS[1])
    constants = light.lobe_order, light.splay_cos, light.splay_sin, light.splay_tan, light.reach
    tans = light.photodiode_tan, light.led_tan
    got = by_warp(ahead, [*constants, *tans])
    expected = np.empty_like(got)
    for row, (a, b, c, d) in zip(expected, ahead.tolist(), strict=True):
        side = facing_side(a, b)
        along, across = onto_side(a, b, side)
        pair = along, across, *onto_side(c, d, facing_side(c, d))
        row[:] = (
            side,
            along,
            across,
            *power_reception(*pair, 1.0, 0.3, 1.0, -0.2, *constants),
            sector_distance(a, b, c, d, *tans, light.reach),
        )
    np.testing.assert_array_equal(got[:, :3], expected[:, :3])
    at_edge = (np.isfinite(got) != np.isfinite(expected)).any(axis=1)  # of a cone or of the range
    assert at_edge.sum() < 20
    np.testing.assert_allclose(got[~at_edge], expected[~at_edge], rtol=1e-4, atol=1e-5)
    assert np.isfinite(got[:, 4]).sum() > 100 and np.isfinite(got[:, 5]).sum() > 100
