"""Boxes that robots push: laws in closed form, for MuJoCo in C and the planar engine for CPUs.

Units: mm, mg, s. Settings of boxes are in rd, deg and kg, see `ArenaConfig.boxes`.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.boxes import ARENA, moving, placed

from iswarm_mj.config.swarm import OpticsConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.utils.units import RD

GRAVITY = 9810.0
ROBOT_MASS = 10.0
TIMESTEP = 0.1
DRIVE_GAIN = ROBOT_MASS / TIMESTEP
"""Force of a robot's drive per speed that it lacks [mg/s]."""
MG_PER_KG = 1e6
CORNER = [-9.0, -9.0, 0.0]
"""Pose of a robot that is far from any box."""


def box(x=3.0, y=0.0, half_x=0.5, half_y=0.5, degrees=0.0, mass=1e-5, friction=0.0):
    """Return a box as `ArenaConfig.boxes` has it [rd, deg, kg]."""
    return (x, y, half_x, half_y, degrees, mass, friction)


def engines_with(boxes, tune=None):
    """Return MuJoCo in C and the planar engine for CPUs, of one robot and boxes."""
    config = SwarmConfig(replace(ARENA, boxes=tuple(boxes)))
    arena = compile_arena(config, 1, np.zeros(0), tune=tune, refinement=1)
    return MujocoEngine(config, arena, 1, 1, 1), PlanarEngine(config, arena, 1)


def bodies_at(engine, boxes, poses, velocities):
    """Return a robot and boxes of one world at poses (1 + M, 3) with velocities (1 + M, 3)."""
    bodies = placed(engine, np.zeros((1, 1, 3)), boxes)
    return moving(engine, bodies, np.array([poses]), np.array([velocities]))


def moved(engine, bodies, n_steps):
    """Return bodies after physics steps in which all drives want to stand."""
    return engine.move(bodies, [Phase(n_steps, np.zeros_like)], np.ones(1, bool)).bodies


def push(engine, robots, boxes, velocity, n_steps=40):
    """Return robots (T, N, 3) and boxes (T, M, 3) after each step with these set points."""
    bodies = placed(engine, [robots], boxes)
    targets = np.broadcast_to(np.asarray(velocity, float), (1, len(robots), 3))
    robot_poses = []
    box_poses = []
    for _ in range(n_steps):
        motion = engine.move(bodies, [Phase(1, lambda _: targets)], np.ones(1, bool))
        assert not np.asarray(motion.fault).any()
        assert not np.asarray(motion.touching).any()

        bodies = motion.bodies
        robot_poses.append(np.array(engine.poses(bodies)[0]))
        box_poses.append(np.array(engine.boxes(bodies)[0]))
    return np.array(robot_poses), np.array(box_poses)


def stopping_distance(speed, loss):
    """Return the distance and the steps of a body that slows by `loss` a step until it stands."""
    n_steps = int(speed / loss)
    return TIMESTEP * (n_steps * speed - loss * n_steps * (n_steps + 1) / 2), n_steps


@pytest.mark.parametrize("degrees", [0.0, 45.0, 90.0, 157.5])
def test_friction_stops_a_sliding_box(degrees):
    """After v^2 / (2 mu g), in steps of h.

    Midway between an axis and a diagonal friction is 1 / cos(22.5 deg) as much.
    """
    friction = 0.002
    speed = 20.0
    is_midway = degrees % 45 != 0
    factor = 1 / math.cos(math.pi / 8) if is_midway else 1.0
    loss = friction * GRAVITY * TIMESTEP * factor  # of speed in a step
    distance, _ = stopping_distance(speed, loss)
    continuous = speed**2 * TIMESTEP / (2 * loss) - speed * TIMESTEP / 2
    assert distance == pytest.approx(continuous, rel=0.02)

    direction = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])
    boxes = [box(y=3.0, friction=friction)]
    velocities = [[0, 0, 0], [*(speed * direction), 0]]
    for engine in engines_with(boxes):
        bodies = bodies_at(engine, boxes, [CORNER, [0.0, 0.0, 0.0]], velocities)
        for _ in range(20):
            bodies = moved(engine, bodies, 1)
        expected = distance * direction
        np.testing.assert_allclose(engine.boxes(bodies)[0, 0, :2], expected, atol=0.002)


@pytest.mark.parametrize(("half_x", "half_y"), [(1.0, 0.25), (0.4, 0.8)])
def test_friction_stops_a_spinning_box(half_x, half_y):
    """After w^2 / (2 a) in steps of h, where I a is the moment of mu g m spread over the box."""
    friction = 0.0003
    speed = 3.0
    yaw = 0.5
    n_points = 400
    middles = (np.arange(n_points) + 0.5) / n_points
    x, y = np.meshgrid(middles * half_x * RD, middles * half_y * RD)
    inertia_per_mass = RD**2 * (half_x**2 + half_y**2) / 3
    loss = TIMESTEP * friction * GRAVITY * np.hypot(x, y).mean() / inertia_per_mass
    angle, n_steps = stopping_distance(speed, loss)
    assert 5 < n_steps < 25

    boxes = [box(y=3.0, half_x=half_x, half_y=half_y, degrees=30.0, mass=3e-5, friction=friction)]
    for engine in engines_with(boxes):
        velocities = [[0, 0, 0], [0, 0, speed]]
        bodies = bodies_at(engine, boxes, [CORNER, [0.0, 0.0, yaw]], velocities)
        pose = engine.boxes(moved(engine, bodies, 30))[0, 0]
        np.testing.assert_allclose(pose, [0, 0, yaw + angle], atol=0.002)


@pytest.mark.parametrize("engine_index", [0, 1], ids=["mujoco", "planar"])
def test_a_push_without_friction_keeps_momentum(engine_index):
    """A robot whose drive is off and a resting box: what one loses the other gains."""
    boxes = [box(mass=2e-5)]
    box_mass = 2e-5 * MG_PER_KG

    def switch_off_drives(spec):
        for joint in spec.joints:
            joint.damping[0] = 0.0

    engine = engines_with(boxes, switch_off_drives)[engine_index]
    speed = 6.0
    poses = [[0.0, 0.0, 0.0], [3.0, 0.2, 0.0]]
    bodies = bodies_at(engine, boxes, poses, [[speed, 0, 0], [0, 0, 0]])
    for _ in range(5):
        before = bodies.poses.copy()
        bodies = moved(engine, bodies, 1)
    robot, pushed_box = (bodies.poses - before)[0] / TIMESTEP  # velocities
    assert pushed_box[0] > 1.0
    momentum = ROBOT_MASS * robot[:2] + box_mass * pushed_box[:2]
    np.testing.assert_allclose(momentum, [ROBOT_MASS * speed, 0.0], atol=1e-6)

    # Of the spin of both, and of their motion about the origin.
    robot_inertia = ROBOT_MASS * 2 / 3
    box_inertia = box_mass * RD**2 / 6
    moment = robot_inertia * robot[2] + box_inertia * pushed_box[2]
    masses = (ROBOT_MASS, box_mass)
    for mass, (x, y, _), (u, v, _) in zip(masses, before[0], (robot, pushed_box), strict=True):
        moment += mass * (x * v - y * u)
    np.testing.assert_allclose(moment, 0.0, atol=1e-4)


@pytest.mark.parametrize("degrees", [0.0, 45.0])
@pytest.mark.parametrize(("share_of_limit", "moves"), [(0.98, True), (1.02, False)])
def test_a_drive_pushes_boxes_up_to_its_force(degrees, share_of_limit, moves):
    """A drive gives m v / h at most; a box at 45 degrees is pushed at its corner."""
    speed = 0.5 * RD / 0.6
    limit = DRIVE_GAIN * speed / GRAVITY  # of friction times mass [mg]
    boxes = [box(degrees=degrees, friction=share_of_limit * limit / (1e-5 * MG_PER_KG))]
    half_extent = RD / 2 * (math.sqrt(2) if degrees else 1)
    box_x = 3 * RD
    robot_x = box_x - half_extent - 1.0  # flush with the box
    for engine in engines_with(boxes):
        robot_poses, box_poses = push(engine, [[robot_x, 0, 0]], boxes, [speed, 0, 0])
        displacement = box_poses[-1, 0] - [box_x, 0, math.radians(degrees)]
        np.testing.assert_allclose(displacement[1:], 0, atol=1e-6)

        steady = (box_poses[-1, 0, 0] - box_poses[-2, 0, 0]) / TIMESTEP
        expected = (1 - share_of_limit) * speed if moves else 0.0
        assert steady == pytest.approx(expected, abs=0.003)
        if moves:
            assert robot_poses[-1, 0, 0] > robot_x
        else:
            assert abs(robot_poses[-1, 0, 0] - robot_x) < 1.0


@pytest.mark.slow
def test_a_led_in_the_box_of_its_own_world_sees_it():
    """The range does not matter; in the first of two worlds the box is elsewhere."""
    boxes = (box(friction=0.1),)
    config = SwarmConfig(replace(ARENA, boxes=boxes), optics=OpticsConfig(wall_range=0.05))
    arena = compile_arena(config, 1, np.zeros(0))
    robot = (0.0, 0.0, 0.0)
    far_box = (9.0, 9.0, 0.0)
    near_box = (0.9 + RD / 2, 0.0, 0.0)
    poses = np.array([[robot, far_box], [robot, near_box]])

    for engine in (MujocoEngine(config, arena, 2, 1, 1), PlanarEngine(config, arena, 1)):
        bodies = placed(engine, np.zeros((2, 1, 3)), boxes)
        bodies = moving(engine, bodies, poses, np.zeros_like(poses))
        reading = engine.sense(bodies, np.ones((2, 1), bool), np.ones(2, bool))
        assert reading.sees_wall[:, 0, 0].tolist() == [False, True]
