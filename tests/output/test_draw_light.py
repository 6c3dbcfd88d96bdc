"""The pattern of a robot's light: laws of the lobe and of the distance, the threshold, and agreement with links."""

import math
from dataclasses import replace

import numpy as np
import pytest
from draw_light import light

from iswarm_mj.config.swarm import OpticsConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.sensors.optics import receive
from iswarm_mj.utils.units import mm_from_rd

ROBOT, OPTICS = read_robot(), OpticsConfig(mode="power")
FRONT = np.ones(2000), np.zeros(2000)


@pytest.mark.parametrize("radius", [2.0, 3.5, 6.0])
def test_the_threshold_is_where_robots_stop_to_hear(radius):
    """Random places around the sender, and receivers that face it."""
    optics = replace(OPTICS, communication_radius=radius)
    rng = np.random.default_rng(0)
    distance, angle = rng.uniform(1, 8, 2000), rng.uniform(-math.pi, math.pi, 2000)
    dx, dy = -mm_from_rd(distance) * np.cos(angle), -mm_from_rd(distance) * np.sin(angle)
    heard = receive(dx, dy, (-np.cos(angle), -np.sin(angle)), FRONT, ROBOT, optics).effective_distance < np.inf
    np.testing.assert_array_equal(light(distance, angle, ROBOT, optics) > 1, heard)
    assert 0.02 < heard.mean() < 0.7
