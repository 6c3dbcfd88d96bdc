"""Worlds of a batch in C: independent, with empty places, and with faults."""

import numpy as np
from support.mujoco import Worlds, fail_steps, far_apart, spoil
from support.touching import pairs_of

from iswarm_mj.utils.errors import FaultKind

DISTANCE = 0.4
"""Distance walked in four physics steps at 1 mm/s [mm]."""


def test_absent_robots_may_be_present_when_they_are_placed_again(small):
    """Robot 3 stands between robots 0 and 1, and is absent from the first world at first."""
    rows = [(-3.0, 0, 0), (3.0, 0, np.pi), (0.0, 6.0, 0.3), (0, 0, 0), (8, 8, 0), (-8, 8, 0)]
    start = np.tile(np.array(rows), (2, 1, 1))
    worlds = Worlds(small, start, present=np.arange(6) < [[3], [6]])
    worlds.present = np.ones((2, 6), bool)
    worlds.place(start)

    velocity = np.zeros((2, 6, 3))
    velocity[:, 0, 0] = 3.0
    touching = pairs_of(worlds.move(velocity, 5).touching)
    for pairs in touching:
        assert np.argwhere(pairs).tolist() == [[0, 3]]


def test_worlds_that_do_not_run_are_not_sensed(small):
    worlds = Worlds(small, [[(0, 0, 0), (6.0, 0, np.pi)]] * 2)
    everyone = np.ones((2, 2), bool)
    reading = worlds.engine.sense(worlds.bodies, everyone, np.array([False, True]))
    assert reading.links.valid.sum(axis=(1, 2)).tolist() == [0, 2]


def test_a_world_that_fails_keeps_its_bodies_at_rest(small, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    start = far_apart(3, np.random.default_rng(20))
    worlds = Worlds(small, start)
    velocity = np.ones(start.shape)
    spoil(worlds.engine, 1, [4, 7], np.nan)
    motion = worlds.move(velocity, 4)
    assert motion.fault.tolist() == [0, FaultKind.POSE_NOT_FINITE, 0]
    assert motion.robot[1] == 4
    np.testing.assert_array_equal(worlds.poses[1], start[1])
    np.testing.assert_allclose(worlds.poses[[0, 2]], start[[0, 2]] + DISTANCE, atol=1e-9)
    assert not worlds.qvel()[1].any()

    worlds.move(velocity, 4)
    np.testing.assert_allclose(worlds.poses[1], start[1] + DISTANCE, atol=1e-9)
    assert not list(tmp_path.iterdir())  # MuJoCo wrote no log into the working directory


def test_an_error_of_mujoco_is_a_fault_of_its_world(small, monkeypatch):
    start = far_apart(3, np.random.default_rng(21))
    worlds = Worlds(small, start)
    fail_steps(monkeypatch, worlds.engine, 2)
    motion = worlds.move(np.ones(start.shape), 4)
    assert motion.fault.tolist() == [0, 0, FaultKind.SOLVER_FAILED]
    np.testing.assert_array_equal(worlds.poses[2], start[2])
    np.testing.assert_allclose(worlds.poses[:2], start[:2] + DISTANCE, atol=1e-9)
