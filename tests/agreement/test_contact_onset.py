"""Contacts that begin before bodies overlap, in every engine. Units: mm, s."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.overlaps import gap
from support.robots import HALF, robot_file
from support.small import SMALL
from support.touching import pairs_of

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.contact_geometry import TOUCHING
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.batch_engine import read_engine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.geometry.obstacles import poses_of_boxes
from iswarm_mj.utils.units import RD

FULL_SPEED = 0.5 * RD / 0.6
"""Speed of a robot that walks its longest step."""
HEAD_ON = 0.12
"""Bound of the overlap of two robots that meet head-on at full speed, for any gap at which a step
begins. They come nearer by 0.47 mm a step, and contacts begin at 0.42 mm."""
RIGID = 0.05
"""Overlap up to which bodies count as rigid."""
WALL = 7.5 * RD
"""Distance of the walls from the arena's centre."""


def engines_of(config, n_robots, file=None, n_worlds=1):
    """Return the engines by their names; the number of worlds is MuJoCo's alone."""
    of_all = compile_arena(config, n_robots, np.zeros(0), robot_file=file)
    of_one = compile_arena(config, 1, np.zeros(0), robot_file=file)
    plain = PlanarEngine(config, of_one, 1)
    batch = read_engine(of_one, config, jax.default_backend())
    mujoco = MujocoEngine(config, of_all, n_worlds, 1, n_robots)
    return {"mujoco": mujoco, "numba": plain, "warp": batch}


def motions(engine, poses, velocity, n_steps=12):
    """Return the motions of each physics step of robots and boxes, with the robots' set points.

    Args:
        engine: engine of any number of worlds.
        poses: (B, N + M, 3) at the start, or (N + M, 3) of one world.
        velocity: (N, 3) set points, the same in all worlds.
        n_steps: number of physics steps.
    """
    poses = np.array(poses, float)
    if poses.ndim == 2:
        poses = poses[None]
    n_worlds = len(poses)
    n_robots = poses.shape[1] - engine.n_boxes
    bodies = engine.place(poses, np.ones((n_worlds, n_robots), bool))
    targets = np.tile(np.array(velocity, float), (n_worlds, 1, 1))
    each = []
    for _ in range(n_steps):
        motion = engine.move(bodies, [Phase(1, lambda _: targets)], np.ones(n_worlds, bool))
        bodies = motion.bodies
        each.append(motion)
    return each


ONSETS = np.linspace(0.02, 0.48, 7)
"""Gaps at which a first step begins."""


@pytest.mark.parametrize("name", ["mujoco", "numba", "warp"])
class TestHeadOn:
    @pytest.fixture(scope="class")
    @classmethod
    def engines(cls):
        return engines_of(SMALL, 2)

    @pytest.fixture(scope="class")
    @classmethod
    def engines_of_all_onsets(cls):
        """Return engines with a world for each of `ONSETS`."""
        return engines_of(SMALL, 2, n_worlds=len(ONSETS))

    @pytest.mark.parametrize("walks", [(True, True), (True, False), (False, True)])
    @pytest.mark.parametrize("yaw", [0.0, np.pi / 4])
    def test_robots_come_to_touch_and_hardly_overlap(self, engines_of_all_onsets, name, walks, yaw):
        """Wherever the steps fall; both walk, or one pushes the other; the second may be askew."""
        reach = 1 + (np.sqrt(2) if yaw else 1)
        start = [[(0, 0, 0), (reach + distance, 0, yaw)] for distance in ONSETS]
        velocity = [(FULL_SPEED * walks[0], 0, 0), (-FULL_SPEED * walks[1], 0, 0)]
        steps = motions(engines_of_all_onsets[name], start, velocity)

        gaps = np.empty((len(steps), len(ONSETS)))
        for k, motion in enumerate(steps):
            for world, (first, second) in enumerate(np.asarray(motion.bodies.poses)):
                gaps[k, world] = gap(first, second, (1, 1), (1, 1))
        assert gaps.min() > (-HEAD_ON if all(walks) else 0.0)
        assert gaps[-1].max() < TOUCHING
        assert np.asarray(steps[-1].touching).any(axis=(1, 2)).all()

    def test_they_touch_by_force_and_distance(self, engines, name):
        """Near and pressed together; near and going apart; braking at a distance."""
        for distance, speed, touches in (
            (0.02, 1.0, True),
            (0.02, -1.0, False),
            (0.19, 0.5, False),
        ):
            start = [(0, 0, 0), (2 + distance, 0, 0)]
            (motion,) = motions(engines[name], start, [(speed, 0, 0), (-speed, 0, 0)], 1)
            assert pairs_of(motion.touching).any() == touches
            way = np.asarray(motion.bodies.poses)[0, 0, 0]
            is_braked = abs(way) < 0.99 * 0.1 * abs(speed)
            is_coming_nearer = speed > 0
            assert is_braked == is_coming_nearer

    def test_robots_pass_corner_to_corner(self, engines, name):
        """Neither is in front of a side of the other, whose normals would stop them."""
        start = np.array([(0, 0, 0), (2.39, 2.06, 0)])
        velocity = FULL_SPEED * np.sqrt(0.5) * np.array([(0, 0, 0), (-1, 1, 0)])
        steps = motions(engines[name], start, velocity, 2)
        ends = np.asarray(steps[-1].bodies.poses)[0]
        np.testing.assert_allclose(ends, start + 0.2 * velocity, atol=0.01)


def test_corners_that_meet_stop_each_other_in_planar():
    """MuJoCo has no contact there, so that robots at half the speed overlap first."""
    start = [(0, 0, 0), (2.1, 2.1, 0)]
    along = FULL_SPEED / 2 * np.sqrt(0.5)
    velocity = [(along, along, 0), (-along, -along, 0)]
    engines = engines_of(SMALL, 2)
    deepest = {}
    for name, engine in engines.items():
        gaps = []
        for motion in motions(engine, start, velocity, 6):
            first, second = np.asarray(motion.bodies.poses)[0]
            gaps.append(gap(first, second, (1, 1), (1, 1)))
        deepest[name] = -min(gaps)
    assert deepest["mujoco"] > RIGID
    assert max(deepest["numba"], deepest["warp"]) < 0.0


SOLIDS = {
    "wall": ({}, (WALL + 5.0, 0.0, 0.0), (5.0, 50.0)),
    "obstacle": (
        {"obstacles": ((3.0, 0.0, 0.5, 0.5, 45.0),)},
        (3.0 * RD, 0.0, np.pi / 4),
        (RD / 2, RD / 2),
    ),
    "box": (
        {"boxes": ((3.0, 0.0, 0.5, 0.5, 0.0, 1e-4, 1.0),)},
        (3.0 * RD, 0.0, 0.0),
        (RD / 2, RD / 2),
    ),
}
"""Part of the arena, pose and half edges of what a robot walks into; the box is too rough to move."""


@pytest.fixture(scope="module")
def long_robot(tmp_path_factory):
    """Return the file of a robot of 2.4 x 1.6 mm."""
    return robot_file(tmp_path_factory.mktemp("robots"), "four askew")


YAWS = [0.0, 0.3, np.pi / 4, np.pi / 2]
"""Yaws at which a robot walks into a solid."""


@pytest.mark.parametrize("name", ["mujoco", "numba", "warp"])
@pytest.mark.parametrize("solid", SOLIDS)
def test_long_robots_stop_at_solids_without_overlap(long_robot, name, solid):
    part, pose, half_edges = SOLIDS[solid]
    config = SwarmConfig(replace(SMALL.arena, **part))
    engine = engines_of(config, 1, long_robot, n_worlds=len(YAWS))[name]
    robot_radius = np.hypot(*HALF)
    start_x = pose[0] - half_edges[0] * (np.sqrt(2) if solid == "obstacle" else 1) - robot_radius

    # A world for each yaw.
    robots = np.array([[(start_x - 0.61, 0.1, yaw)] for yaw in YAWS])
    boxes = np.array(poses_of_boxes(config.arena.boxes)).reshape(-1, 3)
    poses = np.concatenate([robots, np.tile(boxes, (len(YAWS), 1, 1))], axis=1)
    steps = motions(engine, poses, [(FULL_SPEED, 0, 0)], 16)

    gaps = np.empty((len(steps), len(YAWS)))
    for k, motion in enumerate(steps):
        for world, bodies in enumerate(np.asarray(motion.bodies.poses)):
            gaps[k, world] = gap(bodies[0], pose, HALF, half_edges)
    assert gaps.min() > -RIGID
    assert gaps.min(axis=0).max() < TOUCHING
