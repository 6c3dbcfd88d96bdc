"""Every engine against MuJoCo in C: control steps of crowds from the same states, and light. Units: mm, s.

In the paper's square, and in an arena with oblique walls, obstacles, boxes that are pushed, and robots of two kinds.
"""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.boxes import BOXES, at_start
from support.robots import two_kinds
from support.small import SMALL
from support.touching import pairs_of

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mjx.arena import compile_mjx_arena, contact_capacity
from iswarm_mj.engines.mjx.engine import MjxEngine
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.batch_engine import read_engine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.engines.robot_file import read_robots
from iswarm_mj.geometry.obstacles import corners, numbers, poses_of_boxes
from iswarm_mj.geometry.walls import beyond, in_mm
from iswarm_mj.simulation.actuate import drive_phases
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.layout import cell_of, place_robots
from iswarm_mj.utils.errors import FaultKind
from iswarm_mj.utils.units import RD

N, B = 40, 2
OUTLINE = ((-7.0, -5.0), (1.0, -8.0), (8.0, -3.0), (6.0, 6.0), (-6.0, 6.0))
"""Five walls at distances from 6 to 7 rd, one of them along an axis."""
OBSTACLES = ((-2.0, 1.5, 1.5, 0.3, 25.0), (5.0, -1.0, 1.0, 0.3, 45.0), (-4.0, 1.2, 0.2, 0.2, 10.0))
OPEN = ArenaConfig(outline=OUTLINE, dump_size=1, dust_area_size=1, dust_area_offset=3, n_dust=2)
ALL = SwarmConfig(replace(OPEN, obstacles=OBSTACLES, boxes=BOXES))
SCENES = {"square": SMALL, "all": ALL}
RUNNING = np.ones(B, bool)
ABSENT = [3, 30, 31]
PRESENT = np.tile(~np.isin(np.arange(N), ABSENT), (B, 1))
THERE = np.append(PRESENT[0], np.ones(len(BOXES), bool))
"""Robots that are present, and boxes."""


@pytest.fixture(scope="module", params=SCENES)
def scene(request, tmp_path_factory):
    """Configuration, and files of the robots: None for the paper's."""
    is_square = request.param == "square"
    return SCENES[request.param], None if is_square else two_kinds(tmp_path_factory.mktemp("kinds"), N)


@cache
def engines(config, file):
    """The engine in C, and the others by their names; planar ones from one robot of each kind."""
    whole, one = (compile_arena(config, n, np.zeros(0), robot_file=file) for n in (N, None if file else 1))
    others = {"numba": PlanarEngine(config, one, 1), "warp": read_engine(one, config, jax.default_backend())}
    if file:
        room = contact_capacity(config, N, 4.0)
        others["mjx"] = MjxEngine(compile_mjx_arena(config, N, "jax", 1, room, robot_file=file), config, True)
    return MujocoEngine(config, whole, B, 1, N), others


def starts(config, file, rng):
    """Where robots and boxes start, off the grid on which several would be equally near, in single precision.

    Absent robots are in others, and in boxes, obstacles and a wall.
    """
    poses = np.stack([place_robots(config.arena, N, rng, cell_of(read_robots(file))) for _ in range(B)])
    poses[..., :2] += rng.uniform(-0.02, 0.02, (B, N, 2))
    boxes = np.tile(poses_of_boxes(config.arena.boxes), (B, 1, 1))
    poses[:, ABSENT, :2] = poses[:, [8, 9, 10], :2] + 0.5
    if config.arena.boxes:
        fixed = numbers(config.arena.obstacles, RD)[:, :2]
        poses[:, ABSENT[:2], :2] = np.stack([[boxes[0, 1, :2], fixed[1]], [fixed[0], [6.5 * RD, 0.0]]])
    return np.float32(np.concatenate([poses, boxes], axis=1)).astype(float)


def press_into_walls(poses, walls):
    """Move the robot nearest to a wall, in each world, and turn it, so that its first LED is in the wall."""
    gaps = np.where(PRESENT[..., None], walls[:, 2] - poses[:, :N, :2] @ walls[:, :2].T, np.inf)
    for world, each in enumerate(gaps):
        robot, wall = np.unravel_index(each.argmin(), each.shape)
        normal = walls[wall, :2]
        poses[world, robot, :2] += (each.min() - 0.7) * normal
        poses[world, robot, 2] = np.arctan2(normal[1], normal[0])
    return poses


@jax.jit
def step_in_mjx(engine, poses, velocity, command):
    """Motion of a world in a control step that begins like this, and the light before."""
    present, running = jnp.asarray(PRESENT[0]), jnp.bool_(True)
    bodies = engine.place(poses, present)._replace(velocity=velocity)
    return engine.move(bodies, drive_phases(ALL.drive, command), running), engine.sense(bodies, present, running)


def step(engine, poses, velocities, command):
    """Motion and light of all worlds, as NumPy arrays."""
    if isinstance(engine, MjxEngine):
        worlds = zip(np.float32(poses), np.float32(velocities), *command, strict=True)
        each = [step_in_mjx(engine, pose, velocity, Command(*its)) for pose, velocity, *its in worlds]
        return jax.tree.map(lambda *parts: np.stack(parts), *each)
    bodies = at_start(engine, engine.place(poses, PRESENT), poses, velocities)
    sight = engine.sense(bodies, PRESENT, RUNNING)
    return jax.tree.map(np.asarray, (engine.move(bodies, drive_phases(ALL.drive, command), RUNNING), sight))


def hulls(poses):
    """The robots (…, 6) as boxes of 2 x 2 mm, see `utils.obstacles.numbers`."""
    yaw = poses[..., 2].reshape(-1)
    return np.column_stack([poses[..., :2].reshape(-1, 2), np.cos(yaw), np.sin(yaw), np.ones((len(yaw), 2))])


BOUND = {"square": 2e-5, "all": 1e-4}
"""Of the differences of the engine for CPUs to MuJoCo in C, for velocities over a time step; with 32 bits rounding
decides between equal faces [mm]."""


def test_control_steps(scene):
    """After each of twelve that begin alike, motion included; the same robots touch."""
    config, file = scene
    (in_c, others), rng = engines(config, file), np.random.default_rng(1)
    poses = start = starts(config, file, rng)
    there, h = THERE[: poses.shape[1]], config.drive.timestep
    velocities, walls = np.zeros_like(poses), in_mm(config.arena.walls)
    n_touching, n_at_walls, off = 0, 0, {name: [] for name in others}
    for _ in range(12):
        command = Command(np.float32(rng.uniform(-0.3, 0.3, (B, N))), np.full((B, N), 1.4, np.float32))
        expected, _ = step(in_c, poses, velocities, command)
        end = np.concatenate([expected.bodies.poses, h * in_c._qvel[:, in_c._arena.qpos]], axis=-1)[:, there]
        for name, engine in others.items():
            motion, _ = step(engine, poses, velocities, command)
            assert not motion.fault.any() and not expected.fault.any()
            found = np.concatenate([motion.bodies.poses, h * motion.bodies.velocity], axis=-1)[:, there]
            off[name].append(np.abs(found - end).max(axis=-1))
            different = pairs_of(motion.touching) != pairs_of(expected.touching)
            assert different.sum() <= (0 if name == "numba" else 2), name
        velocities = np.float32(in_c._qvel[:, in_c._arena.qpos]).astype(float)
        poses = np.where(there[:, None], np.float32(expected.bodies.poses), start).astype(float)
        n_touching += pairs_of(expected.touching).sum()
        n_at_walls += (beyond(corners(hulls(poses[:, :N])), walls) > -0.01).any(axis=1).sum()
    bound = BOUND["all" if file else "square"]
    for name, each in off.items():
        found = np.array(each)
        assert found.max() < bound if name == "numba" else np.mean(found < bound + 1e-3) > 0.99 and found.max() < 0.02
    moved = np.hypot(*(poses - start)[..., :2].T)
    assert n_touching > 200 and n_at_walls > 70 and moved[1].min() > 1
    if file:
        assert (moved[N:] > 0.5).sum() >= 4 and moved[-1].max() < 0.01  # the rough box stays


def test_light(scene):
    """The same senders, and the same LEDs see walls, obstacles and boxes; some senders are hidden by these."""
    config, file = scene
    in_c, others = engines(config, file)
    bare = replace(config, arena=replace(config.arena, obstacles=(), boxes=()))
    free = PlanarEngine(bare, compile_arena(bare, None if file else 1, np.zeros(0), robot_file=file), 1)
    still, n_seen, n_hidden = Command(*np.zeros((2, B, N), np.float32)), 0, 0
    for seed in range(3):
        poses = press_into_walls(starts(config, file, np.random.default_rng(10 + seed)), in_mm(config.arena.walls))
        _, expected = step(in_c, poses, np.zeros_like(poses), still)
        valid = expected.links.valid
        for name, engine in others.items():
            _, sight = step(engine, poses, np.zeros_like(poses), still)
            np.testing.assert_array_equal(sight.links.valid, valid, err_msg=name)
            np.testing.assert_array_equal(sight.links.sender[valid], expected.links.sender[valid], err_msg=name)
            np.testing.assert_array_equal(sight.sees_wall, expected.sees_wall, err_msg=name)
        unhindered = free.sense(free.place(poses[:, :N], PRESENT), PRESENT, RUNNING)
        n_hidden += (unhindered.links.valid & ~valid).sum()
        n_seen += (expected.sees_wall & ~unhindered.sees_wall).sum()
    assert min(n_hidden, n_seen) > 30 if file else n_hidden == n_seen == 0


def test_robots_begin_within_oblique_walls():
    poses = place_robots(OPEN, N, np.random.default_rng(0))
    assert beyond(corners(hulls(poses)), in_mm(OPEN.walls)).max() < 1e-9


@pytest.mark.parametrize("name", ["mujoco", "numba", "warp"])
def test_a_robot_beyond_an_oblique_wall_is_lost(name):
    in_c, others = engines(SwarmConfig(OPEN), None)
    poses = starts(SwarmConfig(OPEN), None, np.random.default_rng(4))
    poses[1, 5, :2] = np.array([-6.8, 0.0]) * RD  # inside the square around the walls
    engine = (others | {"mujoco": in_c})[name]
    motion = engine.move(engine.place(poses, PRESENT), [], RUNNING)
    assert np.asarray(motion.fault).tolist() == [0, FaultKind.OUTSIDE] and motion.robot[1] == 5
