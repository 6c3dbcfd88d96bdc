"""Swarms whose grippers have another tip: flags, files, results, repetition, and other features."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.cli import code_of, refused, result
from support.small import FLAGS, SMALL

import iswarm_mj as im
from iswarm_mj.commands.main import parse
from iswarm_mj.config.swarm import GripperConfig
from iswarm_mj.gripper.tips.table import read_table
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.shared_settings import static_config
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import TYPE1
from iswarm_mj.tasks.layout import balls_on_floor
from iswarm_mj.utils.errors import UserError

TIP = Path(__file__).parents[2] / "examples/best-tip/tip.json"
STEPS = 40
RUN = ["clean", "--engine=planar", *FLAGS, f"--steps={STEPS}", "--no-record"]


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    """Directory with the table of the best tip, in which commands run."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(TIP, "tip.json")
    return tmp_path


def weaken(path):
    """Change a table so that its tip lifts nothing."""
    content = json.loads(Path(path).read_text())
    content["pick"] = (1e-4 * np.array(content["pick"])).tolist()
    Path(path).write_text(json.dumps(content))


def scenario(**gripper):
    config = replace(SMALL, gripper=GripperConfig(**gripper))
    return Scenario(config, robots=30, steps=STEPS, engine=im.PlanarSettings())


def n_picked(scenario):
    """Return the number of balls that each world of a run picks up."""
    run = Run(scenario, record_worlds=())
    while not run.is_over:
        run.advance()
    balls = run.task.balls(run.task_state)
    return np.asarray(balls.was_picked).sum(axis=-1)


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    """Directory of the results of a run with the best tip."""
    out = tmp_path_factory.mktemp("first")
    arguments = [f"--gripper.tip={TIP}", "--robots=30", "--worlds=2"]
    assert code_of(*RUN, *arguments, f"--out={out}") == 0
    return out


def test_a_run_states_its_tip_and_is_repeated(first):
    content = result(first)
    assert content["config"]["gripper"]["tip"] == str(TIP)
    assert len(content["gripper_tip"]["sha256"]) == 64

    repetition = ["clean", f"--config={first}/result.json", "--no-record"]
    assert code_of(*repetition, "--out=again") == 0
    again = result("again")
    for key in ("metrics", "steps", "gripper_tip"):
        assert again[key] == content[key]
    assert Scenario.from_result(first / "result.json").config.gripper.tip == str(TIP)


def test_a_repetition_with_another_table_is_refused(here, capfd, first):
    content = result(first)
    content["config"]["gripper"]["tip"] = str(here / "tip.json")
    (here / "result.json").write_text(json.dumps(content))
    assert Scenario.from_result("result.json").config.gripper.tip == str(here / "tip.json")

    weaken("tip.json")
    error = refused(capfd, here, "clean", "--config=result.json", "--out=again")
    assert "tip.json is not the table that the run had" in error
    with pytest.raises(UserError, match="is not the table that the run had"):
        Scenario.from_result("result.json")

    # Another tip may be named instead.
    command = parse(["clean", "--config=result.json", f"--gripper.tip={TIP}"])
    assert command.gripper.tip == str(TIP)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--gripper.tip=none.json"], "none.json"),
        (["--gripper.tip=fit.toml"], "name the tip.json that `iswarm tip --table` writes"),
        (["--gripper.tip="], "the name of a file"),
        (["--gripper.tip=tip.json", "--arena.ball-radius-min=5e-6"], "from 1e-05 to 5e-05 m"),
        (["--gripper.tip=tip.json", "--arena.ball-radius-max=6e-5"], "from 1e-05 to 5e-05 m"),
    ],
)
def test_wrong_files_and_balls_are_refused(here, capfd, arguments, words):
    (here / "fit.toml").write_text("[gripper]\nwork_tool_object = 2e-3\n")
    assert words in refused(capfd, here, *RUN, *arguments)


def test_files_of_settings_and_python_name_the_tip(here):
    (here / "fit.toml").write_text(
        "[gripper]\nwork_tool_object = 2e-3\n[grasp]\nwork_tool_object = 2e-3\n"
    )
    (here / "swarm.toml").write_text('steps = 5\n[gripper]\ntip = "tip.json"\n')
    of_file = Scenario.from_toml("swarm.toml")
    assert of_file.config.gripper == GripperConfig(tip=here / "tip.json")
    assert 'tip = "' in of_file.to_toml()

    # The works of a fit, at a flat tip, times the share of the shape.
    gripper = parse(["clean", "--config=fit.toml", "--gripper.tip=tip.json"]).gripper
    assert gripper == GripperConfig(tip=here / "tip.json", work_tool_object=2e-3)
    balls = balls_on_floor(gripper, np.zeros((1, 2)), np.array([20e-6]))
    share = read_table("tip.json").adhesion_share(20e-6)
    np.testing.assert_allclose(balls.work_tool_object, 2e-3 * share, rtol=3e-3)


def test_programs_are_of_the_table_that_the_file_has():
    config = replace(SMALL, gripper=GripperConfig(tip="tip.json"))
    first = static_config(config, on_host=True)
    assert static_config(config, on_host=True) == first
    weaken("tip.json")
    assert static_config(config, on_host=True) != first


@pytest.mark.slow
@pytest.mark.parametrize("resolution", ["quasi-static", "dynamic"])
def test_a_new_table_in_the_same_file_holds_from_the_next_run_on(resolution):
    """Programs that were compiled for the earlier table are not used again."""
    given = scenario(tip="tip.json", resolution=resolution, bench="c", grasp_voltage=50.0)
    assert n_picked(given)[0] > 3
    weaken("tip.json")
    assert n_picked(given)[0] == 0


@pytest.mark.parametrize(
    "engine",
    [im.PlanarSettings(), pytest.param(im.MujocoSettings(), marks=pytest.mark.slow)],
)
def test_worlds_of_several_voltages_share_the_tip(engine):
    """At 20 V the tip, whose balls take 31 V, lifts fewer balls than at 45 V."""
    weak = replace(SMALL, gripper=GripperConfig(tip=str(TIP), grasp_voltage=20.0))
    strong = replace(SMALL, gripper=GripperConfig(tip=str(TIP), grasp_voltage=45.0))
    worlds = [World(TYPE1, 30, seed=1, config=config) for config in (weak, strong)]
    given = Scenario(weak, worlds=worlds, steps=STEPS, engine=engine)
    picked_weak, picked_strong = n_picked(given)
    assert picked_weak < picked_strong


def test_worlds_of_one_run_have_one_tip():
    with_tip = replace(SMALL, gripper=GripperConfig(tip=str(TIP)))
    other = replace(SMALL, gripper=GripperConfig(tip="tip.json"))
    worlds = [World(TYPE1, 30, seed=1, config=config) for config in (with_tip, other)]
    with pytest.raises(UserError, match=r"differs from its run in gripper\.tip"):
        n_picked(Scenario(with_tip, worlds=worlds, steps=1, engine=im.PlanarSettings()))


def test_environments_refuse_what_is_no_tip(here):
    (here / "tip.json").write_text("{}")
    with pytest.raises(UserError, match="is no table of a tip"):
        im.make_env(scenario(tip="tip.json"))


@pytest.mark.slow
def test_trials_of_a_swarm_with_a_tip_are_recorded():
    arguments = ["--gripper.tip=tip.json", "--gripper.resolution=dynamic", "--record-grasps=3"]
    command = [*RUN[:-1], *arguments, "--out=out"]
    assert code_of(*command) == 0
    assert Path("out/clean.rrd").stat().st_size > 10_000
