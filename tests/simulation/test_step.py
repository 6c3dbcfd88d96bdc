"""One control step: driving, walls in sight, balls at the tips, and no direction better than another."""

import numpy as np
import pytest
from iswarm_mj.simulation.run_mujoco import Run, RunSettings, Start, draw_start
from scipy.stats import mannwhitneyu

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mujoco.engine import MujocoBatchEngine
from iswarm_mj.simulation import step as swarm
from iswarm_mj.strategy.controller import Command
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.units import RD

EDGE = 7.5 * RD  # of the small arena, from its middle [mm]
STEP = np.sqrt(2)  # half a robot diameter [mm]


def engine_of(config, poses):
    poses = np.asarray(poses, float)
    engine = MujocoBatchEngine(compile_arena(config, poses.shape[1], np.full(2, 20e-6)), len(poses), 1)
    engine.reset(poses, np.zeros((len(poses), 2, 3)))
    return engine


class TestDrive:
    def test_turns_on_the_spot_then_walks(self, small):
        """East, north, and backwards after a turn to the north-west."""
        engine = engine_of(small, [[(-8, 0, 0), (0, 0, 0), (8, 0, np.pi / 2)]])
        command = Command(np.array([[0, np.pi / 2, np.pi / 4]]), np.array([[STEP, STEP, -1.0]]))
        pairs = swarm.drive(small, engine, command, np.arange(1))
        half = np.sqrt(0.5)
        expected = [(-8 + STEP, 0, 0), (0, STEP, np.pi / 2), (8 + half, -half, 3 * np.pi / 4)]
        np.testing.assert_allclose(engine.poses()[0], expected, atol=1e-6)
        assert [p.tolist() for p in pairs] == [[]]

    def test_walks_along_the_heading_that_it_has(self, small):
        """A robot that is hindered in its turn walks where it looks, not where it meant to look."""
        start, turn = [[(EDGE - 1.2, 0, 0.0)]], np.array([[np.pi / 4]])
        ends = []
        for forward in (0.0, -STEP):
            engine = engine_of(small, start)
            swarm.drive(small, engine, Command(turn, np.array([[forward]])), np.arange(1))
            ends.append(engine.poses()[0, 0])
        x, y, yaw = ends[0]
        assert x < EDGE - 1.3 and 0.5 < yaw < 0.7
        np.testing.assert_allclose(ends[1][:2], [x - STEP * np.cos(yaw), y - STEP * np.sin(yaw)], atol=0.05)

    def test_tells_who_touches(self, small):
        engine = engine_of(small, [[(0, 0, 0), (2.5, 0, 0), (-8, 0, 0)], [(0, 0, 0), (8, 0, 0), (2.5, 0.1, 0)]])
        forward = np.array([[STEP, 0.0, 0.0]] * 2)
        pairs = swarm.drive(small, engine, Command(np.zeros((2, 3)), forward), np.arange(2))
        assert [p.tolist() for p in pairs] == [[1], [2]]
        assert [p.tolist() for p in swarm.drive(small, engine, Command(0 * forward, forward), np.array([1]))] == [[2]]


class TestWalls:
    def test_are_seen_on_the_side_that_faces_them(self, small):
        """1.5 rd = 4.243 mm in front of a LED, which is 1 mm from the centre."""
        near, far = EDGE - 5.2, EDGE - 5.3
        poses = [[(near, 0, 0), (far, 4, 0), (near, -4, np.pi / 2), (0, -near, 0), (-near, -near, np.pi), (0, 0, 0)]]
        sees = swarm.find_walls(small, engine_of(small, poses), np.array(poses, float))
        sides = [np.flatnonzero(row).tolist() for row in sees[0]]
        assert sides == [[0], [], [3], [3], [0, 1], []]

    def test_are_seen_by_a_robot_that_is_pressed_into_them(self, small):
        poses = [[(EDGE - 0.9, 0, 0), (EDGE - 0.95, 4, np.pi)]]
        sees = swarm.find_walls(small, engine_of(small, poses), np.array(poses, float))
        assert np.argwhere(sees[0]).tolist() == [[0, 0], [1, 2]]

    def test_are_hidden_by_robots(self, small):
        poses = [[(EDGE - 5, 0, 0), (EDGE - 1.5, 0.5, 0)]]
        sees = swarm.find_walls(small, engine_of(small, poses), np.array(poses, float))
        assert np.argwhere(sees[0]).tolist() == [[1, 0]]


def quarter_turn(start):
    """The same world, turned by a quarter: dust to the north and south."""
    x, y, yaw = start.poses.T
    balls = start.balls.position
    turned = np.column_stack([-balls[:, 1], balls[:, 0]])
    return Start(np.column_stack([-y, x, yaw + np.pi / 2]), start.balls._replace(position=turned), start.is_alive)


def pair_of_runs(config, seed, steps=70):
    settings = RunSettings(30, steps, seed=seed, n_threads=1)
    start = draw_start(config, settings, 0)
    off_grid = start.poses + np.random.default_rng(seed).uniform(-0.2, 0.2, (30, 3))  # no two at equal distances
    start = start._replace(poses=off_grid)
    return [Run(config, Genome(), settings, [s]) for s in (start, quarter_turn(start))]


@pytest.mark.parametrize("seed", range(4))
def test_a_world_turned_by_a_quarter_takes_the_same_first_steps(small, seed):
    straight, turned = pair_of_runs(small, seed)
    for _ in range(2):
        one, other = straight.advance(), turned.advance()
        np.testing.assert_array_equal(one.links.valid, other.links.valid)
        np.testing.assert_array_equal(one.links.sender[one.links.valid], other.links.sender[one.links.valid])
        x, y, yaw = np.moveaxis(one.poses, -1, 0)
        np.testing.assert_allclose(other.poses, np.stack([-y, x, yaw + np.pi / 2], axis=-1), atol=2e-4)
        for memory in ("dust", "dump"):
            mine, yours = getattr(one.state.memory, memory), getattr(other.state.memory, memory)
            np.testing.assert_array_equal(mine.known, yours.known)
            np.testing.assert_allclose(mine.vector, yours.vector, atol=2e-4)
    assert one.links.valid.sum() > 20


def outcomes(config):
    """Balls picked up by step 20 and delivered by step 50, of 14 worlds as they are and turned: (2, 14, 2)."""
    results = []
    for seed in range(14):
        for run in pair_of_runs(config, seed):
            while run.step < 20:
                run.advance()
            picked = run.measures(0).picked
            while run.step < 50:
                run.advance()
            results.append((picked, run.measures(0).delivered))
    return np.array(results).reshape(14, 2, 2).swapaxes(0, 1)


def least_p(straight, turned):
    return min(mannwhitneyu(straight[:, i], turned[:, i]).pvalue for i in range(2))


def test_no_direction_is_better_than_another(small):
    straight, turned = outcomes(small)
    assert straight.min(axis=0)[0] > 0 and straight.mean(axis=0)[1] > 4
    assert least_p(straight, turned) > 0.002


def test_a_bias_would_be_seen(small, monkeypatch):
    """As above, with motion along y at a third of the speed."""
    advance = MujocoBatchEngine.advance
    slow = np.array([1.0, 0.33, 1.0])
    monkeypatch.setattr(MujocoBatchEngine, "advance", lambda self, v, *rest: advance(self, slow * v, *rest))
    assert least_p(*outcomes(small)) < 0.002


def test_held_balls_hang_at_the_tips(small):
    """Robot 1 looks along (3, 4) and holds ball 0; ball 1 lies. The tip is 0.9 mm ahead and 0.1 mm to the left."""
    run = Run(small, Genome(), RunSettings(30, 1))
    poses = np.zeros((1, 30, 3))
    poses[0, 1] = (5, 7, np.arctan2(4, 3))
    balls = run.state.balls
    held = balls.is_held.at[0, 0].set(True)
    state = run.state._replace(balls=balls._replace(is_held=held, holder=balls.holder.at[0, 0].set(1)))
    centres = swarm.ball_centres(state, poses, np.array([0.9, 0.1]), 0.05)[0]
    radius = np.asarray(balls.radius[0]) * 1e3
    np.testing.assert_allclose(centres[0], [5 + 0.54 - 0.08, 7 + 0.72 + 0.06, 0.05 - radius[0]], atol=1e-6)
    np.testing.assert_allclose(centres[1], [*balls.position[0, 1], radius[1]], atol=1e-7)


def test_robots_walk_half_a_diameter(small):
    """Those who meet nobody, and turn little."""
    run = Run(small, Genome(), RunSettings(30, 5, n_threads=1))
    before, n_full = run.engine.poses(), 0
    while not run.is_over:
        view = run.advance()
        moved = np.linalg.norm((view.poses - before)[..., :2], axis=-1)
        assert view.speed[0] == pytest.approx(moved.mean())
        n_full += np.isclose(moved, STEP, rtol=1e-5).sum()
        before = view.poses
    assert n_full > 15
