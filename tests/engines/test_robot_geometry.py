"""A robot of half the length, with one LED moved sideways: light and recordings follow its file.

The robot is 1 x 2 x 1 mm; the LED of its front sits 0.4 mm left of the middle. Numbers are worked out by hand.
"""

import shutil

import jax.numpy as jnp
import numpy as np
import pytest
from support.sensing import place

from iswarm_mj.config.swarm import ArenaConfig, OpticsConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena, models_directory, read_robot
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.sensors.optics import receive
from iswarm_mj.utils.units import RD

CONFIG, N = SwarmConfig(ArenaConfig(size=10, dump_size=2, dust_area_size=1, dust_area_offset=3.5, n_dust=2)), 3
ASIDE = (-10.0, -10.0, 45.0)
"""Pose of a robot that is too far away to be heard or in the way."""


def changed(directory, *changes):
    """Path of a copy of the robot's file in `directory`, with texts replaced."""
    shutil.copytree(models_directory(), directory, dirs_exist_ok=True)
    path = directory / "robot.xml"
    text = path.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return changed(
        tmp_path_factory.mktemp("models"),
        ('name="hull" class="hull" size="1 1 0.5"', 'name="hull" class="hull" size="0.5 1 0.5"'),
        ('type="box" pos="0 0 0.35" size="1 1', 'type="box" pos="0 0 0.35" size="0.5 1'),
        ('site name="led0" class="optics" pos="1.001 0 0"', 'site name="led0" class="optics" pos="0.501 0.4 0"'),
        ('class="optics" pos="1.001', 'class="optics" pos="0.501'),
        ('class="optics" pos="-1.001', 'class="optics" pos="-0.501'),
    )


@pytest.fixture(scope="module")
def sense(file):
    """Light in MuJoCo in C, of robots at (N, 3) of which the last is dark: valid links, and walls that are seen."""
    engine = MujocoEngine(CONFIG, compile_arena(CONFIG, N, np.zeros(0), robot_file=file), 1, 1, N)

    def sense(poses):
        bodies = engine.place(poses[None], np.ones((1, N), bool))
        sight = engine.sense(bodies, np.array([[True, True, False]]), np.ones(1, bool))
        return sight.links.valid[0], sight.sees_wall[0]

    return sense


class TestRecord:
    def test_of_the_robot_as_it_is(self):
        robot = read_robot()
        assert robot.half_edges == (1.0, 1.0, 0.5)
        assert robot.leds == robot.receivers == ((1, 0), (0, 1), (-1, 0), (0, -1))
        assert robot.photodiodes[0] == ((1, 0.36), (1, -0.36)) and robot.photodiodes[1] == ((-0.36, 1), (0.36, 1))
        assert robot.probe_tip == (0.9, 0.0) and robot.tip_height == pytest.approx(0.055, rel=1e-12)
        assert (robot.mass, robot.yaw_inertia) == (10, pytest.approx(20 / 3))
        assert (robot.circumradius, robot.inradius, robot.ray_height) == (pytest.approx(np.sqrt(2)), 1, 0.5)
        assert robot.optical_offset == 0

    def test_follows_the_file(self, file):
        robot = read_robot(file)
        assert robot.half_edges == (0.5, 1.0, 0.5)
        assert robot.leds == ((0.5, 0.4), (0, 1), (-0.5, 0), (0, -1))
        assert robot.receivers == ((0.5, 0), (0, 1), (-0.5, 0), (0, -1))
        assert (robot.circumradius, robot.inradius) == (pytest.approx(np.sqrt(1.25)), 0.5)
        assert robot.yaw_inertia == pytest.approx(10 * (1 + 4) / 12)
        assert robot.optical_offset == 0.4


class TestLight:
    def test_walls_are_seen_from_the_leds(self, sense):
        """1.5 rd = 4.243 mm in front of an LED, which is 0.5 mm ahead of the centre, but 1 mm left of it."""
        edge, ahead, left = 5 * RD, 0.5 + 1.5 * RD, 1 + 1.5 * RD
        _, near = sense(place((edge - ahead + 0.01, 0, 0), (0, edge - left + 0.01, 0), ASIDE))
        _, far = sense(place((edge - ahead - 0.01, 0, 0), (0, edge - left - 0.01, 0), ASIDE))
        assert near[:2].tolist() == [[True, False, False, False], [False, True, False, False]]
        assert not far[:2].any()

    @pytest.mark.parametrize("xp", [np, jnp])
    def test_power_depends_on_the_path_from_led_to_photodiodes(self, file, xp):
        """The sender at (5, 0) looks back: its LED is at (4.5, -0.4), 4 mm ahead of the receiver and 0.4 mm right."""
        robot, optics = read_robot(file), OpticsConfig(mode="power")
        zero, one = xp.zeros(1), xp.ones(1)
        got = receive(5 * one, zero, (one, zero), (-one, zero), robot, optics)
        gap = np.hypot(4, 0.4)
        power = (4 / gap) ** (np.log(0.5) / np.log(np.cos(np.radians(30)))) * (4 / gap) / gap**2
        assert got.bearing[0] == pytest.approx(np.arctan2(-0.4, 4), abs=1e-6)
        assert got.effective_distance[0] == pytest.approx(power**-0.5 + 1, rel=1e-6)
