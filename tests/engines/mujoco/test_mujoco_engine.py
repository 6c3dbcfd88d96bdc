"""The CPU engine: servos, contacts, rays, conservation laws, absent robots, faults, threads. Units: mm, mg, s."""

from dataclasses import replace

import numpy as np
import pytest
from support.mujoco import EDGE, INERTIA, MASS, Worlds, corners, far_apart, separation
from support.touching import pairs_of

from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.mujoco import engine as mujoco_engine
from iswarm_mj.utils.units import RD


class TestServo:
    def test_robots_move_as_commanded(self, small):
        rng = np.random.default_rng(1)
        start = far_apart(2, rng)
        engine = Worlds(small, start)
        velocity = rng.uniform(-1.5, 1.5, start.shape)
        engine.move(velocity, 7)
        np.testing.assert_allclose(engine.poses, start + 0.7 * velocity, atol=1e-9)

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
        engine.qvel()[0, engine.qpos] = [[1.4, 0.2, 0.3], [-0.9, -0.7, -0.5]]

        def momenta():
            x, v = engine.poses[0], engine.qvel()[0, engine.qpos]
            spin = MASS * (x[:, 0] * v[:, 1] - x[:, 1] * v[:, 0]) + INERTIA * v[:, 2]
            energy = MASS * (v[:, :2] ** 2).sum() + INERTIA * (v[:, 2] ** 2).sum()
            return MASS * v[:, :2].sum(axis=0), spin.sum(), energy / 2

        linear, angular, energy = momenta()
        before = engine.qvel()[0].copy()
        touched = False
        for _ in range(12):
            touched |= engine.move(np.zeros((1, 2, 3)), 1).touching.any()
            now = momenta()
            np.testing.assert_allclose(now[0], linear, rtol=1e-9)
            np.testing.assert_allclose(now[1], angular, rtol=1e-9)
        assert touched and np.abs(engine.qvel()[0] - before).max() > 0.3
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
            assert [tuple(pair) for pair in np.argwhere(pairs_of(touching[world]))] == expected

    def test_contacts_of_all_phases_count(self, small):
        """A robot comes, and another one goes."""
        engine = Worlds(small, [[(0, 0, 0), (2.05, 0, 0), (-2.3, 0, 0)]])
        come, go = np.zeros((2, 1, 3, 3))
        come[0, 0, 0], go[0, 0, 0] = 1.0, -2.0
        motion = engine.engine.move(engine.bodies, [Phase(2, lambda _: come), Phase(4, lambda _: go)], np.ones(1, bool))
        assert np.argwhere(pairs_of(motion.touching[0])).tolist() == [[0, 1], [0, 2]]


@pytest.mark.parametrize("wall_range", [0.0, 1e-320, 0.05])
def test_walls_are_seen_from_within_them_at_any_range(small, wall_range):
    """A robot that is pressed into the east wall by 10 um sees it, one 0.3 mm away from it does not."""
    config = replace(small, optics=replace(small.optics, wall_range=wall_range))
    worlds = Worlds(config, [[(EDGE - 0.99, 0, 0), (EDGE - 1.3, 4, 0), (0, 0, 0)]])
    sees = worlds.sense().sees_wall[0]
    assert sees[0].tolist() == [True, False, False, False] and not sees[1:].any()


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
