"""`iswarm inspect`: what ran, measures, faults, files and how to open them."""

import json
import re
import shlex
import shutil
import subprocess
from pathlib import Path

import pyarrow.parquet
import pytest

import iswarm_mj
from iswarm_mj.commands.config_file import ConfigFile
from iswarm_mj.commands.main import main
from iswarm_mj.paper.report.inspection import describe_directory
from iswarm_mj.search.journal import journal
from iswarm_mj.utils.errors import UserError

ROOT = Path(__file__).parents[2]
N_ROBOTS = 20
N_STEPS = 12
RUN = [
    "clean",
    "--engine=planar",
    "--impl=numba",
    "--arena.size=15",
    "--arena.dump-size=3",
    "--arena.dust-area-size=3",
    "--arena.dust-area-offset=5",
    "--arena.n-dust=24",
    f"--robots={N_ROBOTS}",
    f"--steps={N_STEPS}",
]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return the directory of a run, whose name has a space."""
    out = tmp_path_factory.mktemp("runs") / "of mine"
    main([*RUN, "--out", str(out)])
    return out


@pytest.fixture
def result(run):
    """Return the content of its result.json."""
    return json.loads((run / "result.json").read_text())


def write_result(directory, content):
    """Write a result.json."""
    (directory / "result.json").write_text(json.dumps(content))


def line_about(file, directory):
    """Return the only line of a directory's summary that begins with the name of a file."""
    (line,) = (line for line in describe_directory(directory).splitlines() if line.startswith(file))
    return line


class TestRun:
    def test_what_ran_and_its_files(self, run, result, capfd):
        main(["inspect", str(run)])
        text = capfd.readouterr().out
        assert text.startswith("cleaning run on planar, version ")
        assert f"picked up {result['picked']}" in text
        assert f"{N_ROBOTS} in 1 world(s), seed 0" in text
        assert f"rerun {shlex.quote(str(run / 'clean.rrd'))}" in line_about("clean.rrd", run)

    def test_the_python_that_it_states_loads_a_trajectory(self, run):
        python = line_about("trajectory.npz", run).split(": ", 1)[1].split(", .balls")[0]
        table = eval(python, {"iswarm_mj": iswarm_mj})
        assert table.num_rows == N_ROBOTS * (N_STEPS + 1)

    def test_the_python_that_it_states_reads_a_table(self):
        directory = ROOT / "results/default/hop-count"
        python = line_about("hop_count.parquet", directory).split("table: ")[1]
        assert eval(python, {"pyarrow": pyarrow}).num_rows == 24

    def test_the_command_that_it_states_repeats_a_run(self, run):
        repeats = line_about("result.json", run).split("; iswarm ")[1]
        command = shlex.split(repeats.removesuffix(" repeats it"))
        main([*command, "--steps", "2", "--no-record", "--out", str(run.parent / "again")])
        again = json.loads((run.parent / "again/result.json").read_text())
        assert again["steps"] == 2

    def test_an_interrupted_run_with_a_fault(self, result, tmp_path):
        fault = "step 7, world 0: the contact solver failed"
        unknown = dict.fromkeys(("delivered", "picked", "collisions", "fitness"))
        write_result(
            tmp_path, {**result, **unknown, "interrupted": True, "steps": 7, "faults": [fault]}
        )
        text = describe_directory(tmp_path)
        assert "interrupted after 7 of 12 control steps" in text
        assert f"fault: {fault}" in text

    def test_a_trajectory_that_is_cut_off(self, run, tmp_path):
        shutil.copy(run / "result.json", tmp_path)
        whole = (run / "trajectory.npz").read_bytes()
        (tmp_path / "trajectory.npz").write_bytes(whole[:-10])
        line = line_about("trajectory.npz", tmp_path)
        assert "cut off" in line
        assert "load" not in line

    def test_text_of_files_controls_no_terminal(self, result, tmp_path, capfd):
        write_result(tmp_path, {**result, "version": "\x1b[2J", "faults": ["\x1b[2J"]})
        main(["inspect", str(tmp_path)])
        assert "\x1b" not in capfd.readouterr().out


@pytest.mark.parametrize("is_parent", [False, True])
def test_all_recordings_open_at_once(run, tmp_path, is_parent):
    """A shell splits the command into their paths, also where these need quotes."""
    out = tmp_path / "it's $HOME"
    shutil.copytree(run, out)
    assert "as one dataset" not in describe_directory(out)
    for world in (2, 11):
        shutil.copytree(run, out / f"world-{world}", ignore=lambda *_: ["result.json"])

    lines = describe_directory(tmp_path if is_parent else out).splitlines()
    (line,) = (line for line in lines if "all 3 recordings" in line)
    list_files = line.split(": ")[1].replace("rerun", "ls -1")
    shell = subprocess.run(["sh", "-c", list_files], capture_output=True, text=True)
    directories = [out, out / "world-11", out / "world-2"]
    assert shell.stdout.splitlines() == [str(folder / "clean.rrd") for folder in directories]


@pytest.mark.parametrize(
    ("classes", "command"),
    [
        (
            {"strategy": {"class": "Walk", "speed": 0.5}},
            "iswarm clean --strategy FILE.py:Walk --config ",
        ),
        (
            {"strategy": {"class": "Teams", "a": {}}},
            "iswarm clean --strategy NAME=SHARE NAME=SHARE --config ",
        ),
        (
            {"strategy": {"class": "Fix"}, "task": {"class": "Mine"}},
            "iswarm run --strategy FILE.py:Fix --task",
        ),
    ],
)
def test_classes_of_users_are_to_be_named_again(result, tmp_path, classes, command):
    """The command that repeats the run says how, and so does the refusal without their names."""
    write_result(tmp_path, result | classes)
    assert command in describe_directory(tmp_path)
    first_flag = command.split(" --")[1]
    with pytest.raises(UserError, match=re.escape(first_flag)):
        ConfigFile.read(tmp_path / "result.json", "clean", [])


def test_several_runs_are_one_table(result, tmp_path):
    """Means are over the worlds that have finished."""
    for name, collisions in (("a", [2, 4]), ("b", [None, 7])):
        (tmp_path / name).mkdir()
        write_result(tmp_path / name, {**result, "collisions": collisions, "strategy": "?"})
    header, *rows = [line.split() for line in describe_directory(tmp_path).splitlines()]
    assert (header[0], header[-1]) == ("directory", "collisions")
    assert [row[-1] for row in rows] == ["3", "7"]


class TestInterrupted:
    """Searches and trainings, of which a checkpoint holds two finished runs."""

    @pytest.fixture(autouse=True)
    def checkpoint(self, tmp_path):
        with journal(tmp_path / "checkpoint.sqlite", {}) as finished:
            for key in range(2):
                finished.add((key,), 0.0)

    @pytest.mark.parametrize("is_complete", [False, True])
    def test_a_search_ends_with_its_best_genome(self, tmp_path, is_complete):
        names = ["evolution.parquet"] + ["best.json"] * is_complete
        for name in names:
            shutil.copy(ROOT / "results/default/evolve-cmaes" / name, tmp_path)
        text = describe_directory(tmp_path)
        is_interrupted = "interrupted: 2 finished runs of a search" in text
        assert is_interrupted == (not is_complete)

    @pytest.mark.parametrize("is_complete", [False, True])
    def test_a_training_ends_with_its_figure(self, tmp_path, is_complete):
        names = ["learning.csv"] + ["learning.png"] * is_complete
        for name in names:
            (tmp_path / name).touch()
        assert ("interrupted" in describe_directory(tmp_path)) == (not is_complete)
