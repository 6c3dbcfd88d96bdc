"""Faults of both planar engines: they end their world alone, and none goes unnoticed. Units: mm."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from support.planar import both_engines, moved, placed, rounded
from support.small import SMALL
from support.touching import pairs_of

from iswarm_mj.engines.planar.gpu.physics import rooms
from iswarm_mj.utils.errors import FaultKind

FULL = FaultKind.TOO_MANY_PAIRS | FaultKind.TOO_MANY_CONTACTS


@cache
def engines(**changes):
    return both_engines(SMALL, **changes)


BOTH = pytest.mark.parametrize("which", [0, 1], ids=["numba", "warp"])


@BOTH
def test_poses_that_are_lost(which):
    """A robot that is nowhere, one that escapes, and a world that goes on; bodies of the faulty ones stay."""
    start = np.tile([(0.0, 0.0, 0.0), (6.0, 0.0, 0.0)], (3, 1, 1))
    start[0, 1, 0] = np.nan
    velocity = np.full((3, 2, 3), 0.5)
    velocity[1, 1, 0] = 500.0
    engine = engines()[which]
    motion = moved(engine, placed(engine, start), velocity)
    assert motion.fault.tolist() == [FaultKind.POSE_NOT_FINITE, FaultKind.OUTSIDE, 0]
    assert motion.robot[:2].tolist() == [1, 1]
    np.testing.assert_array_equal(motion.bodies.poses[:2], start[:2])
    np.testing.assert_allclose(motion.bodies.poses[2], start[2] + 0.5, atol=1e-5)


def test_who_is_absent_cannot_be_lost():
    _, engine = engines()
    bodies = placed(engine, [[(0, 0, 0), (np.nan, 0, 0), (1e3, 0, 0)]], np.array([[True, False, False]]))
    motion = moved(engine, bodies, 0.5)
    assert motion.fault.tolist() == [0]
    np.testing.assert_allclose(motion.bodies.poses[0, 0], 0.5, atol=1e-6)


@BOTH
def test_sweeps_that_do_not_suffice(which):
    engine = engines(max_sweeps=1)[which]
    apart, heap = [(-6.0, 0, 0), (0, 0, 0), (6, 0, 0)], [(0.0, 0, 0), (1.9, 0.5, 0), (3.8, 0, 0)]
    motion = moved(engine, placed(engine, rounded([apart, heap])), [0.5, 0, 0])
    assert motion.fault.tolist() == [0, FaultKind.SOLVER_FAILED]
    np.testing.assert_array_equal(motion.bodies.poses[1], rounded(heap))
    np.testing.assert_allclose(motion.bodies.poses[0], apart + np.array([0.5, 0, 0]), atol=1e-5)


class TestHeaps:
    """Robots on the same 0.6 mm, of whom all pairs touch, and others that stand apart."""

    def start(self, n_heaped, n_robots):
        """Worlds: all apart, and a heap in the middle."""
        rng = np.random.default_rng(1)
        grid = np.stack(np.meshgrid(np.arange(-18, 19, 3.0), [-18, -15, -12, 12, 15, 18]), -1).reshape(-1, 2)
        start = np.zeros((2, n_robots, 3))
        start[..., :2] = grid[:n_robots]
        start[1, :n_heaped, :2] = rng.uniform(-0.3, 0.3, (n_heaped, 2))
        start[1, :n_heaped, 2] = rng.uniform(-3, 3, n_heaped)
        return rounded(start)

    @pytest.mark.parametrize(("n_heaped", "n_robots"), [(14, 20), (20, 20)])
    def test_lists_with_room_for_all_pairs(self, n_heaped, n_robots):
        start = self.start(n_heaped, n_robots)
        plain, batch = (moved(engine, placed(engine, start), 0.0, 3) for engine in engines())
        assert batch.fault.tolist() == [0, 0]
        np.testing.assert_allclose(batch.bodies.poses, plain.bodies.poses, atol=1e-3)
        np.testing.assert_array_equal(batch.touching, plain.touching)
        assert pairs_of(plain.touching[1]).sum() > 40

    @pytest.mark.parametrize(
        ("n_heaped", "n_robots", "kind"),
        [(38, 60, FaultKind.TOO_MANY_CONTACTS), (60, 60, FULL)],
        ids=["contacts", "pairs and contacts"],
    )
    def test_full_lists_are_faults_of_their_world(self, n_heaped, n_robots, kind):
        start = self.start(n_heaped, n_robots)
        _, engine = engines()
        motion = moved(engine, placed(engine, start[[1, 0, 1]]), 0.5, 3)
        assert [fault & FULL for fault in motion.fault.tolist()] == [kind, 0, kind] and motion.fault[1] == 0
        np.testing.assert_array_equal(motion.bodies.poses[::2], start[[1, 1]])
        np.testing.assert_allclose(motion.bodies.poses[1], start[0] + 0.15, atol=1e-5)
        assert not motion.touching[1].any()


def test_room_for_contacts_with_obstacles():
    """As many as four a robot; heaps of more obstacles on one place are a fault of their world alone."""
    assert rooms(40, 0, 4, 0, 1)[1] + 40 == rooms(40, 0, 4, 1, 1)[1] == rooms(40, 0, 5, 0, 1)[1]
    assert rooms(40, 0, 4, 4, 1) == rooms(40, 0, 4, 9, 1)
    boxes = ((4.0 + 0.01 * k, 4.0, 1.0, 1.0, 0.0) for k in range(30))
    start = np.tile([(9.0, 9.0, 0.1), (9.0, 9.0, 0.2), (-8.0, -8.0, 0.0)], (2, 1, 1))
    start[0, :2] = [(-8.0, 8.0, 0.0), (8.0, -8.0, 0.0)]
    arena = replace(SMALL.arena, obstacles=tuple(boxes), dust_area_size=2, dust_area_offset=5.5, n_dust=2)
    _, batch = both_engines(replace(SMALL, arena=arena))
    motion = moved(batch, placed(batch, start), 0.1, 2)
    assert motion.fault[0] == 0 and motion.fault[1] & FaultKind.TOO_MANY_CONTACTS
