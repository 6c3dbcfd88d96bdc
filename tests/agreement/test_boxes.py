"""Boxes that robots push: laws in closed form, for MuJoCo in C and the planar engine for CPUs. Units: mm, s."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.boxes import ARENA, at_start, placed

from iswarm_mj.config.swarm import OpticsConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.utils.units import RD

GRAVITY, DRIVE = 9810.0, 10.0 / 0.1
"""Drive: force of a robot per speed [mg/s]."""


def engines_of(*boxes):
    """MuJoCo in C and the planar engine for CPUs, in an arena with these boxes."""
    config = SwarmConfig(replace(ARENA, boxes=boxes))
    arena = compile_arena(config, 1, np.zeros(0))
    return MujocoEngine(config, arena, 1, 1, 1), PlanarEngine(config, arena, 1)


def pushed(engine, robots, boxes, velocity, n_steps=40):
    """Robots (N, 3) and boxes (M, 3) after each of some steps in which drives want this velocity."""
    bodies, running = placed(engine, [robots], boxes), np.ones(1, bool)
    found, targets = [], np.broadcast_to(np.asarray(velocity, float), (1, len(robots), 3))
    for _ in range(n_steps):
        motion = engine.move(bodies, [Phase(1, lambda _: targets)], running)
        assert not np.asarray(motion.fault).any() and not np.asarray(motion.touching).any()
        bodies = motion.bodies
        found.append([np.array(engine.poses(bodies)[0]), np.array(engine.boxes(bodies)[0])])
    return [np.array(each) for each in zip(*found, strict=True)]


@pytest.mark.parametrize("angle", [0.0, 45.0, 90.0, 157.5])
def test_friction_stops_a_sliding_box(angle):
    """After v^2 / (2 mu g), in steps of h; midway between axis and diagonal friction is 1 / cos(22.5 deg) as much."""
    friction, speed, h = 0.002, 20.0, 0.1
    slower = friction * GRAVITY * h / (1.0 if angle % 45 == 0 else math.cos(math.pi / 8))  # in a step
    n = int(speed / slower)
    expected = h * (n * speed - slower * n * (n + 1) / 2)
    assert expected == pytest.approx(speed**2 * h / (2 * slower) - speed * h / 2, rel=0.02)
    along = np.array([math.cos(math.radians(angle)), math.sin(math.radians(angle))])
    box = (3.0, 3.0, 0.5, 0.5, 0.0, 1e-5, friction)
    for engine in engines_of(box):
        bodies = placed(engine, np.zeros((1, 1, 3)), [box])
        start = np.array([[[-9.0, -9.0, 0.0], [0.0, 0.0, 0.0]]])
        bodies = at_start(engine, bodies, start, [[[0, 0, 0], [*(speed * along), 0]]])
        for _ in range(20):
            bodies = engine.move(bodies, [Phase(1, np.zeros_like)], np.ones(1, bool)).bodies
        way = engine.boxes(bodies)[0, 0, :2]
        np.testing.assert_allclose(way, expected * along, atol=0.002)


@pytest.mark.parametrize(("half_x", "half_y"), [(1.0, 0.25), (0.4, 0.8)])
def test_friction_stops_a_spinning_box(half_x, half_y):
    """After w^2 / (2 a) in steps of h, where I a is the moment of mu g m spread evenly over the box."""
    friction, speed, h, n_points = 0.0003, 3.0, 0.1, 400
    x, y = np.meshgrid(*((np.arange(n_points) + 0.5) / n_points * half * RD for half in (half_x, half_y)))
    slower = h * friction * GRAVITY * np.hypot(x, y).mean() / (RD**2 * (half_x**2 + half_y**2) / 3)
    n, box = int(speed / slower), (3.0, 3.0, half_x, half_y, 30.0, 3e-5, friction)
    for engine in engines_of(box):
        bodies = placed(engine, np.zeros((1, 1, 3)), [box])
        bodies = at_start(engine, bodies, [[[-9.0, -9.0, 0.0], [0, 0, 0.5]]], [[[0, 0, 0], [0, 0, speed]]])
        bodies = engine.move(bodies, [Phase(30, np.zeros_like)], np.ones(1, bool)).bodies
        turned = engine.boxes(bodies)[0, 0] - [0, 0, 0.5]
        assert 5 < n < 25
        np.testing.assert_allclose(turned, [0, 0, h * (n * speed - slower * n * (n + 1) / 2)], atol=0.002)


@pytest.mark.parametrize("engine", engines_of((3.0, 0.0, 0.5, 0.5, 0.0, 1e-5, 0.0)), ids=["mujoco", "planar"])
def test_a_push_without_friction_keeps_momentum(engine):
    """A robot whose drive is off and a resting box of its mass; what one loses the other gains."""
    arena = replace(ARENA, boxes=((3.0, 0.0, 0.5, 0.5, 0.0, 2e-5, 0.0),))
    config = SwarmConfig(arena)

    def without_drive(spec):
        for joint in spec.joints:
            joint.damping[0] = 0.0

    whole = compile_arena(config, 1, np.zeros(0), tune=without_drive)
    made = MujocoEngine(config, whole, 1, 1, 1) if isinstance(engine, MujocoEngine) else PlanarEngine(config, whole, 1)
    bodies = placed(made, np.zeros((1, 1, 3)), arena.boxes)
    start = np.array([[[0.0, 0.0, 0.0], [3.0, 0.2, 0.0]]])
    bodies = at_start(made, bodies, start, [[[6.0, 0, 0], [0, 0, 0]]])
    for _ in range(5):
        before = bodies.poses.copy()
        bodies = made.move(bodies, [Phase(1, np.zeros_like)], np.ones(1, bool)).bodies
    velocity = (bodies.poses - before)[0] / 0.1
    assert velocity[1, 0] > 1.0
    np.testing.assert_allclose(10 * velocity[0, :2] + 20 * velocity[1, :2], [60.0, 0.0], atol=1e-6)
    spin = 10 * velocity[0, 2] * 2 / 3 + 20 * velocity[1, 2] * RD**2 / 6
    about = [mass * (x * v - y * u) for mass, (x, y, _), (u, v, _) in zip((10, 20), before[0], velocity, strict=True)]
    np.testing.assert_allclose(spin + sum(about), 0.0, atol=1e-4)


@pytest.mark.parametrize("turned", [0.0, 45.0])
def test_what_a_drive_can_push_and_what_not(turned):
    """A drive gives m v / h at most: 23.6 mg mm/s a step; a box at 45 degrees is pushed at its corner."""
    speed = 0.5 * RD / 0.6
    limit = DRIVE * speed / GRAVITY  # of friction times mass [mg]
    for share, moves in ((0.98, True), (1.02, False)):
        box = (3.0, 0.0, 0.5, 0.5, turned, 1e-5, share * limit / 10.0)
        at = 3 * RD - RD / 2 * (math.sqrt(2) if turned else 1) - 1.0
        for engine in engines_of(box):
            robots, boxes = pushed(engine, [[at, 0, 0]], [box], [speed, 0, 0])
            way = boxes[-1, 0] - [3 * RD, 0, math.radians(turned)]
            np.testing.assert_allclose(way[1:], 0, atol=1e-6)
            steady = (boxes[-1, 0, 0] - boxes[-2, 0, 0]) / 0.1
            assert steady == pytest.approx((1 - share) * speed if moves else 0.0, abs=0.003)
            assert abs(robots[-1, 0, 0] - at) < 1.0 if not moves else robots[-1, 0, 0] > at


def test_a_led_in_the_box_of_its_own_world_sees_it():
    """However short its range; in the first of two worlds the box is elsewhere."""
    box = (3.0, 0.0, 0.5, 0.5, 0.0, 1e-5, 0.1)
    config = SwarmConfig(replace(ARENA, boxes=(box,)), optics=OpticsConfig(wall_range=0.05))
    whole = compile_arena(config, 1, np.zeros(0))
    poses = np.array([[(0.0, 0.0, 0.0), (9.0, 9.0, 0.0)], [(0.0, 0.0, 0.0), (0.9 + RD / 2, 0.0, 0.0)]])
    for engine in (MujocoEngine(config, whole, 2, 1, 1), PlanarEngine(config, whole, 1)):
        bodies = at_start(engine, placed(engine, np.zeros((2, 1, 3)), [box]), poses, np.zeros_like(poses))
        sight = engine.sense(bodies, np.ones((2, 1), bool), np.ones(2, bool))
        assert sight.sees_wall[:, 0, 0].tolist() == [False, True]
