"""Faults: they end their world alone, and messages say who, when, where and what."""

from functools import cache

import jax
import numpy as np
import pytest
from support.mujoco import spoil as spoil_steps
from support.runs import N, end_of, engine_and_place, poses_of, records, run_of, scripted

from iswarm_mj.engines.base import find_lost
from iswarm_mj.geometry.walls import corners_of, half_planes, in_mm
from iswarm_mj.simulation.faults import MAX_LISTED, decode_faults, summarize_faults
from iswarm_mj.simulation.state import Fault
from iswarm_mj.utils.errors import FaultKind, SimulationFault
from iswarm_mj.utils.units import RD

GOAL = 3
"""Deliveries that finish a world."""


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """Another working directory, to which MuJoCo logs."""
    monkeypatch.chdir(tmp_path)


@cache
def end_without_faults(config, steps):
    """Return poses and measures of two worlds in which nothing goes wrong."""
    return end_of(run_of(config, worlds=2, steps=steps, goal=GOAL))


def check_other_world(run):
    """Take a run to its end, and check that world 0 ends as if nothing had happened in world 1."""
    poses, measures = end_of(run)
    expected_poses, expected_measures = end_without_faults(run.config, run.settings.steps)
    np.testing.assert_array_equal(poses[0], expected_poses[0])
    assert measures[0] == expected_measures[0]
    assert run.step == (measures[0].finished_at or run.settings.steps)


@pytest.mark.usefixtures("elsewhere")
class TestFaultsEndTheirWorldAlone:
    @pytest.mark.parametrize(
        ("value", "column", "kind"),
        [(np.nan, 2, FaultKind.POSE_NOT_FINITE), (-1e3, 1, FaultKind.OUTSIDE)],
    )
    def test_faults_of_poses(self, small, value, column, kind):
        """Robots 4 and 7 of world 1 are spoilt after two steps; the third does not count there."""
        run = run_of(small, worlds=2, steps=5, goal=GOAL)
        run.advance()
        run.advance()
        poses = poses_of(run)[1].copy()
        collisions = run.measures(1).collisions

        engine, place = engine_and_place(run, 1)
        spoil_steps(engine, place, [4, 7], value, column)
        check_other_world(run)

        (fault,) = run.faults
        assert (fault.step, fault.world, fault.robots, fault.kind) == (3, 1, (4,), kind)
        np.testing.assert_array_equal(poses_of(run)[1], poses)
        assert run.measures(1).collisions == collisions

    def test_faults_of_commands(self, small):
        """Nobody in world 1 hears anything or moves from step 9 on, and nothing changes."""
        fault_step = 9
        fields = {"worlds": 2, "steps": 200, "goal": GOAL}
        strategy = scripted(
            run_of(small, **fields), step=[999, fault_step], robot=5, turn=np.nan, forward=0.0
        )
        run = run_of(small, strategy=strategy, **fields)

        is_running = []
        previous = None
        for record in records(run):
            is_running.append(record.is_running)
            swarm = jax.tree.map(lambda values: values[1], record.swarm)
            if not record.is_running[1]:
                jax.tree.map(np.testing.assert_array_equal, swarm, previous)
            previous = swarm

            for values in (record.links.valid, record.is_heard, *record.command):
                assert values[0].any()
                assert values[1].any() == record.is_running[1]

        is_running = np.array(is_running)
        assert is_running[:fault_step].all()
        assert is_running[fault_step:, 0].all()
        assert not is_running[fault_step:, 1].any()

        (fault,) = run.faults
        assert (fault.step, fault.world, fault.robots) == (fault_step, 1, (5,))
        assert fault.kind == FaultKind.COMMAND_NOT_FINITE
        says = r"^step 9, world 1: the command of robot 5 is not finite; make"
        with pytest.raises(SimulationFault, match=says):
            run.raise_faults()

        check_other_world(run)
        assert run.measures(0).finished_at
        assert run.measures(1).finished_at is None


class TestLostRobots:
    """Robots in a square arena of 15 rd."""

    WALLS = in_mm(half_planes(corners_of([(15.0, 15.0)])))
    EDGE = 7.5 * RD
    """Distance of a wall from the middle [mm]."""

    def lost(self, poses, is_present=None):
        """Return the fault bits and the first robot of each world, as lists."""
        if is_present is None:
            is_present = np.ones(poses.shape[:2], bool)
        bits, robot = find_lost(poses, is_present, self.WALLS)
        return bits.tolist(), robot.tolist()

    def test_just_outside_is_outside(self):
        poses = np.zeros((1, N, 3))
        poses[0, 3, :2] = self.EDGE - 1e-6, 1e-6 - self.EDGE
        bits, _ = self.lost(poses)
        assert bits == [0]

        poses[0, 3, 1] = -1e-6 - self.EDGE
        assert self.lost(poses) == ([FaultKind.OUTSIDE], [3])

    def test_places_without_a_robot_do_not_count(self):
        poses = np.zeros((1, N, 3))
        poses[0, 3, 1] = -2 * self.EDGE
        is_present = np.ones((1, N), bool)
        is_present[0, 3] = False
        bits, _ = self.lost(poses, is_present)
        assert bits == [0]

    def test_poses_that_are_not_finite_come_first(self):
        """A robot of world 0 is outside and has no heading; in world 1 these are two robots."""
        poses = np.zeros((2, N, 3))
        poses[0, 5] = 99.0, 0.0, np.nan
        poses[1, 8, 2] = np.nan
        poses[1, 3, 0] = 99.0
        not_finite = FaultKind.POSE_NOT_FINITE
        assert self.lost(poses) == ([not_finite, not_finite | FaultKind.OUTSIDE], [5, 8])


class TestMessages:
    @staticmethod
    def faults_of(bits, first_world=0):
        """Return the faults of worlds with these bits, in step 3 and of robot 7."""
        bits = np.array(bits)
        fault = Fault(bits, step=np.full_like(bits, 3), robot=np.full_like(bits, 7))
        worlds = range(first_world, first_world + len(bits))
        of_worlds = decode_faults(fault, worlds, capacity=N)
        assert [fault is not None for fault in of_worlds] == [bool(bit) for bit in bits]
        return [fault for fault in of_worlds if fault is not None]

    def test_there_may_be_none(self):
        assert self.faults_of([0, 0]) == []
        assert summarize_faults([]) == ""

    def test_they_say_who_when_where_and_what(self):
        """Worlds keep their numbers, whatever the first one is."""
        (fault,) = self.faults_of([0, FaultKind.OUTSIDE], first_world=10)
        assert (fault.step, fault.world, fault.robots) == (3, 11, (7,))
        assert fault.kind == FaultKind.OUTSIDE
        assert str(fault).startswith("step 3, world 11: robot 7 left the arena; ")

    @pytest.mark.parametrize("kind", FaultKind)
    def test_only_faults_of_robots_name_one(self, kind):
        (fault,) = self.faults_of([kind])
        names_a_robot = kind in {
            FaultKind.POSE_NOT_FINITE,
            FaultKind.OUTSIDE,
            FaultKind.COMMAND_NOT_FINITE,
        }
        assert fault.robots == ((7,) if names_a_robot else ())
        assert ("robot 7" in str(fault)) == names_a_robot

    def test_of_many_worlds_the_first_five_are_listed(self):
        text = summarize_faults(self.faults_of([FaultKind.OUTSIDE] * 12))
        assert text.count("left the arena") == MAX_LISTED == 5
        assert "world 4: robot 7 left the arena" in text
        assert text.endswith("; and 7 more worlds")
