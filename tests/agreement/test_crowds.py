"""Every engine against MuJoCo in C: control steps of crowds from the same states, and light.

The scenes are the paper's square, and an arena with oblique walls, obstacles, boxes that are
pushed, and robots of two kinds. The other engines are planar's two implementations and, in the
second scene, MJX.
"""

from dataclasses import replace
from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from support.boxes import BOXES, moving
from support.mujoco import velocities_of
from support.planar import as_mujoco
from support.robots import two_kinds
from support.small import SMALL
from support.touching import pairs_of

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.contact_geometry import TOUCHING
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

N_ROBOTS = 40
N_WORLDS = 2
OUTLINE = ((-7.0, -5.0), (1.0, -8.0), (8.0, -3.0), (6.0, 6.0), (-6.0, 6.0))
"""Five walls at distances from 6 to 7 rd, one of them along an axis."""
OBSTACLES = ((-2.0, 1.5, 1.5, 0.3, 25.0), (5.0, -1.0, 1.0, 0.3, 45.0), (-4.0, 1.2, 0.2, 0.2, 10.0))
OPEN = ArenaConfig(outline=OUTLINE, dump_size=1, dust_area_size=1, dust_area_offset=3, n_dust=2)
FURNISHED = SwarmConfig(replace(OPEN, obstacles=OBSTACLES, boxes=BOXES))
SCENES = {"square": SMALL, "furnished": FURNISHED}

RUNNING = np.ones(N_WORLDS, bool)
ABSENT = [3, 30, 31]
"""Robots that no world has."""
IS_PRESENT = ~np.isin(np.arange(N_ROBOTS), ABSENT)
PRESENT = np.tile(IS_PRESENT, (N_WORLDS, 1))
BODIES_PRESENT = np.append(IS_PRESENT, np.ones(len(BOXES), bool))
"""Robots that are present, and boxes."""

BOUND = {"square": 2e-5, "furnished": 1e-4}
"""Largest difference between planar on CPUs and MuJoCo in C, in poses and in velocities times the
time step [mm, rad]."""
BOUND_32_BITS = 1e-3
"""Further difference of 99 % of the robots with 32-bit floats.

Rounding decides between equal faces of the others."""
LARGEST_ERROR_32_BITS = 0.02
MOST_DIFFERENT_PAIRS = {"numba": 0, "warp": 2, "mjx": 2}
"""Pairs in contact that may differ from those in C."""


@pytest.fixture(scope="module", params=SCENES)
def scene(request, tmp_path_factory):
    """Return the name of a scene, and the files of the robots: None for the paper's."""
    is_square = request.param == "square"
    robot_files = None if is_square else two_kinds(tmp_path_factory.mktemp("kinds"), N_ROBOTS)
    return request.param, robot_files


@cache
def engines(config, robot_files):
    """Return the engine in C, and the others by their names.

    Planar engines are read from one robot of each kind.
    """
    all_robots = compile_arena(config, N_ROBOTS, np.zeros(0), robot_file=robot_files)
    in_c = MujocoEngine(config, all_robots, N_WORLDS, 1, N_ROBOTS)

    one_of_each = arena_of_one(config, robot_files)
    tested_engines = {
        "numba": as_mujoco(PlanarEngine(config, one_of_each, 1)),
        "warp": as_mujoco(read_engine(one_of_each, config, jax.default_backend())),
    }
    if robot_files:
        capacity = contact_capacity(config, N_ROBOTS, 4.0)
        arena = compile_mjx_arena(config, N_ROBOTS, "jax", 1, capacity, robot_file=robot_files)
        tested_engines["mjx"] = MjxEngine(arena, config, True)
    return in_c, tested_engines


def arena_of_one(config, robot_files):
    """Return an arena with one robot, or one of each kind."""
    n_robots = None if robot_files else 1
    return compile_arena(config, n_robots, np.zeros(0), robot_file=robot_files)


def starts(config, robot_files, rng):
    """Return poses of robots and boxes (B, N + M, 3) in single precision.

    Robots stand off the grid on which several would be equally near. Absent robots are in others,
    and in boxes, obstacles and a wall.
    """
    cell = cell_of(read_robots(robot_files))
    poses = np.stack([place_robots(config.arena, N_ROBOTS, rng, cell) for _ in range(N_WORLDS)])
    poses[..., :2] += rng.uniform(-0.02, 0.02, (N_WORLDS, N_ROBOTS, 2))
    boxes = np.tile(poses_of_boxes(config.arena.boxes), (N_WORLDS, 1, 1))

    poses[:, ABSENT, :2] = poses[:, [8, 9, 10], :2] + 0.5
    if config.arena.boxes:
        obstacles = numbers(config.arena.obstacles, RD)[:, :2]
        in_wall = [6.5 * RD, 0.0]
        poses[0, ABSENT[:2], :2] = [boxes[0, 1, :2], obstacles[1]]
        poses[1, ABSENT[:2], :2] = [obstacles[0], in_wall]

    return np.float32(np.concatenate([poses, boxes], axis=1)).astype(float)


def press_into_walls(poses, walls):
    """Move and turn each world's robot nearest to a wall, so that its first LED is in the wall."""
    gaps = walls[:, 2] - poses[:, :N_ROBOTS, :2] @ walls[:, :2].T
    gaps = np.where(PRESENT[..., None], gaps, np.inf)
    for world in range(N_WORLDS):
        gap = gaps[world].min()
        robot, wall = np.unravel_index(gaps[world].argmin(), gaps[world].shape)
        normal = walls[wall, :2]
        poses[world, robot, :2] += (gap - 0.7) * normal
        poses[world, robot, 2] = np.arctan2(normal[1], normal[0])
    return poses


@jax.jit
def move_in_mjx(engine, poses, velocity, command):
    """Return the motion of a world in a control step."""
    bodies = engine.place(poses, jnp.asarray(IS_PRESENT))._replace(velocity=velocity)
    return engine.move(bodies, drive_phases(FURNISHED.drive, command), jnp.bool_(True))


@jax.jit
def sense_in_mjx(engine, poses):
    """Return the light in a world."""
    present = jnp.asarray(IS_PRESENT)
    return engine.sense(engine.place(poses, present), present, jnp.bool_(True))


def move(engine, poses, velocities, command):
    """Return the motion of all worlds in a control step, as NumPy arrays."""
    if isinstance(engine, MjxEngine):
        motions = []
        for world in range(N_WORLDS):
            world_command = Command(command.turn[world], command.forward[world])
            state = np.float32(poses[world]), np.float32(velocities[world])
            motions.append(move_in_mjx(engine, *state, world_command))
        return jax.tree.map(lambda *parts: np.stack(parts), *motions)

    bodies = moving(engine, engine.place(poses, PRESENT), poses, velocities)
    motion = engine.move(bodies, drive_phases(FURNISHED.drive, command), RUNNING)
    return jax.tree.map(np.asarray, motion)


def sense(engine, poses):
    """Return the light in all worlds, as NumPy arrays."""
    if isinstance(engine, MjxEngine):
        readings = [sense_in_mjx(engine, np.float32(world)) for world in poses]
        return jax.tree.map(lambda *parts: np.stack(parts), *readings)
    reading = engine.sense(engine.place(poses, PRESENT), PRESENT, RUNNING)
    return jax.tree.map(np.asarray, reading)


def corners_of(poses):
    """Return the corners (R, 4, 2) of robots of 2 x 2 mm at poses (..., 3)."""
    x, y, yaw = poses.reshape(-1, 3).T
    half_edge = np.ones(len(yaw))
    return corners(np.column_stack([x, y, np.cos(yaw), np.sin(yaw), half_edge, half_edge]))


@pytest.mark.slow
class TestControlSteps:
    """Twelve control steps that begin alike in all engines, motion included."""

    def test_end_alike_and_the_same_robots_touch(self, scene):
        name, robot_files = scene
        config = SCENES[name]
        timestep = config.drive.timestep
        walls = in_mm(config.arena.walls)
        rng = np.random.default_rng(1)
        in_c, tested_engines = engines(config, robot_files)
        start = starts(config, robot_files, rng)
        is_present = BODIES_PRESENT[: start.shape[1]]

        poses = start
        velocities = np.zeros_like(start)
        n_touching = 0
        n_at_walls = 0
        errors = {engine_name: [] for engine_name in tested_engines}
        for _ in range(12):
            # A step in C: all robots walk ahead and turn somewhat.
            turn = np.float32(rng.uniform(-0.3, 0.3, (N_WORLDS, N_ROBOTS)))
            command = Command(turn, np.full((N_WORLDS, N_ROBOTS), 1.4, np.float32))
            expected = move(in_c, poses, velocities, command)
            assert not expected.fault.any()
            end_velocities = velocities_of(in_c, expected.bodies)
            ends = np.dstack([expected.bodies.poses, timestep * end_velocities])

            # The same step in the other engines.
            for engine_name, engine in tested_engines.items():
                motion = move(engine, poses, velocities, command)
                assert not motion.fault.any()
                state = np.dstack([motion.bodies.poses, timestep * motion.bodies.velocity])
                error = np.abs(state - ends)[:, is_present].max(axis=-1)
                errors[engine_name].append(error)
                different_pairs = pairs_of(motion.touching) != pairs_of(expected.touching)
                assert different_pairs.sum() <= MOST_DIFFERENT_PAIRS[engine_name], engine_name

            # All go on from where C ends, in numbers that 32-bit floats hold.
            velocities = np.float32(end_velocities).astype(float)
            rounded = np.float32(expected.bodies.poses)
            poses = np.where(is_present[:, None], rounded, start).astype(float)
            n_touching += pairs_of(expected.touching).sum()
            gaps = beyond(corners_of(poses[:, :N_ROBOTS]), walls)
            n_at_walls += (gaps > -TOUCHING).any(axis=1).sum()

        self.check_errors(errors, BOUND[name])
        self.check_that_contacts_mattered(poses - start, n_touching, n_at_walls)

    def check_errors(self, errors, bound):
        """Check the differences to MuJoCo in C of robots and boxes, by engine."""
        for engine_name, each in errors.items():
            error = np.array(each)
            if engine_name == "numba":
                assert error.max() < bound
            else:
                assert np.mean(error < bound + BOUND_32_BITS) > 0.99
                assert error.max() < LARGEST_ERROR_32_BITS

    def check_that_contacts_mattered(self, displacement, n_touching, n_at_walls):
        """Check that robots touched each other and walls, and pushed all but the rough box."""
        assert n_touching > 150
        assert n_at_walls > 60

        distance = np.hypot(displacement[..., 0], displacement[..., 1]).T  # (N + M, B)
        assert distance[1].min() > 1
        distance_of_boxes = distance[N_ROBOTS:]
        if len(distance_of_boxes):
            assert (distance_of_boxes > 0.5).sum() >= 4
            assert distance_of_boxes[-1].max() < 0.01


def test_light(scene):
    """All engines find the same senders, and the same LEDs that see walls, obstacles or boxes."""
    name, robot_files = scene
    config = SCENES[name]
    in_c, tested_engines = engines(config, robot_files)
    bare = replace(config, arena=replace(config.arena, obstacles=(), boxes=()))
    bare_engine = PlanarEngine(bare, arena_of_one(bare, robot_files), 1)
    n_hidden = 0
    n_obstacles_seen = 0
    for seed in range(3):
        poses = starts(config, robot_files, np.random.default_rng(10 + seed))
        poses = press_into_walls(poses, in_mm(config.arena.walls))
        expected = sense(in_c, poses)
        valid = expected.links.valid
        senders = expected.links.sender[valid]
        for engine_name, engine in tested_engines.items():
            reading = sense(engine, poses)
            links = reading.links
            np.testing.assert_array_equal(links.valid, valid, err_msg=engine_name)
            np.testing.assert_array_equal(links.sender[valid], senders, err_msg=engine_name)
            sees_wall = reading.sees_wall
            np.testing.assert_array_equal(sees_wall, expected.sees_wall, err_msg=engine_name)

        # What would be heard and seen without obstacles and boxes.
        bodies = bare_engine.place(poses[:, :N_ROBOTS], PRESENT)
        unhindered = bare_engine.sense(bodies, PRESENT, RUNNING)
        n_hidden += (unhindered.links.valid & ~valid).sum()
        n_obstacles_seen += (expected.sees_wall & ~unhindered.sees_wall).sum()

    if name == "furnished":
        assert min(n_hidden, n_obstacles_seen) > 30
    else:
        assert n_hidden == n_obstacles_seen == 0


class TestObliqueWalls:
    def test_robots_begin_within_them(self):
        poses = place_robots(OPEN, N_ROBOTS, np.random.default_rng(0))
        assert beyond(corners_of(poses), in_mm(OPEN.walls)).max() < 1e-9

    @pytest.mark.parametrize("name", ["mujoco", "numba", "warp"])
    def test_a_robot_beyond_one_is_lost(self, name):
        """It is still inside the square around the walls."""
        config = SwarmConfig(OPEN)
        in_c, tested_engines = engines(config, None)
        engine = in_c if name == "mujoco" else tested_engines[name]
        poses = starts(config, None, np.random.default_rng(4))
        poses[1, 5, :2] = np.array([-6.8, 0.0]) * RD
        motion = engine.move(engine.place(poses, PRESENT), [], RUNNING)
        assert np.asarray(motion.fault).tolist() == [0, FaultKind.OUTSIDE]
        assert motion.robot[1] == 5
