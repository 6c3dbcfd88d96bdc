"""The planar engine: drives, refinement, contacts, accuracy. Units: mm, mg, s."""

import math
from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from support.crowds import crowd
from support.overlaps import gap
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
from iswarm_mj.utils.units import RD, mm_from_rd

WALL = 7.5 * RD
"""Distance of the small arena's walls from its centre."""
MASS = 10.0
"""Mass of a robot."""


def engine_of(config, **changes):
    """Return the engine of the small arena; `changes` replace numbers of its plane."""
    engine = PlanarEngine(config, compile_arena(config, 1, np.zeros(0)), 1)
    engine.plane = engine.plane._replace(**changes)
    return engine


def test_phases_follow_each_other(small):
    """Turn by 90 degrees in 0.4 s, then walk north."""
    engine = engine_of(small)
    turn_rate = math.pi / 2 / 0.4

    def walk_ahead(poses):
        yaw = poses[..., 2]
        return np.stack([np.cos(yaw), np.sin(yaw), 0 * yaw], axis=-1)

    turn = Phase(4, lambda poses: np.full_like(poses, [0, 0, turn_rate]))
    walk = Phase(6, walk_ahead)
    bodies = placed(engine, [[(0, 0, 0)]])
    motion = engine.move(bodies, [turn, walk], np.ones(1, bool))
    np.testing.assert_allclose(motion.bodies.poses, [[(0, 0.6, math.pi / 2)]], atol=1e-12)
    assert not bodies.poses.any()  # the bodies that went in did not change


def test_refinement_is_a_finer_step_of_the_drive(small):
    """The steps and contacts are those of a drive with five times as many steps.

    The number of threads does not matter.
    """
    drive = small.drive
    finer_drive = replace(
        drive,
        turn_substeps=5 * drive.turn_substeps,
        walk_substeps=5 * drive.walk_substeps,
    )
    finer = replace(small, drive=finer_drive)
    refined = PlanarEngine(small, compile_arena(small, 1, np.zeros(0), refinement=5), 3)
    plain = PlanarEngine(finer, compile_arena(finer, 1, np.zeros(0), refinement=1), 1)

    rng = np.random.default_rng(7)
    start = crowd(7, rng)
    velocity = rng.uniform(-1.4, 1.4, start.shape)
    by_refinement = moved(refined, placed(refined, start), velocity, 10)
    by_drive = moved(plain, placed(plain, start), velocity, 50)
    np.testing.assert_array_equal(by_refinement.bodies.poses, by_drive.bodies.poses)
    np.testing.assert_array_equal(by_refinement.touching, by_drive.touching)
    assert pairs_of(by_refinement.touching).any(axis=(1, 2)).all()


class TestContacts:
    def test_the_deepest_overlap_is_that_of_any_step(self, small):
        """Two robots that touch, 0.3 mm deep as they start, and part; one in a wall; one alone.

        Two more are absent, in another wall and in an obstacle.
        """
        obstacle = (0, -5, 1, 1, 0)
        arena = replace(
            small.arena,
            obstacles=(obstacle,),
            dust_area_size=2,
            dust_area_offset=5.5,
            n_dust=2,
        )
        engine = engine_of(replace(small, arena=arena))
        absent = [(-WALL, 3, 0), (0, -5 * RD, 0)]
        second_robots = [(1.7, 0, 0), (WALL - 0.9, 3, 0), (5, 0, 0)]
        start = [[(0, 0, 0), second, *absent] for second in second_robots]
        present = np.tile(np.arange(4) < 2, (3, 1))

        motion = moved(engine, placed(engine, start, present), 0.0)
        np.testing.assert_allclose(motion.bodies.overlap, [0.3, 0.1, 0.0], atol=1e-9)

        next_motion = moved(engine, motion.bodies, 0.0)
        assert (next_motion.bodies.overlap < 0.15).all()  # of that control step alone

    def test_the_overlap_is_that_of_the_rectangles(self, small):
        """Also where a corner is deepest beside the other robot's side."""
        rng = np.random.default_rng(3)
        engine = engine_of(small)
        offset = rng.uniform([-2.4, -2.4, -np.pi], [2.4, 2.4, np.pi], (200, 3))
        start = np.stack([np.zeros_like(offset), offset], axis=1)
        motion = moved(engine, placed(engine, start), 0.0, 1)
        gaps = np.array([gap(first, second, (1, 1), (1, 1)) for first, second in start])
        np.testing.assert_allclose(motion.bodies.overlap, np.maximum(0, -gaps), atol=1e-9)
        assert 50 < (gaps < 0).sum() < 190

    def test_a_robot_meets_a_wall(self, small):
        """Two equal rows: J v' + R p / 2 + offset = 0 with m v' = m v - p, solved by hand."""
        engine = PlanarEngine(small, compile_arena(small, 1, np.zeros(0), refinement=1), 1)
        overlap = 0.05
        speed = 1.2
        d = 0.99  # impedance
        h = 0.1
        margin = 1.5 * math.sqrt(2) * math.pi / 16  # a corner turns by 90 degrees in 8 time steps
        softness = (1 - d) / d * (2 / 3 / MASS) / 4  # of four points as one
        reference = speed / h + 0.03 / h**2 * d * (margin + overlap)
        offset = speed - h * reference
        impulse = (speed - offset) / (1 / MASS + softness)

        bodies = placed(engine, [[(WALL - 1 + overlap, 0, 0)]])
        bodies.velocity[0, 0, 0] = speed
        after = moved(engine, bodies, [speed, 0, 0], 1).bodies
        expected = [speed - impulse / MASS, 0, 0]
        np.testing.assert_allclose(after.velocity[0, 0], expected, rtol=1e-9, atol=1e-9)

    def test_robots_deeper_in_each_other_than_they_are_high_part(self, small):
        engine = engine_of(small)
        start = placed(engine, [[(0, 0, 0), (0.7, 0.1, 0.3)]])
        first, second = moved(engine, start, 0.0, 60).bodies.poses[0, :, :2]
        assert np.hypot(*(second - first)) > 1.9

    def test_each_step_of_a_jam_is_solved_whatever_impulses_it_begins_with(self, small):
        """The solver begins with the impulses of the step before, or with none in a new phase."""
        n_robots = 60
        rng = np.random.default_rng(8)
        engine = engine_of(small, tolerance=1e-10)
        bodies = placed(engine, place_robots(small.arena, n_robots, rng)[None])
        for _ in range(20):
            towards_centre = -0.5 * bodies.poses * (1, 1, 0)
            bodies = moved(engine, bodies, towards_centre).bodies

        is_first_half = np.arange(n_robots)[:, None] < n_robots // 2
        velocity = np.where(is_first_half, 1.0, -1.0) * (1, 0.3, 0.2)
        in_steps = bodies
        for _ in range(6):
            in_steps = moved(engine, in_steps, velocity, 1).bodies
        motion = moved(engine, bodies, velocity, 6)
        np.testing.assert_allclose(motion.bodies.poses, in_steps.poses, atol=1e-6)
        assert pairs_of(motion.touching).sum() > 60


class TestAccuracy:
    """The accuracy that `PlanarSettings` promise, in control steps of crowds from rest."""

    N_WORLDS = 6
    N_ROBOTS = 60
    N_STEPS = 10
    ACCURACIES = (FINEST, 0.01, 0.1)

    @classmethod
    def engine(cls, accuracy):
        settings = PlanarSettings(threads=1, refinement=1, accuracy=accuracy)
        model = ModelSpec(SMALL, cls.N_ROBOTS, cls.N_ROBOTS)
        return settings.host_engine(model)(cls.N_WORLDS, 1)

    @pytest.fixture(scope="class")
    @classmethod
    def errors(cls):
        """Return distances from where an exact solver puts the robots, by accuracy [mm]."""
        rng = np.random.default_rng(7)
        exact = cls.engine(FINEST)
        exact.plane = exact.plane._replace(tolerance=1e-10)
        engines = {accuracy: cls.engine(accuracy) for accuracy in cls.ACCURACIES}

        shape = cls.N_WORLDS, cls.N_ROBOTS
        all_run = np.ones(cls.N_WORLDS, bool)
        starts = [place_robots(SMALL.arena, cls.N_ROBOTS, rng) for _ in range(cls.N_WORLDS)]
        poses = np.stack(starts)
        errors = {accuracy: [] for accuracy in cls.ACCURACIES}
        for _ in range(cls.N_STEPS):
            turn = rng.uniform(-0.6, 0.6, shape)
            forward = rng.uniform(0.0, math.sqrt(2), shape)
            phases = drive_phases(SMALL.drive, Command(turn, forward))
            ends = exact.move(placed(exact, poses), phases, all_run).bodies.poses
            for accuracy, engine in engines.items():
                motion = engine.move(placed(engine, poses), phases, all_run)
                distances = np.abs(motion.bodies.poses - ends)[..., :2].max(-1)
                errors[accuracy].append(distances)
            poses = ends
        return {accuracy: np.concatenate(distances) for accuracy, distances in errors.items()}

    def test_99_of_100_robots_end_within_it(self, errors):
        for accuracy, distances in errors.items():
            assert np.mean(distances <= accuracy) >= 0.99

    def test_a_coarser_one_is_less_accurate(self, errors):
        """It makes fewer sweeps."""
        finest, default, coarse = (errors[accuracy].max() for accuracy in self.ACCURACIES)
        assert 0 < finest < default < coarse

    @pytest.mark.parametrize(
        ("control_period", "accuracy", "tolerance"),
        [(1.0, 0.01, 0.01), (4.0, 0.01, 0.0025), (4.0, FINEST, FINEST)],
    )
    def test_it_is_one_of_a_control_step(self, small, control_period, accuracy, tolerance):
        drive = replace(small.drive, control_period=control_period)
        config = replace(small, drive=drive)
        settings = PlanarSettings(threads=1, refinement=5, accuracy=accuracy)
        model = ModelSpec(config, 1, 1)
        on_host = settings.host_engine(model)(1, 1)
        compiled = settings.compiled_engine(model, 1, "cpu")
        for engine in (on_host, compiled):
            assert engine.plane.timestep == drive.timestep / 5
            assert engine.plane.tolerance == tolerance


def test_robots_that_press_in_few_physics_steps_do_not_sink_into_each_other(small):
    """All walk to the middle, in two steps after one of turning, until the crowd has packed."""
    n_robots = 60
    drive = replace(small.drive, step_length=0.17, walk_substeps=2, max_turn=30, turn_substeps=1)
    config = replace(small, drive=drive)
    model = ModelSpec(config, n_robots, n_robots)
    engine = PlanarSettings(threads=1).host_engine(model)(1, 1)
    bodies = placed(engine, [place_robots(config.arena, n_robots, np.random.default_rng(2))])
    forward = np.full((1, n_robots), mm_from_rd(drive.step_length))
    largest_turn = math.radians(drive.max_turn)
    for _ in range(50):
        x, y, yaw = np.moveaxis(bodies.poses, -1, 0)
        turn = np.remainder(np.arctan2(-y, -x) - yaw + np.pi, 2 * np.pi) - np.pi
        command = Command(np.clip(turn, -largest_turn, largest_turn), forward)
        bodies = engine.move(bodies, drive_phases(drive, command), np.ones(1, bool)).bodies

    half_edges = (1.0, 1.0)
    pairs = combinations(bodies.poses[0], 2)
    gaps = [gap(first, second, half_edges, half_edges) for first, second in pairs]
    assert min(gaps) > -0.2


def test_a_row_that_presses_on_a_wall_keeps_its_distances(small):
    """What a solver leaves in each step adds up along the row, and over the steps."""
    n_robots = 10
    model = ModelSpec(small, n_robots, n_robots)
    engine = PlanarSettings(threads=1).host_engine(model)(1, 1)
    wall = mm_from_rd(small.arena.size) / 2
    row = [(wall - 1.5 - 2.5 * index, 0.0, 0.0) for index in range(n_robots)]
    bodies = placed(engine, [row])
    command = Command(np.zeros((1, n_robots)), np.full((1, n_robots), math.sqrt(2)))
    for _ in range(40):
        bodies = engine.move(bodies, drive_phases(small.drive, command), np.ones(1, bool)).bodies
    x = bodies.poses[0, :, 0]
    gaps = np.append(wall - x[0], x[:-1] - x[1:]) - np.append(1.0, np.full(n_robots - 1, 2.0))
    assert gaps.min() > -0.1
