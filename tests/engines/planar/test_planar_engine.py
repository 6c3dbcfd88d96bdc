"""The planar engine: servos, conservation laws, absent robots, faults, threads. Units: mm, mg, s."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.crowds import crowd
from support.planar import moved, placed
from support.small import SMALL
from support.touching import pairs_of

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.base import Phase
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.engines.planar.plane import FINEST
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.settings import ModelSpec
from iswarm_mj.simulation.actuate import drive_phases
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.layout import place_robots
from iswarm_mj.utils.units import RD

EDGE = 7.5 * RD  # of the small arena, from its middle


def engine_of(config, **changes):
    """Engine of the small arena; `changes` replace numbers of its plane."""
    engine = PlanarEngine(config, compile_arena(config, 1, np.zeros(0)), 1)
    engine.plane = engine.plane._replace(**changes)
    return engine


MASS = 10.0
"""Of a robot [mg]."""


class TestServo:
    def test_phases_follow_each_other(self, small):
        """Turn by 90 degrees, then walk north."""
        engine = engine_of(small)
        turn = Phase(4, lambda poses: np.full_like(poses, [0, 0, math.pi / 2 / 0.4]))
        walk = Phase(6, lambda poses: np.stack([np.cos(poses[..., 2]), np.sin(poses[..., 2]), 0 * poses[..., 2]], -1))
        bodies = placed(engine, [[(0, 0, 0)]])
        motion = engine.move(bodies, [turn, walk], np.ones(1, bool))
        np.testing.assert_allclose(motion.bodies.poses, [[(0, 0.6, math.pi / 2)]], atol=1e-12)
        assert not bodies.poses.any()  # what went in is as it was


class TestRefinement:
    def test_it_is_a_finer_step_of_the_drive(self, small):
        """The same steps as of a drive with five times as many, and the same pairs in contact as a phase ends.

        At any number of threads.
        """
        drive = small.drive
        substeps = {"turn_substeps": 5 * drive.turn_substeps, "walk_substeps": 5 * drive.walk_substeps}
        finer = replace(small, drive=replace(drive, **substeps))
        refined, plain = (
            PlanarEngine(small, compile_arena(small, 1, np.zeros(0), refinement=5), 3),
            PlanarEngine(finer, compile_arena(finer, 1, np.zeros(0)), 1),
        )
        rng = np.random.default_rng(7)
        start = crowd(7, rng)
        velocity = rng.uniform(-1.4, 1.4, start.shape)
        here, there = (moved(engine, placed(engine, start), velocity, n) for engine, n in ((refined, 10), (plain, 50)))
        np.testing.assert_array_equal(here.bodies.poses, there.bodies.poses)
        np.testing.assert_array_equal(here.touching, there.touching)
        assert pairs_of(here.touching).any(axis=(1, 2)).all()


class TestContacts:
    def test_the_deepest_overlap_is_that_of_any_step(self, small):
        """Two robots that touch, 0.3 mm deep as they start, and part; one in a wall; one alone.

        Two more are absent, in another wall and in an obstacle.
        """
        arena = replace(small.arena, obstacles=((0, -5, 1, 1, 0),), dust_area_size=2, dust_area_offset=5.5, n_dust=2)
        engine, absent = engine_of(replace(small, arena=arena)), [(-EDGE, 3, 0), (0, -5 * RD, 0)]
        start = [[(0, 0, 0), second, *absent] for second in ((1.7, 0, 0), (EDGE - 0.9, 3, 0), (5, 0, 0))]
        motion = moved(engine, placed(engine, start, np.tile(np.arange(4) < 2, (3, 1))), 0.0)
        np.testing.assert_allclose(motion.bodies.overlap, [0.3, 0.1, 0.0], atol=1e-9)
        assert (moved(engine, motion.bodies, 0.0).bodies.overlap < 0.05).all()  # of this control step alone

    def test_a_robot_meets_a_wall(self, small):
        """Two alike rows of a flat side: J v' + R p / 2 + offset = 0 with m v' = m v - p, solved by hand."""
        engine = engine_of(small)
        overlap, speed = 0.05, 1.2
        d, time_constant, h = 0.99, 0.2, 0.1
        softness = (1 - d) / d * (2 / 3 / MASS) / 4  # of four points as one
        offset = speed - h * (2 / (d * time_constant) * speed + d / (d * time_constant) ** 2 * overlap)
        impulse = (speed - offset) / (1 / MASS + softness)
        bodies = placed(engine, [[(EDGE - 1 + overlap, 0, 0)]])
        bodies.velocity[0, 0, 0] = speed
        new = moved(engine, bodies, [speed, 0, 0], 1).bodies
        np.testing.assert_allclose(new.velocity[0, 0], [speed - impulse / MASS, 0, 0], rtol=1e-9, atol=1e-9)

    def test_robots_deeper_in_each_other_than_they_are_high_part(self, small):
        engine = engine_of(small)
        bodies = moved(engine, placed(engine, [[(0, 0, 0), (0.7, 0.1, 0.3)]]), 0.0, 30).bodies
        assert np.hypot(*(bodies.poses[0, 1] - bodies.poses[0, 0])[:2]) > 1.9


@pytest.fixture(scope="module")
def off():
    """By accuracy, how far robots (B, N) of crowds end from where an exact solver puts them [mm]."""

    def engine(accuracy):
        return PlanarSettings(1, 1, accuracy).host_engine(ModelSpec(SMALL, 60, 60))(6, 1)

    rng, exact = np.random.default_rng(7), engine(2e-5)
    exact.plane = exact.plane._replace(tolerance=1e-10)
    found = {accuracy: [] for accuracy in (2e-5, 0.01, 1.0)}
    poses = np.stack([place_robots(SMALL.arena, 60, rng) for _ in range(6)])
    for _ in range(10):
        command = Command(rng.uniform(-0.6, 0.6, (6, 60)), rng.uniform(0.0, math.sqrt(2), (6, 60)))
        phases, all_run = drive_phases(SMALL.drive, command), np.ones(6, bool)
        ends = exact.move(placed(exact, poses), phases, all_run).bodies.poses
        for accuracy, gaps in found.items():
            here = engine(accuracy)
            gaps.append(np.abs(here.move(placed(here, poses), phases, all_run).bodies.poses - ends)[..., :2].max(-1))
        poses = ends
    return {accuracy: np.concatenate(gaps) for accuracy, gaps in found.items()}


class TestAccuracy:
    """What `PlanarSettings` promise, by control steps from rest in crowds of 60 robots."""

    def test_99_of_100_robots_end_within_it(self, off):
        for accuracy, gaps in off.items():
            assert np.mean(gaps <= accuracy) >= 0.99

    def test_less_of_it_is_used(self, off):
        """A coarser one makes fewer sweeps."""
        assert 0 < off[2e-5].max() < off[0.01].max() < off[1.0].max()

    def test_it_is_one_of_a_control_step(self, small):
        slow, found = replace(small, drive=replace(small.drive, control_period=4.0)), []
        for config, accuracy in ((small, 0.01), (slow, 0.01), (slow, 2e-5)):
            settings, model = PlanarSettings(1, 5, accuracy), ModelSpec(config, 1, 1)
            for engine in (settings.host_engine(model)(1, 1), settings.compiled_engine(model, 1, "cpu")):
                assert engine.plane.timestep == config.drive.timestep / 5
                found.append(engine.plane.tolerance)
        assert found == [0.01, 0.01, 0.0025, 0.0025, FINEST, FINEST]


def test_each_step_of_a_jam_is_solved_whatever_it_begins_with(small):
    """In a phase the solver begins with the impulses of the step before, in phases of one step with none."""
    rng, engine = np.random.default_rng(8), engine_of(small, tolerance=1e-10)
    bodies = placed(engine, place_robots(small.arena, 60, rng)[None])
    for _ in range(20):
        bodies = moved(engine, bodies, -0.5 * bodies.poses * (1, 1, 0)).bodies
    velocity, steps = np.where(np.arange(60)[:, None] < 30, 1.0, -1.0) * (1, 0.3, 0.2), bodies
    for _ in range(6):
        steps = moved(engine, steps, velocity, 1).bodies
    motion = moved(engine, bodies, velocity, 6)
    np.testing.assert_allclose(motion.bodies.poses, steps.poses, atol=1e-6)
    assert pairs_of(motion.touching).sum() > 60
