"""Runs: a fault ends its world alone."""

from functools import cache

import jax
import numpy as np
import pytest
from support.mujoco import spoil as spoil_steps
from support.runs import N, end_of, place_of, poses_of, records, run_of, scripted

from iswarm_mj.engines.base import find_lost
from iswarm_mj.geometry.walls import corners_of, half_planes, in_mm
from iswarm_mj.simulation.faults import MAX_LISTED, decode_faults, summarize_faults
from iswarm_mj.simulation.state import Fault
from iswarm_mj.utils.errors import FaultKind, SimulationFault
from iswarm_mj.utils.units import RD

GOAL = 3


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # MuJoCo logs to the working directory


@cache
def usual_end(config, steps):
    """Poses and measures of two worlds in which nothing goes wrong."""
    return end_of(run_of(config, worlds=2, steps=steps, goal=GOAL))


@pytest.mark.usefixtures("elsewhere")
class TestFaults:
    def check_the_other(self, run):
        """World 0 goes on to its usual end, as if nothing had happened."""
        end, expected = end_of(run), usual_end(run.config, run.settings.steps)
        np.testing.assert_array_equal(end[0][0], expected[0][0])
        assert end[1][0] == expected[1][0] and run.step == (end[1][0].finished_at or run.settings.steps)

    @pytest.mark.parametrize(
        "value, column, kind", [(np.nan, 2, FaultKind.POSE_NOT_FINITE), (-1e3, 1, FaultKind.OUTSIDE)]
    )
    def test_of_poses_end_their_world_alone(self, small, value, column, kind):
        """Robots 4 and 7 of world 1 are spoilt after two steps; the third does not count there."""
        run = run_of(small, worlds=2, steps=5, goal=GOAL)
        run.advance()
        run.advance()
        before, measures, (engine, place) = poses_of(run)[1].copy(), run.measures(1), place_of(run, 1)
        spoil_steps(engine, place, [4, 7], value, column)
        self.check_the_other(run)
        (fault,) = run.faults
        assert (fault.step, fault.world, fault.robots, fault.kind) == (3, 1, (4,), kind)
        np.testing.assert_array_equal(poses_of(run)[1], before)
        assert run.measures(1).collisions == measures.collisions

    def test_of_commands_end_their_world_alone(self, small):
        """From then on nobody hears anything or moves there, and nothing changes."""
        given = {"worlds": 2, "steps": 200, "goal": GOAL}
        strategy = scripted(run_of(small, **given), step=[999, 9], robot=5, turn=np.nan, forward=0.0)
        run, seen, last = run_of(small, strategy=strategy, **given), [], None
        for record in records(run):
            seen.append(record.is_running)
            swarm = jax.tree.map(lambda a: a[1], record.swarm)
            if not record.is_running[1]:
                jax.tree.map(np.testing.assert_array_equal, swarm, last)
            last = swarm
            for values in (record.links.valid, record.is_heard, *record.command):
                assert values[0].any() and (values[1].any() == record.is_running[1])
        seen = np.array(seen)
        assert seen[:9].all() and not seen[9:, 1].any() and seen[9:, 0].all()
        (fault,) = run.faults
        assert (fault.step, fault.world, fault.robots) == (9, 1, (5,))
        assert fault.kind == FaultKind.COMMAND_NOT_FINITE
        with pytest.raises(SimulationFault, match=r"^step 9, world 1: the command of robot 5 is not finite; make"):
            run.raise_faults()
        self.check_the_other(run)
        assert run.measures(0).finished_at and run.measures(1).finished_at is None

    def test_just_outside_is_outside(self):
        edge, present, walls = 7.5 * RD, np.ones((1, N), bool), in_mm(half_planes(corners_of([(15.0, 15.0)])))
        poses = np.zeros((1, N, 3))
        poses[0, 3, :2] = edge - 1e-6, 1e-6 - edge
        assert find_lost(poses, present, walls)[0].tolist() == [0]
        poses[0, 3, 1] = -1e-6 - edge
        bits, robot = find_lost(poses, present, walls)
        assert (bits.tolist(), robot.tolist()) == ([FaultKind.OUTSIDE], [3])
        present[0, 3] = False
        assert find_lost(poses, present, walls)[0].tolist() == [0]

    def test_poses_that_are_not_finite_come_first(self):
        poses = np.zeros((2, N, 3))
        poses[0, 5], poses[1, 8, 2], poses[1, 3, 0] = [99.0, 0.0, np.nan], np.nan, 99.0
        walls = in_mm(half_planes(corners_of([(15.0, 15.0)])))
        bits, robot = find_lost(poses, np.ones((2, N), bool), walls)
        not_finite = FaultKind.POSE_NOT_FINITE
        assert (bits.tolist(), robot.tolist()) == ([not_finite, not_finite | FaultKind.OUTSIDE], [5, 8])


def faults_of(bits, step=3, robot=7, first=0):
    bits = np.array(bits)
    worlds = range(first, first + len(bits))
    each = decode_faults(Fault(bits, np.full_like(bits, step), np.full_like(bits, robot)), worlds, N)
    assert [fault is not None for fault in each] == [bool(b) for b in bits]
    return [fault for fault in each if fault is not None]


def test_no_fault():
    assert faults_of([0, 0]) == [] and summarize_faults([]) == ""


def test_who_when_where_and_what():
    """A process of several has a share of the worlds, which keep their numbers."""
    (fault,) = faults_of([0, FaultKind.OUTSIDE], first=10)
    assert (fault.step, fault.world, fault.robots, fault.kind) == (3, 11, (7,), FaultKind.OUTSIDE)
    assert str(fault).startswith("step 3, world 11: robot 7 left the arena; ")


@pytest.mark.parametrize("kind", FaultKind)
def test_only_faults_of_robots_name_one(kind):
    (fault,) = faults_of([kind])
    of_robots = {FaultKind.POSE_NOT_FINITE, FaultKind.OUTSIDE, FaultKind.COMMAND_NOT_FINITE}
    assert fault.robots == ((7,) if kind in of_robots else ())
    assert ("robot 7" in str(fault)) == (kind in of_robots)


def test_of_many_worlds_the_first_five_are_listed():
    text = summarize_faults(faults_of([FaultKind.OUTSIDE] * 12))
    assert text.count("left the arena") == MAX_LISTED == 5
    assert "world 4: robot 7 left the arena" in text and text.endswith("; and 7 more worlds")
