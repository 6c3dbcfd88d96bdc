"""Faults of both planar engines, which end their own world alone. Units: mm, s."""

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
ENGINE_INDEX = pytest.mark.parametrize("engine_index", [0, 1], ids=["numba", "warp"])
"""Index in the result of `engines`."""
CONTROL_STEP = 1.0
"""Duration of `moved` by default, ten physics steps [s]."""


@cache
def engines(**changes):
    return both_engines(SMALL, **changes)


class TestPoses:
    @ENGINE_INDEX
    def test_a_robot_that_is_nowhere_or_escapes_ends_its_world_alone(self, engine_index):
        start = np.tile([(0.0, 0.0, 0.0), (6.0, 0.0, 0.0)], (3, 1, 1))
        start[0, 1, 0] = np.nan
        velocity = np.full((3, 2, 3), 0.5)
        velocity[1, 1, 0] = 500.0
        engine = engines()[engine_index]
        motion = moved(engine, placed(engine, start), velocity)
        assert motion.fault.tolist() == [FaultKind.POSE_NOT_FINITE, FaultKind.OUTSIDE, 0]
        assert motion.robot[:2].tolist() == [1, 1]

        # Bodies of the faulty worlds stay where they were.
        np.testing.assert_array_equal(motion.bodies.poses[:2], start[:2])
        expected = start[2] + 0.5 * CONTROL_STEP
        np.testing.assert_allclose(motion.bodies.poses[2], expected, atol=1e-5)

    def test_absent_robots_cannot_be_lost(self):
        _, engine = engines()
        start = [[(0, 0, 0), (np.nan, 0, 0), (1e3, 0, 0)]]
        present = np.array([[True, False, False]])
        motion = moved(engine, placed(engine, start, present), 0.5)
        assert motion.fault.tolist() == [0]
        np.testing.assert_allclose(motion.bodies.poses[0, 0], 0.5 * CONTROL_STEP, atol=1e-6)


@ENGINE_INDEX
def test_sweeps_that_do_not_suffice_are_a_fault(engine_index):
    engine = engines(max_sweeps=1)[engine_index]
    apart = [(-6.0, 0, 0), (0, 0, 0), (6, 0, 0)]
    heap = [(0.0, 0, 0), (1.9, 0.5, 0), (3.8, 0, 0)]
    motion = moved(engine, placed(engine, rounded([apart, heap])), [0.5, 0, 0])
    assert motion.fault.tolist() == [0, FaultKind.SOLVER_FAILED]
    np.testing.assert_array_equal(motion.bodies.poses[1], rounded(heap))
    expected = apart + np.array([0.5 * CONTROL_STEP, 0, 0])
    np.testing.assert_allclose(motion.bodies.poses[0], expected, atol=1e-5)


class TestHeaps:
    """Robots on the same 0.6 mm, of whom all pairs touch, and others that stand apart."""

    def start(self, n_heaped, n_robots):
        """Return poses of two worlds: all apart, and a heap in the middle."""
        rng = np.random.default_rng(1)
        columns = np.arange(-18, 19, 3.0)
        rows = [-18, -15, -12, 12, 15, 18]
        grid = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
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
        assert pairs_of(plain.touching[1]).sum() > 20

    @pytest.mark.parametrize(
        ("n_heaped", "n_robots", "fault"),
        [(38, 60, FaultKind.TOO_MANY_CONTACTS), (60, 60, FULL)],
        ids=["contacts", "pairs and contacts"],
    )
    def test_full_lists_are_faults_of_their_world(self, n_heaped, n_robots, fault):
        start = self.start(n_heaped, n_robots)
        apart, heap = start
        _, engine = engines()
        motion = moved(engine, placed(engine, np.stack([heap, apart, heap])), 0.5, 3)
        assert [bits & FULL for bits in motion.fault.tolist()] == [fault, 0, fault]
        assert motion.fault[1] == 0
        assert not motion.touching[1].any()
        np.testing.assert_array_equal(motion.bodies.poses[::2], [heap, heap])
        np.testing.assert_allclose(motion.bodies.poses[1], apart + 0.5 * 0.3, atol=1e-5)


class TestObstacles:
    def test_there_is_room_for_contacts_with_four_obstacles_a_robot(self):
        def room_for_contacts(n_walls, n_obstacles):
            return rooms(40, 0, n_walls, n_obstacles, 1)[1]

        four_walls = room_for_contacts(4, 0)
        assert four_walls + 40 == room_for_contacts(4, 1) == room_for_contacts(5, 0)
        assert room_for_contacts(4, 4) == room_for_contacts(4, 9)

    def test_heaps_of_more_obstacles_are_a_fault_of_their_world(self):
        # Two robots are among thirty obstacles in the second world, and far off in the first.
        obstacles = tuple((4.0 + 0.01 * k, 4.0, 1.0, 1.0, 0.0) for k in range(30))
        arena = replace(
            SMALL.arena,
            obstacles=obstacles,
            dust_area_size=2,
            dust_area_offset=5.5,
            n_dust=2,
        )
        start = np.tile([(9.0, 9.0, 0.1), (9.0, 9.0, 0.2), (-8.0, -8.0, 0.0)], (2, 1, 1))
        start[0, :2] = [(-8.0, 8.0, 0.0), (8.0, -8.0, 0.0)]

        _, batch = both_engines(replace(SMALL, arena=arena))
        motion = moved(batch, placed(batch, start), 0.1, 2)
        assert motion.fault[0] == 0
        assert motion.fault[1] & FaultKind.TOO_MANY_CONTACTS
