"""A share of the robots fails at a control step, in any task and on any engine."""

import json
from dataclasses import replace

import numpy as np
import pytest
from support.page import CONFIG

from iswarm_mj.commands.main import parse
from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output.results import about
from iswarm_mj.simulation.failures import Failures
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.tasks.aggregation import Aggregation, Beeclust
from iswarm_mj.utils.errors import ConfigError

SCENARIO = Scenario(CONFIG, robots=20, engine=PlanarSettings(), seed=3, steps=9)


def alive_after_each_step(scenario, n_steps=4):
    """Return which robots of the first world are alive after each control step."""
    run = Run(scenario)
    records = [run.advance() for _ in range(n_steps)]
    return np.array([record.swarm.is_alive[0, 0] for record in records]), records


@pytest.mark.parametrize(
    "engine",
    [
        PlanarSettings(),
        pytest.param(MujocoSettings(), marks=pytest.mark.slow),
        pytest.param(MjxSettings().in_chunks(1), marks=pytest.mark.slow),
    ],
    ids=lambda engine: engine.name,
)
def test_a_quarter_fails_after_two_steps(engine):
    failing = replace(SCENARIO, engine=engine, failing="0.25:2")
    alive, records = alive_after_each_step(failing)
    assert alive.sum(axis=1).tolist() == [20, 20, 15, 15]
    _, healthy = alive_after_each_step(replace(failing, failing=None))
    for step in range(2):
        np.testing.assert_array_equal(records[step].poses, healthy[step].poses)


@pytest.mark.slow
def test_any_task_and_each_world_has_failures_of_its_own():
    scenario = replace(
        SCENARIO,
        task=Aggregation(spot_radius=4.0, spot_offset=7.0),
        strategy=Beeclust(),
        failing=Failures(0.5, 1),
        worlds=2,
    )
    run = Run(scenario, record_worlds=(0, 1))
    run.advance()
    record = run.advance()
    first, second = record.swarm.is_alive[0]
    assert first.sum() == second.sum() == 10
    assert not np.array_equal(first, second)


@pytest.mark.parametrize(
    "text", ["0.1", "0.1:", ":400", "nan:4", "0.1:4.5", "2:400", "0.1:-4", "0.1:400:3", "a:b", 7]
)
def test_other_texts_are_refused(text):
    with pytest.raises(ConfigError, match=r"failing must be SHARE:STEP, as 0\.1:400"):
        replace(SCENARIO, failing=text)


@pytest.mark.parametrize(
    "failures",
    [Failures(1e-5, 5), Failures(1, 5), Failures(np.float64(0.1), np.int64(5))],
)
def test_failures_are_read_from_their_own_text(failures):
    assert Failures.parse(str(failures)) == failures


@pytest.mark.parametrize("command", ["clean", "run", "play"])
def test_commands_files_and_scenarios_state_the_same(command, tmp_path):
    flags = ["--failing", "0.1:400", "--robots", "20"]
    scenario = parse([command, *flags]).scenario()
    assert scenario.failing == Failures(0.1, 400)
    assert scenario.values()["failing"] == "0.1:400"
    file = tmp_path / "a.toml"
    file.write_text(scenario.to_toml())
    assert Scenario.from_toml(file) == scenario
    assert parse([command, "--config", str(file)]).scenario() == scenario
    assert scenario.settings().failing == "0.1:400"


def test_results_state_failures_and_repeat_them(tmp_path):
    run = Run(replace(SCENARIO, failing="0.25:2"))
    file = tmp_path / "result.json"
    file.write_text(json.dumps(about(run)))
    assert Scenario.from_result(file).failing == Failures(0.25, 2)
    assert parse(["run", "--config", str(file)]).scenario().failing == Failures(0.25, 2)
