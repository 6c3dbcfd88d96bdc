"""MuJoCo in C: servos, conservation laws, contacts, walls, jams. Units: mm, mg, s."""

from dataclasses import replace

import numpy as np
import pytest
from support.mujoco import (
    EDGE,
    INERTIA,
    MASS,
    Worlds,
    corners,
    far_apart,
    separation,
    solvers_of,
)
from support.touching import pairs_of

from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.contact_geometry import TOUCHING
from iswarm_mj.engines.mujoco import engine as mujoco_engine
from iswarm_mj.utils.units import RD

TIME_STEP = 0.1
NEWTON = 2
CONJUGATE_GRADIENTS = 1
"""Numbers of MuJoCo's solvers."""


def grid_of_robots(distance):
    """Return poses (25, 3) of five by five robots."""
    places = (np.arange(5) - 2) * distance
    xy = np.stack(np.meshgrid(places, places), -1).reshape(25, 2)
    return np.column_stack([xy, np.zeros(25)])


def test_robots_move_as_commanded(small):
    rng = np.random.default_rng(1)
    start = far_apart(2, rng)
    worlds = Worlds(small, start)
    velocity = rng.uniform(-1.5, 1.5, start.shape)
    worlds.move(velocity, 7)
    np.testing.assert_allclose(worlds.poses, start + 7 * TIME_STEP * velocity, atol=1e-9)


def test_robots_are_placed_at_rest(small):
    start = far_apart(1, np.random.default_rng(6))
    worlds = Worlds(small, start)
    worlds.move(np.full(start.shape, 1.0), 3)
    worlds.place(start)
    np.testing.assert_array_equal(worlds.poses, start)
    assert not worlds.qvel().any()


def momenta(poses, velocity):
    """Return the linear momentum (2,), angular momentum and kinetic energy of robots."""
    linear = MASS * velocity[:, :2].sum(axis=0)
    orbital = poses[:, 0] * velocity[:, 1] - poses[:, 1] * velocity[:, 0]
    angular = MASS * orbital + INERTIA * velocity[:, 2]
    energy = MASS * (velocity[:, :2] ** 2).sum() + INERTIA * (velocity[:, 2] ** 2).sum()
    return linear, angular.sum(), energy / 2


@pytest.mark.parametrize(
    "second",
    [(2.5, 0.0, 0.0), (2.6, 0.7, 0.4), (1.5, 2.2, 0.8)],
    ids=["head-on", "corner", "oblique"],
)
def test_momentum_is_conserved_without_drive_and_damping(small, second):
    worlds = Worlds(small, [[(-1.0, 0.3, 0.2), second]], free=True)
    worlds.qvel()[0, worlds.joints] = [[1.4, 0.2, 0.3], [-0.9, -0.7, -0.5]]
    start_velocity = worlds.qvel()[0].copy()
    velocity = worlds.qvel()[0, worlds.joints]
    start_linear, start_angular, start_energy = momenta(worlds.poses[0], velocity)

    no_targets = np.zeros((1, 2, 3))
    energy = start_energy
    for _ in range(12):
        worlds.move(no_targets, 1)
        velocity = worlds.qvel()[0, worlds.joints]
        linear, angular, energy = momenta(worlds.poses[0], velocity)
        np.testing.assert_allclose(linear, start_linear, rtol=1e-9)
        np.testing.assert_allclose(angular, start_angular, rtol=1e-9)

    assert np.abs(worlds.qvel()[0] - start_velocity).max() > 0.3
    assert energy < start_energy


def test_walls_hold_robots_in(small):
    angle = np.arange(8) * np.pi / 4 + 0.1
    outward = np.stack([np.cos(angle), np.sin(angle), np.zeros(8)], axis=-1)
    start = 5 * RD * outward
    start[:, 2] = angle
    worlds = Worlds(small, start[None])

    farthest = 0.0
    for _ in range(30):
        worlds.move(np.sqrt(2) / 0.6 * outward[None], 10)
        for pose in worlds.poses[0]:
            farthest = max(farthest, np.abs(corners(pose)).max())
    assert EDGE - 0.05 < farthest < EDGE + 0.05


def test_pairs_touch_that_push_each_other_at_a_small_distance(small):
    """Pairs of robots at random gaps, half of which approach each other and half of which part."""
    rng = np.random.default_rng(7)
    n_pairs = 9
    n_worlds = 20
    first = np.tile(far_apart(1, rng)[0], (n_worlds, 1, 1))
    first[..., 2] = 0.0
    offset = rng.uniform([2.0, -0.5, -0.3], [2.6, 0.5, 0.3], first.shape)
    speed = np.where(rng.random((n_worlds, n_pairs)) < 0.5, 1.4, -1.4)
    poses = np.concatenate([first, first + offset], axis=1)
    velocity = np.zeros(poses.shape)
    velocity[..., 0] = np.concatenate([speed, -speed], axis=1)
    worlds = Worlds(small, poses, refinement=1)
    touching = pairs_of(worlds.move(velocity, 1).touching)

    expected = np.zeros(touching.shape, bool)
    for world in range(n_worlds):
        for pair in range(n_pairs):
            second = n_pairs + pair
            gap = separation(poses[world, pair], poses[world, second])
            expected[world, pair, second] = speed[world, pair] > 0 and gap <= TOUCHING
    np.testing.assert_array_equal(touching, expected)
    assert expected.sum() > 20


def test_contacts_of_all_phases_count(small):
    """Robot 1 comes, and robot 2 goes."""
    worlds = Worlds(small, [[(0, 0, 0), (2.05, 0, 0), (-2.3, 0, 0)]])
    come = np.zeros((1, 3, 3))
    come[0, 0, 0] = 1.0
    go = -2 * come
    phases = [Phase(2, lambda _: come), Phase(8, lambda _: go)]
    motion = worlds.engine.move(worlds.bodies, phases, np.ones(1, bool))
    assert np.argwhere(pairs_of(motion.touching[0])).tolist() == [[0, 1], [0, 2]]


@pytest.mark.parametrize("wall_range", [0.0, 1e-320, 0.05])
def test_walls_are_seen_from_within_them_at_any_range(small, wall_range):
    """A robot that is pressed into the east wall by 10 um sees it, one 0.3 mm away does not."""
    config = replace(small, optics=replace(small.optics, wall_range=wall_range))
    worlds = Worlds(config, [[(EDGE - 0.99, 0, 0), (EDGE - 1.3, 4, 0), (0, 0, 0)]])
    sees_wall = worlds.sense().sees_wall[0]
    assert sees_wall[0].tolist() == [True, False, False, False]
    assert not sees_wall[1:].any()


def test_the_other_solver_ends_a_jam_at_the_same_place(small, monkeypatch):
    """A world with more contacts than `JAM` is solved by conjugate gradients.

    The world beside it is solved as before.
    """
    start = np.stack([grid_of_robots(1.98), grid_of_robots(6.0)])
    velocity = np.random.default_rng(15).uniform(-2, 2, start.shape)

    def move_with(jam):
        """Return poses after some steps, and the solver of each world."""
        monkeypatch.setattr(mujoco_engine, "JAM", jam)
        worlds = Worlds(small, start)
        worlds.bodies = worlds.bodies._replace(n_contacts=np.array([99, 0]))
        worlds.move(velocity, 3)
        assert (worlds.bodies.n_contacts > 30).tolist() == [True, False]
        return worlds.poses, solvers_of(worlds.engine)

    by_newton, solvers = move_with(jam=10**6)
    assert solvers == [NEWTON, NEWTON]
    by_gradients, solvers = move_with(jam=30)
    assert solvers == [CONJUGATE_GRADIENTS, NEWTON]
    np.testing.assert_allclose(by_gradients[0], by_newton[0], atol=1e-4)
    assert not np.array_equal(by_gradients[0], by_newton[0])
    np.testing.assert_array_equal(by_gradients[1], by_newton[1])
