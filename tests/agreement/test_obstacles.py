"""Obstacles by hand, for MuJoCo in C and both planar engines. Units: mm, s."""

import math
from dataclasses import replace

import numpy as np
from helpers_planar import both_engines, moved, placed
from helpers_rrd import read
from helpers_small import SMALL

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.gpu.physics import rooms
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output.saved import load
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.utils.errors import FaultKind
from iswarm_mj.utils.units import RD
from iswarm_mj.utils.walls import beyond, in_mm
from iswarm_mj.workflows.clean import clean


def arena_with(*boxes, n_dust=2):
    return replace(SMALL.arena, obstacles=boxes, dust_area_size=2, dust_area_offset=5.5, n_dust=n_dust)


def engines(n_worlds, n_robots, *boxes):
    config = SwarmConfig(arena_with(*boxes))
    whole = compile_arena(config, n_robots, np.zeros(0))
    return MujocoEngine(config, whole, n_worlds, 1, n_robots), *both_engines(config)


def test_light_past_a_box():
    """Two robots on either side of it do not hear each other; those that face it see it, but not past a third."""
    row = np.array([(0.0, 3.4 * RD, math.pi / 2), (0.0, 6.6 * RD, -math.pi / 2), (0.0, 2.0 * RD, math.pi / 2)])
    poses, present = row[None].repeat(2, axis=0), np.arange(3) < np.array([2, 3])[:, None]
    for engine in engines(2, 3, (0.0, 5.0, 1.0, 1.0, 0.0)):
        sight = engine.sense(placed(engine, poses, present), present, np.ones(2, bool))
        valid, sees = np.asarray(sight.links.valid), np.asarray(sight.sees_wall)
        assert not valid[0, :2].any() and sees[0, 0].tolist() == [True, False, False, False]
        assert sees[0, 1].tolist() == [True, False, True, False]  # behind it is the northern wall
        assert valid[1, 2, 0] and sight.links.sender[1, 2, 0] == 0 and not sees[1, 2].any()


def test_a_led_inside_an_obstacle_sees_it():
    """As of a robot pressed into it; one whose axis a third robot crosses first sees none."""
    beside, between = (0.0, 6.0, 0.0), (4.6, 0.0, 0.0)
    poses = np.array([[(6.2, 0.0, 0.0), beside], [(2.0, 0.0, 0.0), between], [(2.0, 0.0, 0.0), beside]])
    for engine in engines(3, 2, (9 / RD, 0.0, 2 / RD, 2 / RD, 0.0))[1:]:  # from 7 mm on
        sees = np.asarray(engine.sense(placed(engine, poses), np.ones((3, 2), bool), np.ones(3, bool)).sees_wall)
        assert sees[:, 0, 0].tolist() == [True, False, True]


def test_a_robot_between_two_boxes_and_a_wall():
    """Pressed into a corner that a box makes with the wall, and into one of two boxes, it stays out of all three."""
    boxes = ((6.4, 0.0, 1.1, 1.0, 0.0), (-4.0, 0.0, 1.0, 1.0, 0.0), (-2.5, 1.5, 0.5, 0.5, 0.0))
    start = np.array([[(19.5, 4.5, 0.2), (-10.0, 4.5, 0.1), (0.0, -6.0, 0.0)]])
    present, config = np.array([[True, True, False]]), replace(SMALL, arena=arena_with(*boxes))
    config = replace(config, arena=replace(config.arena, dust_area_offset=3, dust_area_size=1, dump_size=1))
    found = []
    for engine in both_engines(config):
        bodies = placed(engine, start, present)
        for _ in range(3):
            motion = moved(engine, bodies, [(1.0, -1.0, 0.3), (1.0, -1.0, 0.3), (0.0, 5.0, 0.0)], 20)
            bodies = motion.bodies
        assert not np.any(motion.fault)
        found.append(np.asarray(motion.bodies.poses))
    np.testing.assert_allclose(found[1], found[0], atol=1e-3)
    np.testing.assert_allclose(found[1][0, :2, :2], [(7.5 * RD - 1, RD + 1), (-3 * RD - 1, RD + 1)], atol=0.1)
    np.testing.assert_array_equal(found[1][0, 2], start[0, 2])


def test_room_for_contacts_with_obstacles():
    """As many as four a robot; heaps of more obstacles on one place are a fault of their world alone."""
    assert rooms(40, 0, 4, 0, 1)[1] + 40 == rooms(40, 0, 4, 1, 1)[1] == rooms(40, 0, 5, 0, 1)[1]
    assert rooms(40, 0, 4, 4, 1) == rooms(40, 0, 4, 9, 1)
    boxes = ((4.0 + 0.01 * k, 4.0, 1.0, 1.0, 0.0) for k in range(30))
    start = np.tile([(9.0, 9.0, 0.1), (9.0, 9.0, 0.2), (-8.0, -8.0, 0.0)], (2, 1, 1))
    start[0, :2] = [(-8.0, 8.0, 0.0), (8.0, -8.0, 0.0)]
    _, batch = both_engines(SwarmConfig(arena_with(*boxes)))
    motion = moved(batch, placed(batch, start), 0.1, 2)
    assert motion.fault[0] == 0 and motion.fault[1] & FaultKind.TOO_MANY_CONTACTS


def test_recordings_show_walls_and_obstacles(tmp_path):
    outline, boxes = ((-7.0, -5.0), (1.0, -8.0), (8.0, -3.0), (6.0, 6.0), (-6.0, 6.0)), ((2.0, 3.0, 1.5, 0.3, 25.0),)
    config = SwarmConfig(replace(arena_with(*boxes), size=49.0, outline=outline, dust_area_offset=4, dust_area_size=1))
    clean(Run(config, None, RunSettings(12, 2), PlanarSettings(1)), tmp_path)
    saved, shown = load(tmp_path), read(tmp_path / "clean.rrd")
    assert saved.config == config
    np.testing.assert_allclose(saved.scene.corners, 1e-3 * RD * np.array(outline))
    middles, half = (np.array(shown["/world/arena/walls"][f"Boxes3D:{name}"]) for name in ("centers", "half_sizes"))
    np.testing.assert_allclose(beyond(middles[:, :2], in_mm(config.arena.walls)), half[:, 0], atol=1e-4)
    half = np.array(shown["/world/arena/obstacles"]["Boxes3D:half_sizes"])
    np.testing.assert_allclose(half[:, :2], RD * np.array(boxes)[:, 2:4], rtol=1e-6)
