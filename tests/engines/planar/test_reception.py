"""Reception of light by one pair of robots, against the rules for arrays. Units: mm, rad."""

import math

import numpy as np
import pytest
from support.sensing import SHIFTED

from iswarm_mj.config.swarm import OpticsConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.engines.planar import reception
from iswarm_mj.engines.planar.kinds import Place
from iswarm_mj.engines.planar.reception import points_of, read_light
from iswarm_mj.sensors.optics import receive

ROBOT = read_robot()
OPTICS = {
    "sector": OpticsConfig(photodiode_aperture=80),
    "power": OpticsConfig(mode="power"),
    "narrow": OpticsConfig(
        mode="power",
        led_beam_aperture=40,
        photodiode_splay=20,
        communication_radius=4.5,
    ),
}


def views(n_views=4000, seed=0):
    """Return world vectors (n_views,) from receivers to senders, and both yaws.

    A quarter of them are along axes and diagonals.
    """
    rng = np.random.default_rng(seed)
    angle = rng.uniform(-4, 4, n_views)
    distance = rng.uniform(1.5, 13, n_views)
    yaws = rng.uniform(-4, 4, (2, n_views))
    n_regular = n_views // 4
    for values in (angle, *yaws):
        values[:n_regular] = rng.integers(-4, 5, n_regular) * (math.pi / 4)
    return distance * np.cos(angle), distance * np.sin(angle), yaws


@pytest.mark.parametrize("robot", [ROBOT, SHIFTED], ids=["middle", "shifted"])
@pytest.mark.parametrize("optics", OPTICS.values(), ids=OPTICS.keys())
def test_one_pair_has_the_reception_of_arrays(optics, robot):
    dx, dy, yaws = views()
    headings = [(np.cos(yaw), np.sin(yaw)) for yaw in yaws]
    power = np.random.default_rng(1).choice([0.5, 1.0], len(dx))
    expected = receive(dx, dy, *headings, robot, optics, power)

    light = read_light(robot, optics)
    points = points_of(robot)
    (receiver_cos, receiver_sin), (sender_cos, sender_sin) = headings
    for k in range(len(dx)):
        receiver = Place(0.0, 0.0, float(receiver_cos[k]), float(receiver_sin[k]))
        sender = Place(float(dx[k]), float(dy[k]), float(sender_cos[k]), float(sender_sin[k]))
        received = reception.receive(receiver, sender, 0, 0, float(power[k]), light, points)

        assert received.side == expected.side[k]
        assert received.led == expected.led[k]
        assert received.effective == pytest.approx(expected.effective_distance[k], rel=1e-13)
        if math.isfinite(received.effective):
            bearing = robot.sides.bearings[received.side] + received.turn
            assert bearing == pytest.approx(expected.bearing[k], abs=1e-13)
            assert received.effective < light.reach
            assert math.hypot(dx[k], dy[k]) <= light.farthest
    assert 200 < np.isfinite(expected.effective_distance).sum() < 2000
