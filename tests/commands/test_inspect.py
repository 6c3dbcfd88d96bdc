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
    assert text.startswith("cleaning run on planar, version ")
    assert f"picked up {content['picked']}" in text and "20 in 1 world(s), seed 0" in text
    lines = {line.split("  ")[0]: line for line in text.splitlines() if "." in line.split("  ")[0]}
    assert f"rerun {shlex.quote(str(run / 'clean.rrd'))}" in lines["clean.rrd"]


def test_the_ways_to_open_files_work(run):
    text = describe_directory(run)
    (python,) = (line for line in text.splitlines() if line.startswith("trajectory.npz"))
    call = python.split(": ", 1)[1].split(", .balls")[0]
    assert eval(call, {"iswarm_mj": iswarm_mj}).num_rows == 20 * 13
    table = ROOT / "results/default/hop-count/hop_count.parquet"
    (parquet,) = (
        line
        for line in describe_directory(table.parent).splitlines()
        if line.startswith("hop_count.parquet")
    )
    assert eval(parquet.split("table: ")[1], {"pyarrow": pyarrow}).num_rows == 24
    again = next(line for line in text.splitlines() if line.startswith("result.json")).split(
        "; iswarm "
    )[1]
    command = shlex.split(again.removesuffix(" repeats it"))
    main([*command, "--steps", "2", "--no-record", "--out", str(run.parent / "again")])
    assert json.loads((run.parent / "again/result.json").read_text())["steps"] == 2


@pytest.mark.parametrize("below", [False, True])
def test_all_recordings_open_at_once(run, tmp_path, below):
    out = tmp_path / "it's $HOME"
    shutil.copytree(run, out)
    assert "as one dataset" not in describe_directory(out)
    for world in (2, 11):
        shutil.copytree(run, out / f"world-{world}", ignore=lambda *_: ["result.json"])
    (line,) = (
        line
        for line in describe_directory(tmp_path if below else out).splitlines()
        if "all 3 recordings" in line
    )
    opened = subprocess.run(
        ["sh", "-c", line.split(": ")[1].replace("rerun", "ls -1")], capture_output=True, text=True
    )
    assert opened.stdout.splitlines() == [
        str(out / name / "clean.rrd") for name in ("", "world-11", "world-2")
    ]


@pytest.mark.parametrize(
    ("about", "command"),
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
def test_own_classes_are_to_be_named_again(run, tmp_path, about, command):
    content = json.loads((run / "result.json").read_text()) | about
    (tmp_path / "result.json").write_text(json.dumps(content))
    assert command in describe_directory(tmp_path)
    with pytest.raises(UserError, match=re.escape(command.split(" --")[1])):
        ConfigFile.read(tmp_path / "result.json", [])


def test_a_trajectory_that_is_cut_off(run, tmp_path):
    shutil.copy(run / "result.json", tmp_path)
    whole = (run / "trajectory.npz").read_bytes()
    (tmp_path / "trajectory.npz").write_bytes(whole[:-10])
    (line,) = (
        line
        for line in describe_directory(tmp_path).splitlines()
        if line.startswith("trajectory.npz")
    )
    assert "cut off" in line and "load" not in line


def test_an_interrupted_run_with_a_fault(run, tmp_path):
    content = json.loads((run / "result.json").read_text())
    content |= {
        "interrupted": True,
        "steps": 7,
        "faults": ["step 7, world 0: the contact solver failed"],
    }
    content |= dict.fromkeys(("delivered", "picked", "collisions", "fitness"))
    (tmp_path / "result.json").write_text(json.dumps(content))
    text = describe_directory(tmp_path)
    assert "interrupted after 7 of 12 control steps" in text
    assert "fault: step 7, world 0: the contact solver failed" in text


def journal_of_two(path):
    with journal(path, {}) as kept:
        for key in range(2):
            kept.add((key,), 0.0)


@pytest.mark.parametrize("ended", [False, True])
def test_a_search_that_was_killed_has_a_table(tmp_path, ended):
    for name in ("evolution.parquet", "best.json")[: 1 + ended]:
        shutil.copy(ROOT / "results/default/evolve-cmaes" / name, tmp_path)
    journal_of_two(tmp_path / "checkpoint.sqlite")
    text = describe_directory(tmp_path)
    assert (
        "interrupted: 2 finished runs of a search" in text and "same command goes on" in text
    ) != ended


@pytest.mark.parametrize("ended", [False, True])
def test_a_training_ends_with_its_figure(tmp_path, ended):
    for name in ("learning.csv", "learning.png")[: 1 + ended]:
        (tmp_path / name).touch()
    journal_of_two(tmp_path / "checkpoint.sqlite")
    assert ("interrupted" in describe_directory(tmp_path)) != ended


def test_what_is_read_controls_no_terminal(run, tmp_path, capfd):
    content = json.loads((run / "result.json").read_text())
    (tmp_path / "result.json").write_text(
        json.dumps({**content, "version": "\x1b[2J", "faults": ["\x1b[2J"]})
    )
    main(["inspect", str(tmp_path)])
    assert "\x1b" not in capfd.readouterr().out


def test_several_runs_are_one_table(run, tmp_path):
    for name, collisions in (("a", [2, 4]), ("b", [None, 7])):
        content = json.loads((run / "result.json").read_text()) | {
            "collisions": collisions,
            "strategy": "?",
        }
        (tmp_path / name).mkdir()
        (tmp_path / name / "result.json").write_text(json.dumps(content))
    head, *lines = describe_directory(tmp_path).splitlines()
    assert head.split()[0] == "directory" and head.split()[-1] == "collisions"
    assert [line.split()[-1] for line in lines] == ["3", "7"]
