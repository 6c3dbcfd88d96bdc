"""A robot of half the length, with one LED moved sideways: geometry and light follow its file.

The robot is 1 x 2 x 1 mm; the LED of its front sits 0.4 mm left of the middle. Numbers are worked
out by hand.
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

ARENA = ArenaConfig(size=10, dump_size=2, dust_area_size=1, dust_area_offset=3.5, n_dust=2)
CONFIG = SwarmConfig(ARENA)
EDGE = 5 * RD
"""Distance of the walls from the centre [mm]."""
WALL_RANGE = 1.5 * RD
"""Distance at which LEDs see walls [mm]."""
ASIDE = (-10.0, -10.0, 45.0)
"""Pose of a robot that is too far away to be heard or in the way."""

CHANGES = {
    'name="hull" class="hull" size="1 1 0.5"': 'name="hull" class="hull" size="0.5 1 0.5"',
    'type="box" pos="0 0 0.35" size="1 1': 'type="box" pos="0 0 0.35" size="0.5 1',
    '"led0" class="optics" pos="1.001 0 0"': '"led0" class="optics" pos="0.501 0.4 0"',
    'class="optics" pos="1.001': 'class="optics" pos="0.501',
    'class="optics" pos="-1.001': 'class="optics" pos="-0.501',
}
"""Texts of the paper's robot, and those of the short one."""


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """File of the short robot."""
    directory = tmp_path_factory.mktemp("models")
    shutil.copytree(models_directory(), directory, dirs_exist_ok=True)
    path = directory / "robot.xml"
    text = path.read_text()
    for paper, short in CHANGES.items():
        assert paper in text
        text = text.replace(paper, short)
    path.write_text(text)
    return path


@pytest.fixture(scope="module")
def sense(file):
    """Light in MuJoCo in C of three robots, the last of which is dark."""
    n_robots = 3
    arena = compile_arena(CONFIG, n_robots, np.zeros(0), robot_file=file)
    engine = MujocoEngine(CONFIG, arena, 1, 1, n_robots)
    emits = np.array([[True, True, False]])

    def sense(poses):
        bodies = engine.place(poses[None], np.ones((1, n_robots), bool))
        return engine.sense(bodies, emits, np.ones(1, bool))

    return sense


def test_geometry_of_the_papers_robot():
    robot = read_robot()
    assert robot.half_edges == (1.0, 1.0, 0.5)
    assert robot.leds == robot.receivers == ((1, 0), (0, 1), (-1, 0), (0, -1))
    assert robot.photodiodes[0] == ((1, 0.36), (1, -0.36))
    assert robot.photodiodes[1] == ((-0.36, 1), (0.36, 1))
    assert robot.probe_tip == (0.9, 0.0)
    assert robot.tip_height == pytest.approx(0.055, rel=1e-12)
    assert (robot.mass, robot.yaw_inertia) == (10, pytest.approx(20 / 3))
    assert robot.circumradius == pytest.approx(np.sqrt(2))
    assert (robot.inradius, robot.ray_height) == (1, 0.5)
    assert robot.optical_offset == 0


def test_geometry_follows_the_file(file):
    robot = read_robot(file)
    assert robot.half_edges == (0.5, 1.0, 0.5)
    assert robot.leds == ((0.5, 0.4), (0, 1), (-0.5, 0), (0, -1))
    assert robot.receivers == ((0.5, 0), (0, 1), (-0.5, 0), (0, -1))
    assert (robot.circumradius, robot.inradius) == (pytest.approx(np.sqrt(1.25)), 0.5)
    assert robot.yaw_inertia == pytest.approx(10 * (1 + 4) / 12)
    assert robot.optical_offset == 0.4


def test_walls_are_seen_from_the_leds(sense):
    """The front LED is 0.5 mm ahead of the centre, the left one 1 mm left of it."""
    ahead = 0.5 + WALL_RANGE
    left = 1 + WALL_RANGE

    def sees_wall(distance):
        """Return walls that two robots see, whose LEDs are this much inside their range."""
        poses = place((EDGE - ahead + distance, 0, 0), (0, EDGE - left + distance, 0), ASIDE)
        return sense(poses).sees_wall[0, :2]

    assert sees_wall(0.01).tolist() == [[True, False, False, False], [False, True, False, False]]
    assert not sees_wall(-0.01).any()


@pytest.mark.parametrize("xp", [np, jnp])
def test_power_depends_on_the_path_from_led_to_photodiodes(file, xp):
    """The sender at (5, 0) looks back, so that its LED is at (4.5, -0.4).

    This is 4 mm ahead of the receiver's photodiodes and 0.4 mm to their right.
    """
    zero = xp.zeros(1)
    ones = xp.ones(1)
    reception = receive(
        dx=5 * ones,
        dy=zero,
        receiver=(ones, zero),
        sender=(-ones, zero),
        robot=read_robot(file),
        optics=OpticsConfig(mode="power"),
    )

    length = np.hypot(4, 0.4)
    cos = 4 / length
    order = np.log(0.5) / np.log(np.cos(np.radians(30)))
    power = cos**order * cos / length**2
    assert reception.bearing[0] == pytest.approx(np.arctan2(-0.4, 4), abs=1e-6)
    assert reception.effective_distance[0] == pytest.approx(power**-0.5 + 1, rel=1e-6)
