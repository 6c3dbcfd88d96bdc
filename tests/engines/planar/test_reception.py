"""Reception of light by one pair, against the rules for arrays."""

import math

import numpy as np
import pytest
from support.sensing import SHIFTED

from iswarm_mj.config.swarm import OpticsConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar.reception import points_of, read_light
from iswarm_mj.engines.planar.reception import receive as receive_one
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


@pytest.mark.parametrize("robot", [ROBOT, SHIFTED], ids=["middle", "shifted"])
@pytest.mark.parametrize("optics", OPTICS, ids=["sector", "power", "narrow"])
def test_one_pair_has_the_reception_of_arrays(optics, robot):
    dx, dy, yaws = views()
    headings = [(np.cos(yaw), np.sin(yaw)) for yaw in yaws]
    power = np.random.default_rng(1).choice([0.5, 1.0], len(dx))
    expected = receive(dx, dy, *headings, robot, optics, power)
    light, points = read_light(robot, optics), points_of(robot)
    for k in range(len(dx)):
        receiver, sender = ((0.0, 0.0, float(c[k]), float(s[k])) for c, s in headings)
        got = receive_one(float(dx[k]), float(dy[k]), receiver, sender, 0, 0, float(power[k]), light, points)
        assert (got.side, got.led) == (expected.side[k], expected.led[k])
        assert got.effective == pytest.approx(expected.effective_distance[k], rel=1e-13)
        if math.isfinite(got.effective):
            bearing = robot.sides.bearings[got.side] + got.turn
            assert bearing == pytest.approx(expected.bearing[k], abs=1e-13)
            assert got.effective < light.reach and math.hypot(dx[k], dy[k]) <= light.farthest
    assert 200 < np.isfinite(expected.effective_distance).sum() < 2000
