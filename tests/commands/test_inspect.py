"""`iswarm inspect`: what ran, measures, faults, files and how to open them."""

import importlib.util
import json
import os
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pyarrow.parquet
import pytest

import iswarm_mj
from iswarm_mj.commands.main import main
from iswarm_mj.experiments.analysis.evolution import best_of
from iswarm_mj.experiments.report.inspection import inspection
from iswarm_mj.experiments.runner.journal import Journal
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.tables import read_table

ROOT = Path(__file__).parents[2]
RUN = "clean --engine planar --impl numba --arena.size 15 --arena.dump-size 3 --arena.dust-area-size 3 "
RUN += "--arena.dust-area-offset 5 --arena.n-dust 24 --robots 20 --steps 12 --out"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("runs") / "of mine"
    main([*RUN.split(), str(out)])
    return out


def test_a_run(run, capfd):
    main(["inspect", str(run)])
    text = capfd.readouterr().out
    content = json.loads((run / "result.json").read_text())
    assert text.startswith("cleaning run with the paper's strategy on planar, version ")
    assert f"picked up {content['picked']}" in text and "20 in 1 world(s), seed 0" in text
    lines = {line.split("  ")[0]: line for line in text.splitlines() if "." in line.split("  ")[0]}
    assert f"rerun {shlex.quote(str(run / 'clean.rrd'))}" in lines["clean.rrd"]


def test_the_ways_to_open_files_work(run):
    text = inspection(run)
    (python,) = (line for line in text.splitlines() if line.startswith("trajectory.npz"))
    call = python.split(": ", 1)[1].split(", .balls")[0]
    assert eval(call, {"iswarm_mj": iswarm_mj}).num_rows == 20 * 13
    table = ROOT / "results/hop-count/hop_count.parquet"
    (parquet,) = (line for line in inspection(table.parent).splitlines() if line.startswith("hop_count.parquet"))
    assert eval(parquet.split("table: ")[1], {"pyarrow": pyarrow}).num_rows == 24
    again = next(line for line in text.splitlines() if line.startswith("result.json")).split("; iswarm ")[1]
    command = shlex.split(again.removesuffix(" repeats it"))
    main([*command, "--steps", "2", "--no-record", "--out", str(run.parent / "again")])
    assert json.loads((run.parent / "again/result.json").read_text())["steps"] == 2


@pytest.mark.parametrize("below", [False, True])
def test_all_recordings_open_at_once(run, tmp_path, below):
    out = tmp_path / "it's $HOME"
    shutil.copytree(run, out)
    assert "as one dataset" not in inspection(out)
    for world in (2, 11):
        shutil.copytree(run, out / f"world-{world}", ignore=lambda *_: ["result.json"])
    (line,) = (line for line in inspection(tmp_path if below else out).splitlines() if "all 3 recordings" in line)
    opened = subprocess.run(["sh", "-c", line.split(": ")[1].replace("rerun", "ls -1")], capture_output=True, text=True)
    assert opened.stdout.splitlines() == [str(out / name / "clean.rrd") for name in ("", "world-11", "world-2")]


def test_runs_below_a_directory_say_how_to_open_their_recordings(run):
    assert f"  recording: rerun {shlex.quote(str(run))}/clean.rrd" in inspection(run.parent).splitlines()


def test_a_run_of_another_task(run, tmp_path):
    content = json.loads((run / "result.json").read_text())
    content = {name: value for name, value in content.items() if name not in ("delivered", "picked")}
    content |= {"task": {"class": "gather.py:Gather"}, "metrics": {"close": [0.5]}}
    (tmp_path / "result.json").write_text(json.dumps(content))
    assert inspection(tmp_path).startswith("run of a task with the paper's strategy on planar, version ")
    assert "close  0.5" in inspection(tmp_path) and "; iswarm run --config" in inspection(tmp_path)


def test_an_interrupted_run_with_a_fault(run, tmp_path):
    content = json.loads((run / "result.json").read_text())
    content |= {"interrupted": True, "steps": 7, "faults": ["step 7, world 0: the contact solver failed"]}
    content |= dict.fromkeys(("delivered", "picked", "collisions", "fitness"))
    (tmp_path / "result.json").write_text(json.dumps(content))
    text = inspection(tmp_path)
    assert "interrupted after 7 of 12 control steps" in text
    assert "fault: step 7, world 0: the contact solver failed" in text


def test_experiments_searches_and_trials_below_a_directory():
    text = inspection(ROOT / "results-initial")
    assert "experiment hop-count" in text and "12 of 12 runs" in text and "holds: " in text
    assert "search by paper: 19200 runs, 120 of 120 generations" in text
    assert "1500 trials of grasp and release on mujoco" in inspection(ROOT / "results/grasp")


def test_the_best_of_a_search_with_replicates_is_the_mean_of_its_genome():
    """And not the fitness of a single lucky run."""
    best = best_of(read_table(ROOT / "results/evolve-paper/evolution.parquet")[0])
    told = f"best {best.fitness:.0f} on average over its {best.n_runs} run(s), in best.json; version "
    assert told in inspection(ROOT / "results/evolve-paper")


def journal_of_two(path):
    with Journal(path, {}) as journal:
        for key in range(2):
            journal.add((key,), 0.0)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("runs.sqlite", "2 finished runs of an experiment are kept in runs.sqlite; the same command goes on"),
        ("checkpoint.sqlite", "2 finished runs of a search .*; the same command with --resume goes on"),
    ],
)
def test_interrupted_experiments_and_searches(tmp_path, name, says):
    journal_of_two(tmp_path / name)
    assert re.search(says, inspection(tmp_path))


@pytest.mark.parametrize("ended", [False, True])
def test_a_search_that_was_killed_has_a_table(tmp_path, ended):
    for name in ("evolution.parquet", "best.json")[: 1 + ended]:
        shutil.copy(ROOT / "results/evolve-cmaes" / name, tmp_path)
    journal_of_two(tmp_path / "checkpoint.sqlite")
    text = inspection(tmp_path)
    assert ("interrupted: 2 finished runs of a search" in text and "--resume goes on" in text) != ended


def test_a_damaged_table_is_named(tmp_path):
    shutil.copy(ROOT / "results/hop-count/findings.csv", tmp_path / "hop_count.parquet")
    assert "hop_count.parquet is not a readable table of iswarm" in inspection(tmp_path)


@pytest.mark.parametrize("name", ["none", ""])
def test_directories_without_results(tmp_path, name):
    with pytest.raises(UserError, match=r"is no directory|holds no results"):
        inspection(tmp_path / name)


def test_a_run_that_was_read_can_be_recorded_again(run):
    """As `tools/recording_cost.py` does to say what a recorded step costs."""
    spec = importlib.util.spec_from_file_location("recording_cost", ROOT / "tools/recording_cost.py")
    tool = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tool)
    n_steps, size, milliseconds = tool.cost(run)
    assert n_steps == 13 and milliseconds > 0
    assert (run / "clean.rrd").stat().st_size / 3 < n_steps * size < (run / "clean.rrd").stat().st_size


@pytest.mark.parametrize("faults", [3, {"a": 1}, "x"])
def test_faults_that_are_no_list(run, tmp_path, faults):
    content = json.loads((run / "result.json").read_text())
    (tmp_path / "result.json").write_text(json.dumps({**content, "faults": faults}))
    assert "its faults cannot be read" in inspection(tmp_path)


def test_a_pipe_is_no_result(tmp_path):
    os.mkfifo(tmp_path / "result.json")
    with pytest.raises(UserError, match="holds no results"):
        inspection(tmp_path)


@pytest.mark.parametrize("name", ["hop-count/hop_count.parquet", "evolve-cmaes/evolution.parquet"])
def test_a_table_without_a_column_is_named(tmp_path, name):
    table = pyarrow.parquet.read_table(ROOT / "results" / name)
    path = tmp_path / Path(name).name
    for column in table.column_names:
        pyarrow.parquet.write_table(table.drop_columns([column]), path)
        assert str(path.name) in inspection(tmp_path)


def test_what_is_read_controls_no_terminal(run, tmp_path, capfd):
    content = json.loads((run / "result.json").read_text())
    (tmp_path / "result.json").write_text(json.dumps({**content, "version": "\x1b[2J", "faults": ["\x1b[2J"]}))
    main(["inspect", str(tmp_path)])
    assert "\x1b" not in capfd.readouterr().out
