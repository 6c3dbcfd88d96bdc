"""The pattern of a robot's light: its threshold agrees with the links between robots."""

import math
from dataclasses import replace

import numpy as np
import pytest
from draw_light import light

from iswarm_mj.config.swarm import OpticsConfig
from iswarm_mj.engines.arena import read_robot
from iswarm_mj.sensors.optics import receive
from iswarm_mj.utils.units import mm_from_rd

ROBOT = read_robot()
OPTICS = OpticsConfig(mode="power")
N_PLACES = 2000
AHEAD = np.ones(N_PLACES), np.zeros(N_PLACES)
"""Direction of the sender's LED."""


@pytest.mark.parametrize("radius", [2.0, 3.5, 6.0])
def test_the_threshold_is_where_robots_stop_to_hear(radius):
    """Receivers stand at random places around the sender and face it."""
    optics = replace(OPTICS, communication_radius=radius)
    rng = np.random.default_rng(0)
    distance = rng.uniform(1, 8, N_PLACES)
    angle = rng.uniform(-math.pi, math.pi, N_PLACES)

    dx = -mm_from_rd(distance) * np.cos(angle)
    dy = -mm_from_rd(distance) * np.sin(angle)
    towards_sender = -np.cos(angle), -np.sin(angle)
    reception = receive(dx, dy, towards_sender, AHEAD, ROBOT, optics)
    is_heard = reception.effective_distance < np.inf

    np.testing.assert_array_equal(light(distance, angle, ROBOT, optics) > 1, is_heard)
    assert 0.02 < is_heard.mean() < 0.7
