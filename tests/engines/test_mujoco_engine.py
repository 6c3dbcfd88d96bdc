"""The CPU engine: servos, contacts, rays, conservation laws, threads. Units: mm, mg, s."""

from dataclasses import replace

import numpy as np
import pytest

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mujoco import engine as mujoco_batch
from iswarm_mj.engines.mujoco.engine import MujocoBatchEngine
from iswarm_mj.utils.units import RD

EDGE = 7.5 * RD  # of the small arena, from its middle
MASS, INERTIA = 10.0, 10.0 * (2**2 + 2**2) / 12


def engine_of(config, poses, n_threads=1, free=False):
    """Engine with robots at rest at (B, N, 3); `free` takes drive and damping off."""
    poses = np.asarray(poses, float)
    arena = compile_arena(config, poses.shape[1], np.full(3, 20e-6))
    if free:
        arena.model.dof_damping[:] = 0.0
    engine = MujocoBatchEngine(arena, len(poses), n_threads)
    engine.reset(poses, np.zeros((len(poses), 3, 3)))
    return engine


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
        engine = engine_of(small, start)
        velocity = rng.uniform(-1.5, 1.5, start.shape)
        engine.advance(velocity, 7, np.arange(2))
        np.testing.assert_allclose(engine.poses(), start + 0.7 * velocity, atol=1e-9)

    def test_walking_along_the_heading_does_not_slip_sideways(self, small):
        start = far_apart(1, np.random.default_rng(2))
        engine = engine_of(small, start)
        yaw = start[..., 2]
        ahead = np.stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)], axis=-1)
        for _ in range(3):
            engine.advance(np.sqrt(2) * ahead, 6, np.arange(1))
        moved = engine.poses() - start
        np.testing.assert_allclose((moved * ahead).sum(-1), 3 * 0.6 * np.sqrt(2), atol=1e-6)
        np.testing.assert_allclose(moved[..., 1] * ahead[..., 0] - moved[..., 0] * ahead[..., 1], 0, atol=1e-6)
        np.testing.assert_allclose(moved[..., 2], 0, atol=1e-9)

    def test_a_command_leaves_nothing_behind(self, small):
        start = far_apart(1, np.random.default_rng(3))
        engine = engine_of(small, start)
        engine.advance(np.full(start.shape, 1.0), 3, np.arange(1))
        there = engine.poses()
        engine.advance(np.zeros(start.shape), 5, np.arange(1))
        np.testing.assert_allclose(engine.poses(), there, atol=1e-9)

    def test_worlds_not_listed_stand_still(self, small):
        start = far_apart(3, np.random.default_rng(4))
        engine = engine_of(small, start)
        engine.advance(np.full(start.shape, 1.0), 4, np.array([0, 2]))
        np.testing.assert_array_equal(engine.poses()[1], start[1])
        np.testing.assert_allclose(engine.poses()[[0, 2]], start[[0, 2]] + 0.4, atol=1e-9)

    def test_any_time_step(self, small):
        config = replace(small, drive=replace(small.drive, turn_substeps=8, walk_substeps=17, control_period=0.5))
        start = far_apart(1, np.random.default_rng(5))
        engine = engine_of(config, start)
        engine.advance(np.full(start.shape, 1.0), 17, np.arange(1))
        np.testing.assert_allclose(engine.poses(), start + 17 * 0.02, atol=1e-9)

    def test_reset_puts_robots_at_rest(self, small):
        start = far_apart(1, np.random.default_rng(6))
        engine = engine_of(small, start)
        engine.advance(np.full(start.shape, 1.0), 3, np.arange(1))
        engine.reset(start, np.zeros((1, 3, 3)))
        np.testing.assert_array_equal(engine.poses(), start)
        assert not engine._batch.bind("qvel").any()


class TestCollisions:
    @pytest.mark.parametrize(
        "second", [(2.5, 0.0, 0.0), (2.6, 0.7, 0.4), (1.5, 2.2, 0.8)], ids=["head-on", "corner", "oblique"]
    )
    def test_momentum_is_conserved_without_drive_and_damping(self, small, second):
        engine = engine_of(small, [[(-1.0, 0.3, 0.2), second]], free=True)
        qvel = engine._batch.bind("qvel")
        qvel[0, engine._arena.qpos] = [[1.4, 0.2, 0.3], [-0.9, -0.7, -0.5]]

        def momenta():
            x, v = engine.poses()[0], qvel[0, engine._arena.qpos]
            spin = MASS * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]) + INERTIA * v[:, 2]
            energy = MASS * (v[:, :2] ** 2).sum() + INERTIA * (v[:, 2] ** 2).sum()
            return MASS * v[:, :2].sum(axis=0), spin.sum(), energy / 2

        linear, angular, energy = momenta()
        before = qvel[0].copy()
        touched = False
        for _ in range(12):
            engine.advance(np.zeros((1, 2, 3)), 1, np.arange(1))
            touched |= len(engine.contacts(0)) > 0
            now = momenta()
            np.testing.assert_allclose(now[0], linear, rtol=1e-9)
            np.testing.assert_allclose(now[1], angular, rtol=1e-9)
        assert touched and np.abs(qvel[0] - before).max() > 0.3
        assert now[2] < energy

    def test_walls_hold_robots_in(self, small):
        angle = np.arange(8) * np.pi / 4 + 0.1
        start = np.column_stack([5 * RD * np.cos(angle), 5 * RD * np.sin(angle), angle])[None]
        engine = engine_of(small, start)
        outward = np.stack([np.cos(angle), np.sin(angle), np.zeros(8)], axis=-1)[None]
        farthest = 0.0
        for _ in range(30):
            engine.advance(np.sqrt(2) / 0.6 * outward, 10, np.arange(1))
            farthest = max(farthest, *(np.abs(corners(p)).max() for p in engine.poses()[0]))
        assert EDGE - 0.05 < farthest < EDGE + 0.3

    def test_contacts_are_the_touching_pairs(self, small):
        rng = np.random.default_rng(7)
        n = 30
        poses = np.dstack([rng.uniform(-6, 6, (4, n, 2)), rng.uniform(-np.pi, np.pi, (4, n))])
        engine = engine_of(small, poses)
        for world in range(4):
            gap = {i * n + j: separation(poses[world, i], poses[world, j]) for i in range(n) for j in range(i + 1, n)}
            assert min(abs(g) for g in gap.values()) > 1e-6
            touching = sorted(key for key, g in gap.items() if g < 0)
            assert len(touching) > 20
            assert sorted(set(engine.contacts(world).tolist())) == touching

    def test_walls_are_no_robots(self, small):
        engine = engine_of(small, [[(EDGE - 0.9, 0, 0), (0, 0, 0)]])
        assert engine.contacts(0).tolist() == []


class TestRays:
    def cast(self, engine, *rays):
        """Share and hit for rays (world, x, y, dx, dy, robot)."""
        world, x, y, dx, dy, robot = np.array(rays, float).T
        vectors = np.column_stack([x, y]), np.column_stack([dx, dy])
        return engine.cast_rays(world.astype(int), *vectors, robot.astype(int))

    def test_distances_by_hand(self, small):
        """A robot at the origin, one 6 mm east turned by 45 degrees, one 5 mm north."""
        engine = engine_of(small, [[(0, 0, 0), (6, 0, np.pi / 4), (0, 5, 0)]])
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
        engine = engine_of(small, [[(0, 0, 0), (6, 0, 0)]])
        share, hit = self.cast(engine, (0, 0, 0, 10, 0, 0), (0, 0, 0, 10, 0, 1), (0, 3, 0, -10, 0, 1))
        np.testing.assert_allclose(share[[0, 2]], [0.5, 0.2], rtol=1e-9)
        assert hit[0] == 1 and hit[1] != 1 and hit[2] == 0

    def test_each_wall_is_there(self, small):
        engine = engine_of(small, [[(2, 1, 0.3)]])
        share, hit = self.cast(engine, (0, 2, 1, 1, 0, 0), (0, 2, 1, 0, 1, 0), (0, 2, 1, -1, 0, 0), (0, 2, 1, 0, -1, 0))
        np.testing.assert_allclose(share, [EDGE - 2, EDGE - 1, EDGE + 2, EDGE + 1], rtol=1e-9)
        assert len(set(hit)) == 4 and (hit >= 1).all()

    def test_balls_do_not_stop_light(self, small):
        engine = engine_of(small, [[(0, 0, 0), (6, 0, 0)]])
        engine.move_balls(np.full((1, 3, 3), [3.0, 0.0, 0.5]))
        engine._batch.forward()
        share, hit = self.cast(engine, (0, 1, 0, 4, 0, 0))
        np.testing.assert_allclose(share, 1.0, rtol=1e-9)
        assert hit == [1]

    def test_many_at_once_are_as_one_at_a_time(self, small):
        rng = np.random.default_rng(8)
        engine = engine_of(small, crowd(4, rng))
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
        share, hit = engine_of(small, [[(0, 0, 0)]]).cast_rays(none, np.zeros((0, 2)), np.zeros((0, 2)), none)
        assert len(share) == len(hit) == 0


def test_threads_do_not_matter(small):
    start = crowd(3, np.random.default_rng(9))
    ends = []
    for n_threads in (1, 2):
        engine, rng = engine_of(small, start, n_threads), np.random.default_rng(10)
        for _ in range(10):
            engine.advance(rng.uniform(-2, 2, start.shape), 10, np.arange(3))
        ends.append((engine.poses(), [engine.contacts(w).tolist() for w in range(3)]))
    np.testing.assert_array_equal(ends[0][0], ends[1][0])
    assert ends[0][1] == ends[1][1] and sum(map(len, ends[0][1])) > 0


def test_each_world_is_its_own(small):
    start = crowd(3, np.random.default_rng(11))
    velocity = np.random.default_rng(12).uniform(-2, 2, start.shape)
    together = engine_of(small, start)
    together.advance(velocity, 10, np.arange(3))
    for w in range(3):
        alone = engine_of(small, start[w : w + 1])
        alone.advance(velocity[w : w + 1], 10, np.arange(1))
        np.testing.assert_array_equal(alone.poses()[0], together.poses()[w])


def test_balls_go_where_they_are_put(small):
    engine = engine_of(small, far_apart(2, np.random.default_rng(13)))
    balls = np.random.default_rng(14).uniform(-9, 9, (2, 3, 3))
    engine.move_balls(balls)
    engine.advance(np.zeros((2, 9, 3)), 1, np.arange(2))
    model = engine._arena.model
    bodies = [model.body(f"ball{k}/ball").id for k in range(3)]
    for world in range(2):
        data = engine._batch.get_data(world, engine._scratch)
        np.testing.assert_array_equal(data.xpos[bodies], balls[world])


def test_the_other_solver_ends_a_jam_at_the_same_place(small, monkeypatch):
    """A world with more contacts than `JAM` is solved by conjugate gradients, the one beside it as before."""
    grid = np.stack(np.meshgrid(*[(np.arange(5) - 2) * 1.98] * 2), -1).reshape(1, 25, 2)
    apart = np.stack(np.meshgrid(*[(np.arange(5) - 2) * 6.0] * 2), -1).reshape(1, 25, 2)
    start = np.dstack([np.concatenate([grid, apart]), np.zeros((2, 25))])
    velocity = np.random.default_rng(15).uniform(-2, 2, start.shape)
    ends = []
    for jam in (10**6, 30):
        monkeypatch.setattr(mujoco_batch, "JAM", jam)
        engine = engine_of(small, start)
        for world in range(2):
            engine.contacts(world)
        engine.advance(velocity, 3, np.arange(2))
        ends.append((engine.poses(), engine._solver.tolist()))
    (newton, usual), (gradients, mixed) = ends
    assert usual == [2, 2] and mixed == [1, 2]
    np.testing.assert_allclose(gradients[0], newton[0], atol=1e-4)
    assert not np.array_equal(gradients[0], newton[0])
    np.testing.assert_array_equal(gradients[1], newton[1])
