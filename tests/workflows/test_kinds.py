"""Two kinds of robots in one swarm: they clean, are recorded and drawn; swarms that cannot be are refused."""

import re
from dataclasses import dataclass, replace
from unittest.mock import MagicMock

import jax.numpy as jnp
import numpy as np
import pytest
from support.cli import code_of, refused, result
from support.robots import HALF, numbered, two_kinds
from support.small import FLAGS, SMALL

import iswarm_mj
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.robot_file import as_robot_file, files_of, models_directory, read_robots
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

N = 20  # eight of the first kind


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    return two_kinds(tmp_path_factory.mktemp("kinds"), N)


@pytest.fixture(scope="module")
def out(files, tmp_path_factory):
    """Directory of a run of 150 steps, with a recording."""
    out = tmp_path_factory.mktemp("clean")
    flags = [*FLAGS, "--engine=planar", "--impl=numba", "--threads=1", "--steps=150"]
    assert code_of("clean", *flags, "--out", out, "--robot", *files) == 0
    return out


def test_both_kinds_clean_with_their_own_tools(files, out):
    run, content = iswarm_mj.load(out), result(out)
    assert content["n_robots"] == N and content["robot"]["file"] == list(files)
    assert [kind["mass"] for kind in content["robot"]["kinds"]] == [10, 30]
    assert run.robot_file == files
    kinds = run.robots["kind"].to_numpy()[:N]
    assert kinds.tolist() == [0] * 8 + [1] * 12 == run.scene.kind.tolist()
    np.testing.assert_allclose(run.scene.robot_size[[7, 8]], [[2e-3, 2e-3, 1e-3], [2.4e-3, 1.6e-3, 1e-3]])
    step, ball = np.nonzero(run.arrays["ball_state"] == 1)
    holder = run.arrays["ball_holder"][step, ball]
    pose, at = run.arrays["pose"][step, holder], run.arrays["ball_position"][step, ball, :2]
    away = np.exp(-1j * pose[:, 2]) * ((at - pose[:, :2]) @ [1, 1j]) * 1e3
    assert {0, 1} == set(kinds[holder]) and (holder == 9).any()
    np.testing.assert_allclose(away, np.where(kinds[holder] == 0, 0.9, 1.1 + 0.1j), atol=1e-4)


def test_recordings_and_pictures_show_both_hulls(files, out, monkeypatch):
    """Pictures need the files of the run: their arena has the hull of each robot."""
    monkeypatch.setattr("mujoco.Renderer", MagicMock())
    run = iswarm_mj.load(out)
    sizes = {one.name: one.look for one in entities(run.scene)}[ROBOTS].half_sizes.as_arrow_array().to_pylist()
    np.testing.assert_allclose([sizes[7], sizes[8]], [[1, 1, 0.5], [1.2, 0.8, 0.5]])
    corners = outlines(np.zeros((N, 3)), run.scene.robot_size[:, :2])
    np.testing.assert_allclose(np.ptp(corners, axis=1)[[7, 8]], [[2e-3, 2e-3], [2.4e-3, 1.6e-3]])
    with ArenaRenderer(run.config, run.arrays, Shot(size=(64, 64)), run.robot_file) as stage:
        for robot, size in ((7, [1, 1]), (8, HALF)):
            np.testing.assert_allclose(stage.arena.model.geom(f"robot{robot}/substrate").size[:2], size)
    with pytest.raises(UserError, match="must be as large as those of the run"):
        ArenaRenderer(run.config, run.arrays, Shot(size=(64, 64)), files[::-1])


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


def test_teams_of_one_kind_are_given_its_robot(files):
    robots = read_robots(files)
    made = Teams({"small": (8, Forager()), "large": (12, Forager())}).for_world(SMALL, robots, N)
    assert [team.strategy.reach for team in made.teams] == [0.9, 1.1]
    made = Teams({"some": (10, Still()), "others": (10, Still())}).for_world(SMALL, robots, N)
    assert [team.strategy.masses for team in made.teams] == [(10.0,) * 8 + (30.0,) * 2, (30.0,) * 10]
    with pytest.raises(UserError, match="one length; make each kind of robots a team, or set"):
        Forager().for_world(SMALL, robots, N)


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


def test_tasks_are_told_the_kind_of_each_robot(files):
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
    assert run.metrics()["bright"] == pytest.approx(0.6) and run.metrics()["dim"] == 1


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["a.xml:12", "b.xml:8", "--robots=24"], "--robots must be as many as the kinds .* together, 20"),
        (["a.xml:12", "b.xml:0"], "--robot must be a file, or FILE:ROBOTS with at least one robot for each"),
        (["a.xml:12", "b.xml:8", "--density=0.1"], "numbers of robots in --robot and --density exclude"),
        (["a.xml:12", "c.xml:8"], "the robot's file .*c.xml cannot be read"),
        (["a.xml:12", f"{models_directory()}/robot6.xml:8"], "must have the same height and number of sides"),
    ],
)
def test_swarms_that_cannot_be_are_refused(words, says, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    for name in ("a.xml", "b.xml"):
        (tmp_path / name).write_text((models_directory() / "robot.xml").read_text())
    assert re.search(says, refused(capfd, tmp_path, "clean", *FLAGS, "--robot", *words))


@pytest.mark.parametrize("given", [[], ["a.xml:0"], ["a.xml:2.5"], [(3, 2)], ("a.xml:3", "b.xml"), 3])
def test_files_that_are_none_are_refused(given):
    with pytest.raises(ConfigError, match="robot_file must be"):
        as_robot_file(given)
