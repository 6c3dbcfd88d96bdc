"""Robots of two kinds in one swarm: hulls of 2 x 2 and 2.4 x 1.6 mm, 10 and 30 mg. Units: mm, mg, s."""

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

N = 60


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    return two_kinds(tmp_path_factory.mktemp("kinds"), N)


def few(file):
    """One robot of the first kind and two of the second."""
    return numbered([path for path, _ in files_of(file)], 1, 2)


def engines(file, n_worlds, n_robots):
    """The engines by their names; planar ones from one robot of each kind."""
    arena, one = (compile_arena(SMALL, n, np.zeros(0), robot_file=file) for n in (n_robots, None))
    planar = PlanarEngine(SMALL, one, 1)
    planar.plane = planar.plane._replace(tolerance=1e-9)
    return {
        "mujoco": MujocoEngine(SMALL, arena, n_worlds, 1, n_robots),
        "numba": planar,
        "warp": read_engine(one, SMALL, jax.default_backend()),
    }


@pytest.mark.parametrize("name", ["mujoco", "numba", "warp"])
def test_kinds_of_different_mass_exchange_momentum(file, name):
    """The last robot of the first kind and the second of the second one meet head-on, overlapping by 0.05 mm.

    Drives reach their set points in the physics step, so that momentum beyond those comes from the contact alone.
    """
    engine = engines(few(file), 1, 3)[name]
    poses = [[(-1.0, 0.0, 0.0), (8.0, 8.0, 0.0), (1.15, 0.0, np.pi)]]
    velocity = np.array([[(1.4, 0, 0), (0, 0.5, 0), (-1.0, 0, 0)]])
    steps = np.asarray(engine.poses(moved(engine, placed(engine, poses), velocity, 1).bodies)) - poses
    gained = np.array([10.0, 30.0, 30.0])[:, None] * (steps[0] / 0.1 - velocity[0])[:, :2]
    assert gained[2, 0] > 5
    np.testing.assert_allclose(gained.sum(axis=0), 0, atol=2e-3 if name == "warp" else 1e-9)
    np.testing.assert_allclose(gained[1], 0, atol=2e-3 if name == "warp" else 1e-9)


def test_a_file_twice_is_one_kind():
    """Bit by bit, in motion and light."""
    path, poses = models_directory() / "robot.xml", np.stack([place_robots(SMALL.arena, N, np.random.default_rng(5))])
    found = []
    for file in (path, numbered((path, path), 20, N - 20)):
        engine = PlanarEngine(SMALL, compile_arena(SMALL, None, np.zeros(0), robot_file=file), 1)
        motion = moved(engine, placed(engine, poses), (1.0, 0.3, 0.4))
        found.append((motion.bodies.poses, engine.sense(motion.bodies, np.ones((1, N)), np.ones(1, bool))))
    assert jax.tree.all(jax.tree.map(np.array_equal, *found)) and found[0][1].links.valid.sum() > 20


class TestRobots:
    def test_have_consecutive_numbers(self, file):
        robots = read_robots(file)
        assert robots.kind_of(np.array([0, 23, 24, 59, 80])).tolist() == [0, 0, 1, 1, 1]
        three = read_robots(numbered([path for path, _ in (*files_of(file), *files_of(file)[:1])], 2, 3, 4))
        assert three.kind_of(9).tolist() == [0, 0, 1, 1, 1, 2, 2, 2, 2]
        np.testing.assert_allclose(robots.each("probe_tip", np.array([23, 24])), [[0.9, 0], [1.1, 0.1]])
        assert robots.each("mass", np.array([24, 0])).tolist() == [30, 10]
        assert robots.circumradius == pytest.approx(np.hypot(*HALF)) and robots.inradius == 0.8

    def test_of_one_kind_are_a_robot(self, file):
        robots, heavy = read_robots(file), read_robot(files_of(file)[1][0])
        assert robots.part(24, 5) == heavy and robots.part(0, 24) == read_robot()
        some = robots.part(20, 10)
        assert some.kinds == robots.kinds and some.kind_of(10).tolist() == [0] * 4 + [1] * 6

    def test_of_several_kinds_have_no_tip_in_common(self, file):
        with pytest.raises(AttributeError, match=r'no probe_tip in common; use each\("probe_tip", n_robots\)'):
            _ = read_robots(file).probe_tip

    def test_must_look_alike(self, file):
        one = read_robot()
        for other in (
            read_robot(models_directory() / "robot6.xml"),
            replace(one, half_edges=(1, 1, 0.4)),
        ):
            with pytest.raises(UserError, match="same height and number of sides, and LEDs and photodiodes that look"):
                Mixed((one, other), (0, 1))

    def test_that_touch_one_are_bounded(self, file):
        """Around a large one there is room for more small ones than around their like."""
        one = read_robot()
        large = replace(one, half_edges=(3.0, 3.0, 0.5))
        assert one.most_partners == large.most_partners == 12 and Mixed((one, large), (0, 1)).most_partners == 24
