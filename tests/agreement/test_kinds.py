"""Robots of two kinds in one swarm: 2 x 2 mm, 10 mg and 2.4 x 1.6 mm, 30 mg. Units: mm, mg, s."""

from dataclasses import replace

import jax
import numpy as np
import pytest
from support.planar import moved, placed
from support.robots import HALF, numbered, two_kinds
from support.small import SMALL

from iswarm_mj.engines.arena import compile_arena
from iswarm_mj.engines.mujoco.engine import MujocoEngine
from iswarm_mj.engines.planar.batch_engine import read_engine
from iswarm_mj.engines.planar.engine import PlanarEngine
from iswarm_mj.engines.robot_file import files_of, models_directory, read_robot, read_robots
from iswarm_mj.geometry.robot import Mixed
from iswarm_mj.tasks.layout import place_robots
from iswarm_mj.utils.errors import UserError

N_ROBOTS = 60
LIGHT = 10.0
"""Mass of a robot of the first kind."""
HEAVY = 30.0
"""Mass of a robot of the second kind."""
TIMESTEP = 0.1


@pytest.fixture(scope="module")
def robot_files(tmp_path_factory):
    """Return the files of 24 light and 36 heavy robots, with their numbers."""
    return two_kinds(tmp_path_factory.mktemp("kinds"), N_ROBOTS)


def paths_of(robot_files):
    """Return the paths of robots' files, without the numbers of robots."""
    return [path for path, _ in files_of(robot_files)]


def engines(robot_files, n_worlds, n_robots):
    """Return the engines by their names; planar ones are read from one robot of each kind."""
    all_robots = compile_arena(SMALL, n_robots, np.zeros(0), robot_file=robot_files)
    one_of_each = compile_arena(SMALL, None, np.zeros(0), robot_file=robot_files)
    planar = PlanarEngine(SMALL, one_of_each, 1)
    planar.plane = planar.plane._replace(tolerance=1e-9)
    return {
        "mujoco": MujocoEngine(SMALL, all_robots, n_worlds, 1, n_robots),
        "numba": planar,
        "warp": read_engine(one_of_each, SMALL, jax.default_backend()),
    }


@pytest.mark.parametrize(("name", "atol"), [("mujoco", 1e-9), ("numba", 1e-9), ("warp", 2e-3)])
def test_kinds_of_different_mass_exchange_momentum(robot_files, name, atol):
    """A light robot and the second of two heavy ones meet head-on, overlapping by 0.05 mm.

    Drives reach their set points in the physics step, so that momentum beyond those comes from the
    contact alone.
    """
    masses = np.array([LIGHT, HEAVY, HEAVY])
    engine = engines(numbered(paths_of(robot_files), 1, 2), 1, len(masses))[name]
    poses = np.array([[(-1.0, 0.0, 0.0), (8.0, 8.0, 0.0), (1.15, 0.0, np.pi)]])
    set_points = np.array([[(1.4, 0, 0), (0, 0.5, 0), (-1.0, 0, 0)]])
    bodies = moved(engine, placed(engine, poses), set_points, 1).bodies

    velocities = (np.asarray(engine.poses(bodies)) - poses)[0] / TIMESTEP
    gained = masses[:, None] * (velocities - set_points[0])[:, :2]
    assert gained[2, 0] > 5
    np.testing.assert_allclose(gained.sum(axis=0), 0, atol=atol)
    np.testing.assert_allclose(gained[1], 0, atol=atol)


def test_a_file_twice_is_one_kind():
    """Motion and light are the same bit by bit."""
    path = models_directory() / "robot.xml"
    poses = place_robots(SMALL.arena, N_ROBOTS, np.random.default_rng(5))[None]
    outcomes = []
    for robot_files in (path, numbered((path, path), 20, N_ROBOTS - 20)):
        arena = compile_arena(SMALL, None, np.zeros(0), robot_file=robot_files)
        engine = PlanarEngine(SMALL, arena, 1)
        bodies = moved(engine, placed(engine, poses), (1.0, 0.3, 0.4)).bodies
        reading = engine.sense(bodies, np.ones((1, N_ROBOTS)), np.ones(1, bool))
        outcomes.append((bodies.poses, reading))

    assert jax.tree.all(jax.tree.map(np.array_equal, *outcomes))
    _, reading = outcomes[0]
    assert reading.links.valid.sum() > 20


class TestRobots:
    def test_have_consecutive_numbers(self, robot_files):
        robots = read_robots(robot_files)
        kinds = robots.kind_of(np.array([0, 23, 24, 59, 80]))
        assert kinds.tolist() == [0, 0, 1, 1, 1]

        light, heavy = paths_of(robot_files)
        three = read_robots(numbered([light, heavy, light], 2, 3, 4))
        assert three.kind_of(9).tolist() == [0, 0, 1, 1, 1, 2, 2, 2, 2]

    def test_have_attributes_of_their_kinds(self, robot_files):
        robots = read_robots(robot_files)
        tips = robots.each("probe_tip", np.array([23, 24]))
        np.testing.assert_allclose(tips, [[0.9, 0], [1.1, 0.1]])
        assert robots.each("mass", np.array([24, 0])).tolist() == [HEAVY, LIGHT]
        assert robots.circumradius == pytest.approx(np.hypot(*HALF))
        assert robots.inradius == 0.8

    def test_of_one_kind_are_a_robot(self, robot_files):
        robots = read_robots(robot_files)
        assert robots.part(24, 5) == read_robot(paths_of(robot_files)[1])
        assert robots.part(0, 24) == read_robot()

        of_both = robots.part(20, 10)
        assert of_both.kinds == robots.kinds
        assert of_both.kind_of(10).tolist() == [0] * 4 + [1] * 6

    def test_of_several_kinds_have_no_tip_in_common(self, robot_files):
        message = r'no probe_tip in common; use each\("probe_tip", n_robots\)'
        with pytest.raises(AttributeError, match=message):
            _ = read_robots(robot_files).probe_tip

    @pytest.mark.parametrize("difference", ["sides", "height"])
    def test_must_look_alike(self, difference):
        papers = read_robot()
        different_robots = {
            "sides": read_robot(models_directory() / "robot6.xml"),
            "height": replace(papers, half_edges=(1, 1, 0.4)),
        }
        message = "same height and number of sides, and LEDs and photodiodes that look"
        with pytest.raises(UserError, match=message):
            Mixed((papers, different_robots[difference]), (0, 1))

    def test_that_touch_one_are_bounded(self):
        """Around a large robot there is room for more small ones than around one of their size."""
        papers = read_robot()
        large = replace(papers, half_edges=(3.0, 3.0, 0.5))
        assert papers.most_partners == large.most_partners == 12
        assert Mixed((papers, large), (0, 1)).most_partners == 24
