"""Arenas of other shapes: all engines agree on contacts at oblique walls and on light, and nobody gets out."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers_rrd import read

from iswarm_mj.config import ArenaConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mjx.arena import compile_mjx_arena
from iswarm_mj.engines.mjx.engine import MjxEngine
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.batch_engine import read_engine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output.saved import load
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.step import drive_phases
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.layout import place_robots
from iswarm_mj.utils.errors import FaultKind
from iswarm_mj.utils.obstacles import corners
from iswarm_mj.utils.units import RD
from iswarm_mj.utils.walls import beyond, in_mm
from iswarm_mj.workflows.clean import clean

OUTLINE = ((-7.0, -5.0), (1.0, -8.0), (8.0, -3.0), (6.0, 6.0), (-6.0, 6.0))
"""Five walls at distances from 6 to 7 rd, one of them along an axis."""
CONFIG = SwarmConfig(
    ArenaConfig(
        outline=OUTLINE,
        dump_size=2,
        dust_area_size=1,
        dust_area_offset=4,
        n_dust=2,
        obstacles=((-3.0, 3.0, 1.5, 0.3, 25.0),),
    )
)
WALLS, N = in_mm(CONFIG.arena.walls), 40
PRESENT, RUNNING = np.ones((3, N), bool), np.ones(3, bool)


def starts(seed):
    """Where robots start, a little off the grid, on which several would be equally near, in single precision."""
    rng = np.random.default_rng(seed)
    poses = np.stack([place_robots(CONFIG.arena, N, rng) for _ in range(3)])
    poses[..., :2] += rng.uniform(-0.05, 0.05, (3, N, 2))
    return np.float32(poses).astype(float)


@cache
def engines():
    whole, one = (compile_arena(CONFIG, n, np.zeros(0)) for n in (N, 1))
    return MujocoEngine(CONFIG, whole, 3, 1, N), PlanarEngine(CONFIG, one, 1), read_engine(one, CONFIG, "cpu")


def hulls(poses):
    """The robots (…, 6) as boxes, see `utils.obstacles.numbers`."""
    yaw = poses[..., 2].reshape(-1)
    edges = np.ones((len(yaw), 2))
    return np.column_stack([poses[..., :2].reshape(-1, 2), np.cos(yaw), np.sin(yaw), edges])


def test_robots_start_within_the_walls():
    poses = place_robots(CONFIG.arena, N, np.random.default_rng(0))
    assert beyond(corners(hulls(poses)), WALLS).max() < 1e-9


def test_steps_agree():
    """After each of 25 control steps in which a crowd presses on, begun at the same places, within 0.02 mm."""
    rng, poses, n_touched = np.random.default_rng(1), starts(1), 0
    for _ in range(25):
        command = Command(np.float32(rng.uniform(-0.3, 0.3, (3, N))), np.full((3, N), 1.4, np.float32))
        motions = [e.move(e.place(poses, PRESENT), drive_phases(CONFIG.drive, command), RUNNING) for e in engines()]
        assert not any(np.any(motion.fault) for motion in motions)
        mine, plain, batch = (np.asarray(e.poses(m.bodies)) for e, m in zip(engines(), motions, strict=True))
        np.testing.assert_allclose(plain[..., :2], mine[..., :2], atol=0.02)
        np.testing.assert_allclose(batch[..., :2], plain[..., :2], atol=0.002)
        out = beyond(corners(hulls(plain)), WALLS)
        n_touched += (out > -0.01).any(axis=1).sum()
        assert out.max() < 0.3  # how deep walls give way
        poses = np.float32(plain).astype(float)
    assert n_touched > 100


def test_light_agrees():
    """Links, and which LED sees an oblique wall or an obstacle."""
    n_seen = 0
    for seed in range(6):
        poses = starts(10 + seed)
        mine, *others = (e.sense(e.place(poses, PRESENT), PRESENT, RUNNING) for e in engines())
        for yours in others:
            np.testing.assert_array_equal(mine.links.valid, yours.links.valid)
            np.testing.assert_array_equal(mine.links.sender[mine.links.valid], yours.links.sender[mine.links.valid])
            np.testing.assert_array_equal(mine.sees_wall, yours.sees_wall)
        n_seen += mine.sees_wall.sum()
    assert n_seen > 100


def test_mjx_agrees():
    """A control step of robots that walk outwards, and what they see before."""
    engine = MjxEngine(compile_mjx_arena(CONFIG, N, "jax", 1), CONFIG, False)
    in_c, _, _ = engines()
    poses = starts(3)
    poses[..., 2] = np.arctan2(poses[..., 1], poses[..., 0])
    command = Command(np.zeros((3, N), np.float32), np.full((3, N), 1.4, np.float32))

    def one(poses, command):
        bodies = engine.place(poses, jnp.ones(N, bool))
        moved = engine.move(bodies, drive_phases(CONFIG.drive, command), jnp.bool_(True))
        return moved, engine.sense(bodies, jnp.ones(N, bool), jnp.bool_(True))

    given = jnp.asarray(poses[0], jnp.float32), jax.tree.map(lambda a: jnp.asarray(a[0]), command)
    motion, sight = jax.tree.map(np.asarray, jax.jit(one)(*given))
    poses[..., 2] = np.float32(poses[..., 2])
    bodies = in_c.place(poses, PRESENT)
    expected = in_c.sense(bodies, PRESENT, RUNNING)
    np.testing.assert_array_equal(sight.links.valid, expected.links.valid[0])
    np.testing.assert_array_equal(sight.sees_wall, expected.sees_wall[0])
    ends = in_c.move(bodies, drive_phases(CONFIG.drive, command), RUNNING)
    assert motion.fault == 0 and not ends.fault.any()
    off = np.abs(motion.bodies.poses - ends.bodies.poses[0])[:, :2].max(axis=1)
    assert np.mean(off < 0.02) >= 0.95 and off.max() < 0.2  # crowds, as with obstacles
    assert (beyond(corners(hulls(ends.bodies.poses[0])), WALLS) > -0.01).any(axis=1).sum() > 5


@pytest.mark.parametrize("which", [0, 1, 2])
def test_a_robot_beyond_an_oblique_wall_is_lost(which):
    engine, poses = engines()[which], starts(4)
    poses[1, 5, :2] = np.array([-6.8, 0.0]) * RD  # inside the square around the walls
    still = Command(np.zeros((3, N), np.float32), np.zeros((3, N), np.float32))
    motion = engine.move(engine.place(poses, PRESENT), drive_phases(CONFIG.drive, still)[:0], RUNNING)
    assert np.asarray(motion.fault).tolist() == [0, FaultKind.OUTSIDE, 0] and motion.robot[1] == 5


def test_recordings_show_the_walls(tmp_path):
    run = Run(CONFIG, None, RunSettings(4, 3, record_worlds=(0,)), PlanarSettings(1))
    clean(run, tmp_path)
    shown = read(tmp_path / "clean.rrd")["/world/arena/walls"]
    middles, half = np.array(shown["Boxes3D:centers"])[:, :2], np.array(shown["Boxes3D:half_sizes"])
    np.testing.assert_allclose(beyond(middles, WALLS), half[:, 0], atol=1e-4)
    saved = load(tmp_path)
    assert saved.config == CONFIG
    np.testing.assert_allclose(saved.scene.corners, 1e-3 * RD * np.array(OUTLINE))
