"""Obstacles: MuJoCo in C and the planar engine agree on contacts and light, and nobody gets through."""

import math

import numpy as np
import pytest
from helpers_obstacles import BOXES, CONFIG, N, starts
from helpers_rrd import read

from iswarm_mj.config import SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output.saved import load
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.step import drive_phases
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.obstacles import corners, distances, numbers
from iswarm_mj.utils.units import RD
from iswarm_mj.workflows.clean import clean


@pytest.fixture(scope="module")
def engines():
    whole, one = (compile_arena(CONFIG, n, np.zeros(0)) for n in (N, 1))
    return MujocoEngine(CONFIG, whole, 3, 1, N), PlanarEngine(CONFIG, one, 1)


def test_robots_start_beside_obstacles():
    """At any heading they touch none: their centres are half a diameter away."""
    away = distances(starts(0)[..., :2].reshape(-1, 2), numbers(BOXES, RD))
    assert away.min() >= RD / 2


def test_steps_agree(engines):
    """After each of 25 control steps in a crowd, begun at the same places, robots are within 0.02 mm of each other."""
    running, present = np.ones(3, bool), np.ones((3, N), bool)
    rng, poses = np.random.default_rng(1), starts(1)
    boxes, n_touched, farthest = numbers(BOXES, RD), 0, 0.0
    bodies = [engine.place(poses, present) for engine in engines]
    for _ in range(25):
        command = Command(rng.uniform(-0.3, 0.3, (3, N)), np.full((3, N), 1.4))
        moved = [
            engine.move(body, drive_phases(CONFIG.drive, command), running)
            for engine, body in zip(engines, bodies, strict=True)
        ]
        assert not any(motion.fault.any() for motion in moved)
        ours, theirs = (engine.poses(motion.bodies) for engine, motion in zip(engines, moved, strict=True))
        farthest = max(farthest, np.abs(ours - theirs)[..., :2].max())
        n_touched += (distances(theirs[..., :2].reshape(-1, 2), boxes) < 1.45).sum()
        assert distances(theirs[..., :2].reshape(-1, 2), boxes).min() > 0.8  # half a robot is 1 mm
        bodies = [engine.place(theirs.copy(), present) for engine in engines]
    assert n_touched > 50 and farthest < 0.02


def test_light_agrees(engines):
    """Links, and which LED sees a wall or an obstacle; both are hidden, and seen, by obstacles here."""
    present, running = np.ones((3, N), bool), np.ones(3, bool)
    free = PlanarEngine(SwarmConfig(), compile_arena(SwarmConfig(), 1, np.zeros(0)), 1)
    n_hidden = n_seen = 0
    for seed in range(6):
        poses = starts(10 + seed)
        mine, yours, unhindered = (e.sense(e.place(poses, present), present, running) for e in (*engines, free))
        np.testing.assert_array_equal(mine.links.valid, yours.links.valid)
        valid = mine.links.valid
        np.testing.assert_array_equal(mine.links.sender[valid], yours.links.sender[valid])
        np.testing.assert_array_equal(mine.sees_wall, yours.sees_wall)
        n_hidden += (unhindered.links.valid & ~valid).sum()
        inside = np.abs(poses[..., :2]).max(axis=-1) < (7.5 - 1.5) * RD - 2.0
        n_seen += mine.sees_wall[inside].sum()
    assert n_hidden > 30 and n_seen > 30


def test_by_hand(engines):
    """Two robots on either side of a box do not hear each other; those that face it see it, but not past a third."""
    x = np.array([0.0, 0.0, 0.0, *[6.5] * (N - 3)]) * RD
    y = np.array([3.4, 6.6, 2.0, *np.linspace(-7, 0, N - 3)]) * RD
    poses = np.column_stack([x, y, np.full(N, math.pi / 2)])[None].repeat(3, axis=0)
    poses[:, 1, 2] = -math.pi / 2
    present = np.arange(N) < np.array([2, 3, 1])[:, None]
    for engine in engines:
        sight = engine.sense(engine.place(poses, present), present, np.ones(3, bool))
        assert not sight.links.valid[0, :2].any()
        assert sight.sees_wall[0, 0].tolist() == [True, False, False, False]
        assert sight.sees_wall[0, 1].tolist() == [True, False, True, False]  # behind it is the northern wall
        assert sight.links.valid[1, 2, 0] and sight.links.sender[1, 2, 0] == 0 and not sight.sees_wall[1, 2].any()


def test_corners_by_hand():
    box = numbers([(1.0, 2.0, 2.0, 1.0, 90.0)])
    np.testing.assert_allclose(corners(box)[0], [[0, 4], [0, 0], [2, 0], [2, 4]], atol=1e-12)
    np.testing.assert_allclose(
        distances(np.array([[1.0, 1.0], [5.0, 2.0], [4.0, 6.0], [1.0, -3.0]]), box), [0, 3, np.sqrt(8), 3]
    )


def test_recordings_show_them(tmp_path):
    settings = RunSettings(4, 3, record_worlds=(0,))
    run = Run(CONFIG, None, settings, PlanarSettings(1))
    clean(run, tmp_path)
    boxes = read(tmp_path / "clean.rrd")["/world/arena/obstacles"]
    half = np.array(boxes["Boxes3D:half_sizes"])
    np.testing.assert_allclose(half[:, :2], RD * np.array(BOXES)[:, 2:4], rtol=1e-6)
    saved = load(tmp_path)
    assert saved.config == CONFIG
    np.testing.assert_allclose(saved.scene.obstacles[:, :2], 1e-3 * RD * np.array(BOXES)[:, :2])
