"""`iswarm sweep`: rows are those of single runs, and finished runs are kept.

What is refused stands in refusals.txt.
"""

import json
import re
import sqlite3
from contextlib import closing

import pyarrow.csv
import pytest
from support.cli import ARENA_FLAGS, WALK, code_of, result

from iswarm_mj.commands.main import main
from iswarm_mj.search import sweep as runner

FLAGS = [*ARENA_FLAGS, "--engine=planar", "--steps=30", "--worlds=2"]


def read_rows(path="runs/sweep/sweep.csv"):
    """Return the rows of a sweep's table, as dicts."""
    return pyarrow.csv.read_csv(path).to_pylist()


@pytest.fixture
def pretended_runs(monkeypatch):
    """Let runs be counted instead of made, and return the list of those that were asked for.

    The rows of a run have its number in this list, from 1, as `count`.
    """
    runs = []

    def rows_of_run(run):
        runs.append(run)
        row = {"seed": 0, "n_robots": 5, "max_steps": 30, "goal": None, "finished_at": None}
        row |= {"count": len(runs), "fault": None}
        return [{**row, "world": world} for world in range(2)]

    monkeypatch.setattr(runner, "rows_of_run", rows_of_run)
    return runs


@pytest.mark.slow
def test_each_row_is_a_world_of_a_single_run(here, capfd):
    over = ["--over", "robots=5,20", "drive.error-step=0.05:0.1:2"]
    assert code_of("sweep", "clean", *FLAGS, *over) == 0
    rows = read_rows()
    assert [(row["robots"], row["drive.error_step"], row["world"]) for row in rows] == [
        (5, 0.05, 0),
        (5, 0.05, 1),
        (5, 0.1, 0),
        (5, 0.1, 1),
        (20, 0.05, 0),
        (20, 0.05, 1),
        (20, 0.1, 0),
        (20, 0.1, 1),
    ]

    assert code_of("clean", *FLAGS, "--robots=20", "--drive.error-step=0.05", "--no-record") == 0
    single_run = result()
    for measure in ("collisions", "picked"):
        assert [row[measure] for row in rows[4:6]] == single_run[measure]
        assert max(single_run[measure]) > 0

    capfd.readouterr()
    main(["inspect", "runs/sweep"])
    summary = capfd.readouterr().out
    assert re.search(r"^ +20 +0.05 +2 ", summary, re.M)


def test_finished_runs_are_kept_until_a_file_or_its_imports_change(here, pretended_runs):
    """The strategy imports a file, which imports another one."""
    (here / "walk.py").write_text(WALK.replace("import jax.numpy", "import fast\nimport jax.numpy"))
    (here / "fast.py").write_text("from slow import HOW\n")
    (here / "slow.py").write_text("HOW = 1\n")

    def n_runs_after(over):
        """Return the number of runs so far, after another sweep."""
        flags = [*FLAGS, "--robots=5", "--strategy=walk.py:Walk"]
        assert code_of("sweep", "clean", *flags, "--over", over) == 0
        return len(pretended_runs)

    assert n_runs_after("speed=0.5,1") == 2
    first_rows = read_rows()
    assert n_runs_after("speed=0.5,1,1.5") == 3
    assert read_rows()[:4] == first_rows
    assert [row["count"] for row in read_rows()] == [1, 1, 2, 2, 3, 3]

    (here / "slow.py").write_text("HOW = 2\n")
    assert n_runs_after("speed=0.5,1") == 5
    (here / "walk.py").write_text(WALK)
    assert n_runs_after("speed=0.5,1") == 7


@pytest.mark.usefixtures("pretended_runs")
@pytest.mark.parametrize(
    "entry", [[], [{"max_steps": {}}], [{"max_steps": 30, "count": [[]]}], [{"count": 1}]]
)
def test_a_journal_of_other_entries_is_refused(here, capfd, entry):
    command = ["sweep", "clean", *FLAGS, "--robots=5", "--over", "seed=1"]
    assert code_of(*command) == 0
    with closing(sqlite3.connect("runs/sweep/runs.sqlite")) as file, file:
        file.execute("UPDATE runs SET entry = ? WHERE key != '[]'", (json.dumps(entry),))

    capfd.readouterr()
    assert code_of(*command) == 2
    error = capfd.readouterr().err
    sentence = "iswarm: runs/sweep/runs.sqlite is not a journal of iswarm, or damaged "
    assert error.splitlines()[-1].startswith(sentence)


def test_a_setting_needs_an_effect_in_one_run_only(here, pretended_runs):
    """The aperture of photodiodes has one in mode sector, their splay in mode power."""
    command = ["sweep", "clean", *FLAGS, "--robots=5"]
    splay = "--optics.photodiode-splay=20"
    modes = ["--over", "optics.mode=sector,power"]
    assert code_of(*command, splay, *modes) == 0
    assert len(pretended_runs) == 2
    assert code_of(*command, splay, *modes, "--optics.photodiode-aperture=80", "--again") == 0

    assert code_of(*command, splay, "--over", "seed=1,2") == 2
    # The first value is the default.
    assert code_of(*command, "--over", "optics.photodiode-splay=30,20") == 2


@pytest.mark.usefixtures("pretended_runs")
def test_switches_vary_too(here):
    command = ["sweep", "clean", *FLAGS, "--robots=5"]
    assert code_of(*command, "--over", "use_hop_count=True,False") == 0
    assert [row["use_hop_count"] for row in read_rows()] == [True, True, False, False]


def test_metrics_of_a_task_are_columns(here):
    flags = ["--task=aggregation", "--engine=planar", "--threads=1", "--steps=5", "--robots=12"]
    over = ["--over", "strategy=beeclust", "seed=0,1"]
    assert code_of("sweep", "run", *flags, *over, "--out=bees") == 0
    rows = read_rows("bees/sweep.csv")
    assert [(row["strategy"], row["seed"]) for row in rows] == [("beeclust", 0), ("beeclust", 1)]
    assert "delivered" not in rows[0]
    assert any(isinstance(value, float) for value in rows[0].values())
