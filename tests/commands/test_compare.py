"""`iswarm compare`: candidates of all kinds, with the flags of the runs.

What is refused stands in refusals.txt; statistics are tested in tests/search.
"""

import json
import re
from pathlib import Path

import pytest
from support.cli import ARENA_FLAGS, WALK, code_of
from support.small import SMALL

import iswarm_mj as im
import iswarm_mj.search.compare as compare_module
from iswarm_mj.commands.compare import Compare
from iswarm_mj.utils import intervals

FLAGS = [*ARENA_FLAGS, "--engine=planar", "--steps=4", "--robots=6"]
CONFIG = """
steps = 4
robots = 6
engine = "planar"
threads = 1
seed = 3
[arena]
size = 15
dump_size = 3
dust_area_size = 3
dust_area_offset = 5
n_dust = 24
"""


@pytest.fixture(autouse=True)
def _few_resamples(monkeypatch):
    monkeypatch.setattr(intervals, "RESAMPLES", 99)


@pytest.fixture
def scenarios(monkeypatch):
    """Return a list that the scenarios of candidates are added to, which end a comparison."""
    gathered = []

    def gather(candidates, plan, out, *, again):
        for candidate in candidates:
            gathered.append(None if candidate.make is None else candidate.make.args[0])
        raise KeyboardInterrupt

    monkeypatch.setattr(compare_module, "gather", gather)
    return gathered


def content(path="runs/compare"):
    return json.loads((Path(path) / "compare.json").read_text())


@pytest.mark.slow
def test_strategies_a_finished_run_and_a_file_in_the_same_worlds(here, capfd):
    """A strategy of the user's, with the settings of a run that it is compared with."""
    (here / "walk.py").write_text(WALK)
    (here / "b.toml").write_text(f"record = false\n{CONFIG}")
    assert code_of("run", *FLAGS, "--seed=3", "--worlds=3", "--no-record", "--out=runs/a") == 0
    capfd.readouterr()

    assert code_of("compare", "runs/a", "walk.py:Walk", "b.toml", "--worlds=3") == 0
    result = content()
    assert result["candidates"] == ["runs/a", "Walk", "b"]
    assert result["differ_in"] == {"Walk": ["strategy"], "b": []}
    effects = result["effects"]
    assert effects["Walk"]["collisions"]["is_paired"]
    assert effects["b"]["collisions"]["difference"] == {"estimate": 0, "low": 0, "high": 0}
    assert "b and runs/a have the same settings." in capfd.readouterr().out
    assert code_of("inspect", "runs/compare") == 0
    assert "comparison of runs/a, Walk, b" in capfd.readouterr().out
    names = {path.name for path in Path("runs/compare").iterdir()}
    assert names == {f"compare.{suffix}" for suffix in ("csv", "json", "parquet", "png", "svg")} | {
        "runs.sqlite"
    }


def test_candidates_are_strategies_tasks_genomes_files_and_teams(here, scenarios):
    (here / "walk.py").write_text(WALK)
    (here / "b.toml").write_text(CONFIG)
    (here / "own.json").write_text(json.dumps({"fraction_scouts": 0.5}))
    words = ["type2", "walk.py:Walk", "own.json", "b.toml", "walk.py:Walk=0.5 type2=0.5"]
    code_of("compare", *words, "aggregation", *FLAGS[-1:])
    genome, walk, own, toml, teams, task = scenarios
    assert genome.strategy == im.PRESETS["type2"]
    assert type(walk.strategy).__name__ == "Walk"
    assert own.strategy.fraction_scouts == 0.5
    assert toml.seed == 3 and toml.config.arena.size == 15
    assert [team.name for team in teams.strategy.teams] == ["Walk", "type2"]
    assert type(task.task).__name__ == "Aggregation"
    assert {scenario.n_robots for scenario in scenarios} == {6}


def test_flags_of_the_comparison_stand_anywhere(here):
    command = Compare.parse(
        ["--worlds", "8", "type1", "--again", "type2", "--seed", "4", "--measure", "picked"]
    )
    assert command.candidates == ("type1", "type2")
    assert (command.worlds, command.again, command.measure) == (8, True, "picked")
    assert command.command_arguments == ("--seed", "4")


@pytest.mark.parametrize(
    "flags",
    [["--no-record"], ["--optics.serial-photodiodes"], ["--optics.no-parity-check"], ["--steps=9"]],
)
def test_switches_of_runs_take_no_candidate(flags):
    command = Compare.parse(["type1", *flags, "type2", "--seed", "4"])
    assert command.candidates == ("type1", "type2")
    assert command.command_arguments == (*flags, "--seed", "4")


def test_names_of_files_may_have_blanks(here, scenarios):
    """A word with blanks names teams, unless there is such a file."""
    (here / "my dir").mkdir()
    (here / "my dir/walk.py").write_text(WALK)
    (here / "my own.json").write_text(json.dumps({"fraction_scouts": 0.5}))
    code_of("compare", "my dir/walk.py:Walk", "my own.json", *FLAGS[-1:])
    walk, own = scenarios
    assert type(walk.strategy).__name__ == "Walk"
    assert own.strategy.fraction_scouts == 0.5


def test_teams_may_end_like_a_file(here, capfd):
    assert code_of("compare", "type1", "type2 own.json") == 2
    assert "--strategy must be" in capfd.readouterr().err


def test_an_error_of_a_candidate_names_it(here, capfd):
    (here / "walk.py").write_text(WALK.replace("jnp.full_like(memory, self.speed)", "seen.nothing"))
    assert code_of("compare", "type1", "walk.py:Walk", *FLAGS, "--worlds=2") == 2
    error = capfd.readouterr().err.splitlines()[-1]
    assert re.match(r"iswarm: Walk: .*nothing.*walk\.py", error), error


def test_what_one_candidate_refuses_costs_no_run(here, capfd, monkeypatch):
    """Only the second of these strategies needs another task."""
    monkeypatch.delattr(compare_module, "rows_of_run")
    assert code_of("compare", "type1", "beeclust", *FLAGS, "--worlds=2") == 2
    error = capfd.readouterr().err
    assert error.startswith("iswarm: beeclust: Beeclust follows the light of the task aggregation")


def test_python_compares_scenarios_strategies_and_files(here, monkeypatch):
    """Runs are pretended; each candidate has the scenario that its value describes."""
    made = []

    def rows_of_run(run):
        made.append(run)
        row = {"seed": 0, "n_robots": 6, "max_steps": 4, "goal": 1, "collisions": len(made)}
        return [{**row, "world": k, "finished_at": k + 1, "fault": None} for k in range(2)]

    monkeypatch.setattr(compare_module, "Run", lambda scenario, record_worlds: scenario)
    monkeypatch.setattr(compare_module, "rows_of_run", rows_of_run)
    monkeypatch.setattr(compare_module, "about", lambda scenario: {"engine": scenario.engine.name})
    (here / "b.toml").write_text(CONFIG)
    base = im.Scenario(robots=6, steps=4)
    candidates = {
        "type 1": im.PRESETS["type1"],
        "file": "b.toml",
        "task": im.Aggregation(),
        "other": im.Scenario(robots=7, steps=4),
    }
    comparison = im.compare(candidates, base, worlds=2, out="here")
    assert comparison.names == [*candidates]
    assert [scenario.robots for scenario in made] == [6, 6, 6, 7]
    assert made[0].strategy == im.PRESETS["type1"] and made[2].task == im.Aggregation()
    assert comparison.differs_in("file") == ["engine"]
    assert content("here")["worlds"] == dict.fromkeys(candidates, 2)


@pytest.mark.parametrize(
    ("candidates", "plan", "message"),
    [
        ({"a": "type1"}, {}, "a directory of a run, or a TOML file"),
        ({}, {}, "candidates must be at least two"),
        ({"a": im.PRESETS["type1"], "b": im.PRESETS["type2"]}, {"world": 3}, "'world'"),
        ({"a": im.PRESETS["type1"], "b": im.PRESETS["type2"]}, {"worlds": 1}, "between 2 and"),
    ],
)
def test_python_refuses_in_one_sentence(candidates, plan, message):
    with pytest.raises(im.UserError, match=message):
        im.compare(candidates, **plan)


@pytest.mark.slow
@pytest.mark.parametrize("engine", [im.PlanarSettings(threads=1), im.MujocoSettings(threads=1)])
def test_worlds_that_are_added_are_those_of_one_run(engine):
    """Of any engine, and also for a strategy that is no genome."""
    scenario = im.Scenario(
        SMALL,
        task=im.Aggregation(spot_radius=3.0, spot_offset=4.0),
        robots=20,
        steps=12,
        seed=4,
        engine=engine,
    )
    candidates = {"genome": im.PRESETS["type1"], "bees": im.Beeclust()}
    plan = {"measure": "collisions", "worlds": 2, "precision": 1e-9, "max_worlds": 5}
    added = im.compare(candidates, scenario, **plan)
    at_once = im.compare(candidates, scenario, worlds=4)
    assert added.rows() == at_once.rows()
    assert len(added.rows()) == 8
