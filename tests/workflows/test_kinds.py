"""Two kinds of robots in one swarm: they clean, are recorded and drawn, and fit together."""

from dataclasses import dataclass, replace
from unittest.mock import MagicMock

import jax.numpy as jnp
import numpy as np
import pytest
from support.cli import code_of, result
from support.robots import HALF, numbered, two_kinds
from support.small import FLAGS, SMALL

import iswarm_mj
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.robot_file import as_robot_file, files_of, read_robots
from iswarm_mj.output.offscreen import ArenaRenderer, Shot
from iswarm_mj.output.plot_swarm import outlines
from iswarm_mj.output.rerun_entities import entities
from iswarm_mj.output.schema import ROBOTS
from iswarm_mj.simulation.layout_checks import check_poses
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command
from iswarm_mj.strategy.teams import Teams
from iswarm_mj.tasks.aggregation import Aggregation, Spots
from iswarm_mj.tasks.foraging import Forager
from iswarm_mj.utils.errors import ConfigError, UserError

N = 20
"""Number of robots, of which eight are of the first kind."""
SIZES = [[2e-3, 2e-3, 1e-3], [2.4e-3, 1.6e-3, 1e-3]]
"""Size of each kind [m]."""
LAST_OF_FIRST_KIND = 7
FIRST_OF_SECOND_KIND = 8
BORDER = [LAST_OF_FIRST_KIND, FIRST_OF_SECOND_KIND]
SMALL_SHOT = Shot(size=(64, 64))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Files of both kinds with their numbers of robots."""
    return two_kinds(tmp_path_factory.mktemp("kinds"), N)


@pytest.fixture(scope="module")
def out(files, tmp_path_factory):
    """Directory of a run of 150 steps, with a recording."""
    out = tmp_path_factory.mktemp("clean")
    flags = [*FLAGS, "--engine=planar", "--impl=numba", "--threads=1", "--steps=150"]
    assert code_of("clean", *flags, "--out", out, "--robot", *files) == 0
    return out


@pytest.fixture(scope="module")
def run(out):
    return iswarm_mj.load(out)


class TestRun:
    def test_results_name_both_files(self, files, out, run):
        content = result(out)
        assert content["n_robots"] == N
        assert content["robot"]["file"] == list(files)
        assert [kind["mass"] for kind in content["robot"]["kinds"]] == [10, 30]
        assert run.robot_file == files

    def test_trajectories_have_the_kind_and_size_of_each_robot(self, run):
        kinds = [0] * 8 + [1] * 12
        assert run.robots["kind"].to_pylist()[:N] == kinds == run.scene.kind.tolist()
        np.testing.assert_allclose(run.scene.robot_size[BORDER], SIZES)

    def test_both_kinds_hold_balls_with_their_own_tools(self, run):
        """The tool of the second kind is farther ahead, and to the left."""
        step, ball = np.nonzero(run.arrays["ball_state"] == 1)
        holder = run.arrays["ball_holder"][step, ball]
        kind = run.scene.kind[holder]
        assert {0, 1} == set(kind) and (holder == 9).any()

        pose = run.arrays["pose"][step, holder]
        offset = run.arrays["ball_position"][step, ball, :2] - pose[:, :2]
        in_own_frame = np.exp(-1j * pose[:, 2]) * (offset @ [1, 1j]) * 1e3
        tools = np.where(kind == 0, 0.9, 1.1 + 0.1j)
        np.testing.assert_allclose(in_own_frame, tools, atol=1e-4)


class TestDrawings:
    """Recordings, plans and pictures show the hulls of both kinds."""

    def test_recordings(self, run):
        looks = {entity.name: entity.look for entity in entities(run.scene)}
        half_sizes = np.array(looks[ROBOTS].half_sizes.as_arrow_array().to_pylist())
        np.testing.assert_allclose(half_sizes[BORDER], [[1, 1, 0.5], [1.2, 0.8, 0.5]])

    def test_plans(self, run):
        corners = outlines(np.zeros((N, 3)), run.scene.robot_size[:, :2])
        extents = np.ptp(corners, axis=1)
        np.testing.assert_allclose(extents[BORDER], [size[:2] for size in SIZES])

    def test_pictures(self, run, monkeypatch):
        monkeypatch.setattr("mujoco.Renderer", MagicMock())
        renderer = ArenaRenderer(run.config, run.arrays, SMALL_SHOT, run.robot_file)
        with renderer:
            for robot, half_size in ((LAST_OF_FIRST_KIND, [1, 1]), (FIRST_OF_SECOND_KIND, HALF)):
                hull = renderer.arena.model.geom(f"robot{robot}/substrate")
                np.testing.assert_allclose(hull.size[:2], half_size)

    def test_pictures_need_the_files_of_the_run(self, files, run, monkeypatch):
        monkeypatch.setattr("mujoco.Renderer", MagicMock())
        with pytest.raises(UserError, match="must be as large as those of the run"):
            ArenaRenderer(run.config, run.arrays, SMALL_SHOT, files[::-1])


def test_a_run_continues_from_its_results(out, tmp_path, monkeypatch):
    """`--config` takes the kinds and their numbers from a result.json."""
    monkeypatch.chdir(tmp_path)
    assert code_of("clean", "--config", out / "result.json", "--steps=3", "--out=again") == 0
    assert result("again")["robot"] == result(out)["robot"]


@dataclass(frozen=True)
class Still(Strategy):
    """Robots that stand still and know their kinds."""

    masses: tuple = ()

    def for_world(self, config, robot, n_robots):
        return replace(self, masses=tuple(robot.each("mass", n_robots).tolist()))

    def init(self, n_robots, key):
        return jnp.asarray(self.masses)

    def picks(self, memory):
        return memory < 0

    def act(self, memory, seen, key):
        return memory, Command(jnp.zeros_like(memory), jnp.zeros_like(memory))


class TestTeams:
    def test_those_of_one_kind_get_its_robot(self, files):
        robots = read_robots(files)
        teams = Teams({"small": (8, Forager()), "large": (12, Forager())})
        in_world = teams.for_world(SMALL, robots, N)
        assert [team.strategy.reach for team in in_world.teams] == [0.9, 1.1]

    def test_those_of_several_kinds_get_all_their_robots(self, files):
        robots = read_robots(files)
        teams = Teams({"some": (10, Still()), "others": (10, Still())})
        in_world = teams.for_world(SMALL, robots, N)
        masses = [team.strategy.masses for team in in_world.teams]
        assert masses == [(10.0,) * 8 + (30.0,) * 2, (30.0,) * 10]

    def test_a_strategy_for_one_kind_asks_for_teams(self, files):
        message = "one length; make each kind of robots a team, or set"
        with pytest.raises(UserError, match=message):
            Forager().for_world(SMALL, read_robots(files), N)


@pytest.mark.parametrize(("x", "fits"), [(2.2, True), (2.1, False)])
def test_starts_are_checked_with_the_hulls_of_both(files, x, fits):
    robots = read_robots(numbered([path for path, _ in files_of(files)], 1, 2))
    poses = np.array([(0.0, 0, 0), (9, 9, 0), (x, 0, 0)])
    if fits:
        check_poses("poses", poses, robots, SMALL.arena)
    else:
        with pytest.raises(ConfigError, match=r"robots 0 at .* and 2 at"):
            check_poses("poses", poses, robots, SMALL.arena)


@dataclass(frozen=True)
class Counts(Aggregation):
    """Measures the share of the second kind, and the kind of robot 9."""

    def advance(self, state, inputs, key):
        shares = jnp.stack([inputs.kind.mean(), inputs.kind[9].astype(jnp.float32)])
        return Spots(state.east, shares), super().advance(state, inputs, key)[1]


def test_tasks_know_the_kind_of_each_robot(files):
    run = Run(
        Scenario(
            SMALL,
            strategy=Still(),
            task=Counts(4.0, 3.0),
            robots=N,
            robot_file=files,
            engine=PlanarSettings(1),
            steps=1,
        )
    )
    run.advance()
    assert run.metrics()["bright"] == pytest.approx(0.6)
    assert run.metrics()["dim"] == 1


@pytest.mark.parametrize(
    "robot_file", [[], ["a.xml:0"], ["a.xml:2.5"], [(3, 2)], ("a.xml:3", "b.xml"), 3]
)
def test_files_that_are_none_are_refused(robot_file):
    with pytest.raises(ConfigError, match="robot_file must be"):
        as_robot_file(robot_file)
