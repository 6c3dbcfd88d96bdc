"""The CPU engine: servos, contacts, rays, conservation laws, absent robots, faults, threads. Units: mm, mg, s."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mujoco import engine as mujoco_engine
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.utils.errors import FaultKind
from iswarm_mj.utils.units import RD

EDGE = 7.5 * RD  # of the small arena, from its middle
MASS, INERTIA = 10.0, 10.0 * (2**2 + 2**2) / 12


class Worlds:
    """Worlds with robots at rest at (B, N, 3); `free` takes drive and damping off."""

    def __init__(self, config, poses, n_threads=1, free=False, present=None, capacity=None):
        poses = np.asarray(poses, float)
        self.n_worlds, n_robots = poses.shape[:2]
        arena = compile_arena(config, n_robots, np.zeros(0))
        if free:
            arena.model.dof_damping[:] = 0.0
        self.qpos = arena.qpos
        self.engine = MujocoEngine(config, arena, self.n_worlds, n_threads, capacity or n_robots)
        self.present = np.ones(poses.shape[:2], bool) if present is None else np.asarray(present)
        self.place(poses)

    def place(self, poses):
        """Put the robots somewhere, at rest."""
        self.bodies = self.engine.place(np.asarray(poses, float), self.present)

    def move(self, velocity, n_substeps, worlds=None):
        """Move some worlds, all by default."""
        running = np.isin(np.arange(self.n_worlds), range(self.n_worlds) if worlds is None else worlds)
        velocity = np.asarray(velocity, float)
        motion = self.engine.move(self.bodies, [Phase(n_substeps, lambda _: velocity)], running)
        self.bodies = motion.bodies
        return motion

    def sense(self, emits=None):
        """Light in all worlds."""
        emits = np.ones(self.bodies.poses.shape[:2], bool) if emits is None else emits
        return self.engine.sense(self.bodies, emits, np.ones(self.n_worlds, bool))

    def cast_rays(self, *rays):
        """Share and hit for rays, see `Scene.cast_rays`."""
        return self.engine._scene.cast_rays(*rays)

    @property
    def poses(self):
        return self.engine.poses(self.bodies)

    def qvel(self):
        """Velocities of world 0 (N, 3), to read and write by their addresses."""
        return self.engine._batch.bind("qvel")


def far_apart(n_worlds, rng):
    """Nine robots that cannot meet: on a grid of 9 mm, at random headings."""
    grid = np.stack(np.meshgrid(*[[-9.0, 0.0, 9.0]] * 2), -1).reshape(-1, 2)
    return np.dstack([np.tile(grid, (n_worlds, 1, 1)), rng.uniform(-3, 3, (n_worlds, 9))])


def crowd(n_worlds, rng, n_robots=25):
    """Robots on distinct cells, so near that they meet as soon as they move."""
    cells = np.stack(np.meshgrid(*[(np.arange(7) - 3) * RD] * 2), -1).reshape(-1, 2)
    xy = np.stack([cells[rng.permutation(49)[:n_robots]] for _ in range(n_worlds)])
    return np.dstack([xy, rng.uniform(-np.pi, np.pi, (n_worlds, n_robots))])


def corners(pose):
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return pose[:2] + np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) @ [[c, s], [-s, c]]


def separation(a, b):
    """Largest gap between two squares along the normals of their sides; negative if they overlap."""
    gaps = []
    for yaw in (a[2], a[2] + np.pi / 2, b[2], b[2] + np.pi / 2):
        p, q = corners(a) @ [np.cos(yaw), np.sin(yaw)], corners(b) @ [np.cos(yaw), np.sin(yaw)]
        gaps.append(max(p.min() - q.max(), q.min() - p.max()))
    return max(gaps)


class TestServo:
    def test_robots_move_as_commanded(self, small):
        rng = np.random.default_rng(1)
        start = far_apart(2, rng)
        engine = Worlds(small, start)
        velocity = rng.uniform(-1.5, 1.5, start.shape)
        engine.move(velocity, 7)
        np.testing.assert_allclose(engine.poses, start + 0.7 * velocity, atol=1e-9)

    def test_walking_along_the_heading_does_not_slip_sideways(self, small):
        start = far_apart(1, np.random.default_rng(2))
        engine = Worlds(small, start)
        yaw = start[..., 2]
        ahead = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=-1)
        for _ in range(3):
            engine.move(np.sqrt(2) * ahead, 6)
        moved = engine.poses - start
        np.testing.assert_allclose((moved * ahead).sum(-1), 3 * 0.6 * np.sqrt(2), atol=1e-6)
        np.testing.assert_allclose(moved[..., 1] * ahead[..., 0] - moved[..., 0] * ahead[..., 1], 0, atol=1e-6)
        np.testing.assert_allclose(moved[..., 2], 0, atol=1e-9)

    def test_a_command_leaves_nothing_behind(self, small):
        start = far_apart(1, np.random.default_rng(3))
        engine = Worlds(small, start)
        engine.move(np.full(start.shape, 1.0), 3)
        there = engine.poses
        engine.move(np.zeros(start.shape), 5)
        np.testing.assert_allclose(engine.poses, there, atol=1e-9)

    def test_worlds_not_listed_stand_still(self, small):
        start = far_apart(3, np.random.default_rng(4))
        engine = Worlds(small, start)
        engine.move(np.full(start.shape, 1.0), 4, [0, 2])
        np.testing.assert_array_equal(engine.poses[1], start[1])
        np.testing.assert_allclose(engine.poses[[0, 2]], start[[0, 2]] + 0.4, atol=1e-9)

    def test_any_time_step(self, small):
        config = replace(small, drive=replace(small.drive, turn_substeps=8, walk_substeps=17, control_period=0.5))
        start = far_apart(1, np.random.default_rng(5))
        engine = Worlds(config, start)
        engine.move(np.full(start.shape, 1.0), 17)
        np.testing.assert_allclose(engine.poses, start + 17 * 0.02, atol=1e-9)

    def test_robots_are_placed_at_rest(self, small):
        start = far_apart(1, np.random.default_rng(6))
        engine = Worlds(small, start)
        engine.move(np.full(start.shape, 1.0), 3)
        engine.place(start)
        np.testing.assert_array_equal(engine.poses, start)
        assert not engine.qvel().any()


class TestCollisions:
    @pytest.mark.parametrize(
        "second", [(2.5, 0.0, 0.0), (2.6, 0.7, 0.4), (1.5, 2.2, 0.8)], ids=["head-on", "corner", "oblique"]
    )
    def test_momentum_is_conserved_without_drive_and_damping(self, small, second):
        engine = Worlds(small, [[(-1.0, 0.3, 0.2), second]], free=True)
        qvel = engine.qvel()
        qvel[0, engine.qpos] = [[1.4, 0.2, 0.3], [-0.9, -0.7, -0.5]]

        def momenta():
            x, v = engine.poses[0], qvel[0, engine.qpos]
            spin = MASS * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]) + INERTIA * v[:, 2]
            energy = MASS * (v[:, :2] ** 2).sum() + INERTIA * (v[:, 2] ** 2).sum()
            return MASS * v[:, :2].sum(axis=0), spin.sum(), energy / 2

        linear, angular, energy = momenta()
        before = qvel[0].copy()
        touched = False
        for _ in range(12):
            touched |= engine.move(np.zeros((1, 2, 3)), 1).touching.any()
            now = momenta()
            np.testing.assert_allclose(now[0], linear, rtol=1e-9)
            np.testing.assert_allclose(now[1], angular, rtol=1e-9)
        assert touched and np.abs(qvel[0] - before).max() > 0.3
        assert now[2] < energy

    def test_walls_hold_robots_in(self, small):
        angle = np.arange(8) * np.pi / 4 + 0.1
        start = np.column_stack([5 * RD * np.cos(angle), 5 * RD * np.sin(angle), angle])[None]
        engine = Worlds(small, start)
        outward = np.stack([np.cos(angle), np.sin(angle), np.zeros(8)], axis=-1)[None]
        farthest = 0.0
        for _ in range(30):
            engine.move(np.sqrt(2) / 0.6 * outward, 10)
            farthest = max(farthest, *(np.abs(corners(p)).max() for p in engine.poses[0]))
        assert EDGE - 0.05 < farthest < EDGE + 0.3

    def test_contacts_are_the_touching_pairs(self, small):
        rng = np.random.default_rng(7)
        n = 30
        poses = np.dstack([rng.uniform(-6, 6, (4, n, 2)), rng.uniform(-np.pi, np.pi, (4, n))])
        touching = Worlds(small, poses).move(np.zeros(poses.shape), 1).touching
        for world in range(4):
            gap = {(i, j): separation(poses[world, i], poses[world, j]) for i in range(n) for j in range(i + 1, n)}
            assert min(abs(g) for g in gap.values()) > 1e-6
            expected = sorted(pair for pair, g in gap.items() if g < 0)
            assert len(expected) > 20
            assert [tuple(pair) for pair in np.argwhere(touching[world])] == expected

    def test_contacts_of_all_phases_count(self, small):
        """A robot comes, and another one goes."""
        engine = Worlds(small, [[(0, 0, 0), (2.05, 0, 0), (-2.3, 0, 0)]])
        come, go = np.zeros((2, 1, 3, 3))
        come[0, 0, 0], go[0, 0, 0] = 1.0, -2.0
        motion = engine.engine.move(engine.bodies, [Phase(2, lambda _: come), Phase(4, lambda _: go)], np.ones(1, bool))
        assert np.argwhere(motion.touching[0]).tolist() == [[0, 1], [0, 2]]

    def test_walls_are_no_robots(self, small):
        assert not Worlds(small, [[(EDGE - 0.9, 0, 0), (0, 0, 0)]]).move(np.zeros((1, 2, 3)), 1).touching.any()


class TestRays:
    def cast(self, engine, *rays):
        """Share and hit for rays (world, x, y, dx, dy, robot)."""
        world, x, y, dx, dy, robot = np.array(rays, float).T
        vectors = np.column_stack([x, y]), np.column_stack([dx, dy])
        return engine.cast_rays(world.astype(int), *vectors, robot.astype(int))

    def test_distances_by_hand(self, small):
        """A robot at the origin, one 6 mm east turned by 45 degrees, one 5 mm north."""
        engine = Worlds(small, [[(0, 0, 0), (6, 0, np.pi / 4), (0, 5, 0)]])
        share, hit = self.cast(
            engine,
            (0, 1, 0, 5, 0, 0),  # on to the corner, 6 - sqrt 2
            (0, 0, 1, 0, 4, 0),  # on to the flat side
            (0, 0, 1, 0, 2.999, 0),  # just too short: MuJoCo looks beyond the end of the vector
            (0, 1, 0.5, 10, 0, 0),  # the corner's flank, half a mm lower
            (0, -1, 0, -1, 0, 0),  # west: the wall
            (0, 0, -1, 3, -3, 0),  # south-east: the corner of two walls is far off
        )
        expected = [(5 - np.sqrt(2)) / 5, 3 / 4, 3 / 2.999, (5 - np.sqrt(2) + 0.5) / 10, EDGE - 1, (EDGE - 1) / 3]
        np.testing.assert_allclose(share, expected, rtol=1e-9)
        assert hit[:4].tolist() == [1, 2, 2, 1]
        assert (hit[4:] >= 3).all()

    def test_the_sender_is_ignored_and_nobody_else(self, small):
        engine = Worlds(small, [[(0, 0, 0), (6, 0, 0)]])
        share, hit = self.cast(engine, (0, 0, 0, 10, 0, 0), (0, 0, 0, 10, 0, 1), (0, 3, 0, -10, 0, 1))
        np.testing.assert_allclose(share[[0, 2]], [0.5, 0.2], rtol=1e-9)
        assert hit[0] == 1 and hit[1] != 1 and hit[2] == 0

    def test_each_wall_is_there(self, small):
        engine = Worlds(small, [[(2, 1, 0.3)]])
        share, hit = self.cast(engine, (0, 2, 1, 1, 0, 0), (0, 2, 1, 0, 1, 0), (0, 2, 1, -1, 0, 0), (0, 2, 1, 0, -1, 0))
        np.testing.assert_allclose(share, [EDGE - 2, EDGE - 1, EDGE + 2, EDGE + 1], rtol=1e-9)
        assert len(set(hit)) == 4 and (hit >= 1).all()

    def test_many_at_once_are_as_one_at_a_time(self, small):
        rng = np.random.default_rng(8)
        engine = Worlds(small, crowd(4, rng))
        world = rng.permutation(np.repeat([0, 1, 3], [17, 1, 40]))  # none in world 2
        origin, vector = rng.uniform(-10, 10, (58, 2)), rng.normal(size=(58, 2))
        robot = rng.integers(25, size=58)
        share, hit = engine.cast_rays(world, origin, vector, robot)
        for i in range(58):
            alone = engine.cast_rays(world[i : i + 1], origin[i : i + 1], vector[i : i + 1], robot[i : i + 1])
            assert (alone[0][0], alone[1][0]) == (share[i], hit[i])
        assert len(np.unique(hit)) > 15

    def test_none_at_all(self, small):
        none = np.zeros(0, int)
        share, hit = Worlds(small, [[(0, 0, 0)]]).cast_rays(none, np.zeros((0, 2)), np.zeros((0, 2)), none)
        assert len(share) == len(hit) == 0


def test_threads_do_not_matter(small):
    start = crowd(3, np.random.default_rng(9))
    ends = []
    for n_threads in (1, 2):
        engine, rng = Worlds(small, start, n_threads), np.random.default_rng(10)
        touching = [engine.move(rng.uniform(-2, 2, start.shape), 10).touching for _ in range(10)]
        ends.append((engine.poses, touching))
    np.testing.assert_array_equal(ends[0][0], ends[1][0])
    np.testing.assert_array_equal(ends[0][1], ends[1][1])
    assert ends[0][1][-1].any()


def test_each_world_is_its_own(small):
    start = crowd(3, np.random.default_rng(11))
    velocity = np.random.default_rng(12).uniform(-2, 2, start.shape)
    together = Worlds(small, start)
    together.move(velocity, 10)
    for w in range(3):
        alone = Worlds(small, start[w : w + 1])
        alone.move(velocity[w : w + 1], 10)
        np.testing.assert_array_equal(alone.poses[0], together.poses[w])


def test_places_beyond_the_robots_change_nothing(small):
    start, rng = crowd(2, np.random.default_rng(16)), np.random.default_rng(17)
    velocity = rng.uniform(-2, 2, start.shape)
    exact, roomy = Worlds(small, start), Worlds(small, start, capacity=40)
    sights = [worlds.sense() for worlds in (exact, roomy)]
    more = np.concatenate([velocity, np.full((2, 15, 3), np.nan)], axis=1)
    motions = [exact.move(velocity, 10), roomy.move(more, 10)]
    assert sights[0].links.valid.sum() > 40 and motions[0].touching.any()
    jax.tree.map(lambda a, b: np.testing.assert_array_equal(a, b[:, :25]), sights[0], sights[1])
    jax.tree.map(lambda b: np.testing.assert_array_equal(b[:, 25:], 0), sights[1])
    np.testing.assert_array_equal(exact.poses, roomy.poses[:, :25])
    assert not roomy.poses[:, 25:].any() and not motions[1].fault.any()
    np.testing.assert_array_equal(motions[0].touching, motions[1].touching[:, :25, :25])
    assert not motions[1].touching[:, 25:].any() and not motions[1].touching[:, :, 25:].any()


class TestAbsentRobots:
    """World 0 lacks robots 3 to 5, world 1 lacks none; those that are absent would be in the middle."""

    def worlds(self, small):
        start = np.zeros((2, 6, 3))
        start[0, :3] = [(-3.0, 0, 0), (3.0, 0, np.pi), (0.0, 6.0, 0.3)]
        start[1] = [(-3.0, 0, 0), (3.0, 0, np.pi), (0.0, 6.0, 0.3), (0, 0, 0), (8, 8, 0), (-8, 8, 0)]
        present = np.arange(6) < [[3], [6]]
        return Worlds(small, start, present=present), start

    def test_do_not_hide_anything(self, small):
        worlds, _ = self.worlds(small)
        links = worlds.sense().links
        assert links.valid[:, 0, 0].tolist() == [True, True] and links.sender[:, 0, 0].tolist() == [1, 3]

    def test_neither_send_nor_hear_nor_see(self, small):
        worlds, _ = self.worlds(small)
        sight = worlds.sense()
        assert not sight.links.valid[0, 3:].any() and not sight.sees_wall[0, 3:].any()
        assert (sight.links.sender[0][sight.links.valid[0]] < 3).all()

    def test_touch_nobody_and_do_not_move(self, small):
        """A robot walks through where they would be."""
        worlds, start = self.worlds(small)
        velocity = np.zeros((2, 6, 3))
        velocity[:, 0, 0], velocity[:, 1, 1] = 3.0, 9.0
        touched = np.zeros((2, 6, 6), bool)
        for _ in range(4):
            touched |= worlds.move(velocity, 5).touching
        np.testing.assert_allclose(worlds.poses[0, 0], [3.0, 0, 0], atol=1e-9)
        np.testing.assert_array_equal(worlds.poses[0, 2:], start[0, 2:])
        assert not touched[0].any() and np.argwhere(touched[1]).tolist() == [[0, 3]]

    def test_leave_a_world_as_if_it_had_never_had_them(self, small):
        start, rng = crowd(2, np.random.default_rng(18)), np.random.default_rng(19)
        start[0, 15:] = 0.0
        worlds, alone = Worlds(small, start, present=np.arange(25) < [[15], [25]]), Worlds(small, start[:1, :15])
        n_touching = 0
        for _ in range(10):
            velocity = rng.uniform(-2, 2, start.shape)
            velocity[0, 15:] = 0.0
            many, one = worlds.move(velocity, 10), alone.move(velocity[:1, :15], 10)
            np.testing.assert_allclose(worlds.poses[0, :15], alone.poses[0], atol=1e-9)
            np.testing.assert_array_equal(many.touching[0, :15, :15], one.touching[0])
            n_touching += one.touching.sum()
        assert n_touching > 5

    def test_may_be_present_when_the_robots_are_placed_again(self, small):
        worlds, start = self.worlds(small)
        worlds.present = np.ones((2, 6), bool)
        worlds.place(start[[1, 1]])
        velocity = np.zeros((2, 6, 3))
        velocity[:, 0, 0] = 3.0
        touching = worlds.move(velocity, 5).touching
        assert np.argwhere(touching[0]).tolist() == np.argwhere(touching[1]).tolist() == [[0, 3]]


class TestFaults:
    def test_a_world_that_fails_keeps_its_bodies_at_rest(self, small, tmp_path, monkeypatch):
        monkeypatch.chdir(tmp_path)  # MuJoCo logs to the working directory
        start = far_apart(3, np.random.default_rng(20))
        worlds, velocity = Worlds(small, start), np.ones(start.shape)
        worlds.engine._qpos[1, worlds.qpos[[4, 7], 0]] = np.nan
        motion = worlds.move(velocity, 4)
        assert motion.fault.tolist() == [0, FaultKind.POSE_NOT_FINITE, 0] and motion.robot[1] == 4
        np.testing.assert_array_equal(worlds.poses[1], start[1])
        np.testing.assert_allclose(worlds.poses[[0, 2]], start[[0, 2]] + 0.4, atol=1e-9)
        assert not worlds.qvel()[1].any()
        worlds.move(velocity, 4)
        np.testing.assert_allclose(worlds.poses[1], start[1] + 0.4, atol=1e-9)

    def test_an_error_of_mujoco_is_a_fault_of_its_world(self, small, monkeypatch):
        start = far_apart(3, np.random.default_rng(21))
        worlds = Worlds(small, start)
        batch = worlds.engine._batch

        class Failing:
            """World 2 fails."""

            def __getattr__(self, name):
                return getattr(batch, name)

            def step(self, ids, nstep):
                batch.step(ids=ids, nstep=nstep)
                raise mujoco_engine.SimulationError(np.array([2]), "no stack")

        monkeypatch.setattr(worlds.engine, "_batch", Failing())
        motion = worlds.move(np.ones(start.shape), 4)
        assert motion.fault.tolist() == [0, 0, FaultKind.SOLVER_FAILED]
        np.testing.assert_array_equal(worlds.poses[2], start[2])
        np.testing.assert_allclose(worlds.poses[:2], start[:2] + 0.4, atol=1e-9)


def test_the_other_solver_ends_a_jam_at_the_same_place(small, monkeypatch):
    """A world with more contacts than `JAM` is solved by conjugate gradients, the one beside it as before."""
    grid = np.stack(np.meshgrid(*[(np.arange(5) - 2) * 1.98] * 2), -1).reshape(1, 25, 2)
    apart = np.stack(np.meshgrid(*[(np.arange(5) - 2) * 6.0] * 2), -1).reshape(1, 25, 2)
    start = np.dstack([np.concatenate([grid, apart]), np.zeros((2, 25))])
    velocity = np.random.default_rng(15).uniform(-2, 2, start.shape)
    ends = []
    for jam in (10**6, 30):
        monkeypatch.setattr(mujoco_engine, "JAM", jam)
        worlds = Worlds(small, start)
        worlds.bodies = worlds.bodies._replace(n_contacts=np.array([99, 0]))
        worlds.move(velocity, 3)
        assert (worlds.bodies.n_contacts > 30).tolist() == [True, False]
        ends.append((worlds.poses, worlds.engine._solver.tolist()))
    (newton, usual), (gradients, mixed) = ends
    assert usual == [2, 2] and mixed == [1, 2]
    np.testing.assert_allclose(gradients[0], newton[0], atol=1e-4)
    assert not np.array_equal(gradients[0], newton[0])
    np.testing.assert_array_equal(gradients[1], newton[1])
