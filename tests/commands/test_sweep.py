"""`iswarm sweep`: rows are those of single runs; finished runs are kept; what varies is checked
first."""

import json
import re
import sqlite3
from contextlib import closing

import pyarrow.csv
import pytest
from support.cli import ARENA_FLAGS, WALK, code_of, refused, result

from iswarm_mj.commands.main import main
from iswarm_mj.search import sweep as runner

FLAGS = [*ARENA_FLAGS, "--engine=planar", "--steps=30", "--worlds=2"]


def table(path="runs/sweep/sweep.csv"):
    return pyarrow.csv.read_csv(path).to_pylist()


@pytest.fixture
def counted(monkeypatch):
    """The runs that would have been carried out; each row counts them."""
    runs = []

    def rows(run):
        runs.append(run)
        about = {"n_robots": 5, "max_steps": 30, "goal": None, "finished_at": None}
        return [
            {"seed": 0, "world": world, **about, "count": len(runs), "fault": None}
            for world in range(2)
        ]

    monkeypatch.setattr(runner, "_rows_of_run", rows)
    return runs


def test_each_row_is_a_world_of_a_single_run(here, capfd):
    over = ["--over", "robots=5,20", "drive.error-step=0.05:0.1:2"]
    assert code_of("sweep", "clean", *FLAGS, *over) == 0
    rows = table()
    assert len(rows) == 8
    assert [(row["robots"], row["drive.error_step"], row["world"]) for row in rows[:4]] == [
        *((5, 0.05, world) for world in range(2)),
        *((5, 0.1, world) for world in range(2)),
    ]
    assert code_of("clean", *FLAGS, "--robots=20", "--drive.error-step=0.05", "--no-record") == 0
    own = result()
    assert [row["collisions"] for row in rows[4:6]] == own["collisions"] and max(
        own["collisions"]
    ) > 0
    assert [row["picked"] for row in rows[4:6]] == own["picked"] and max(own["picked"]) > 0
    capfd.readouterr()
    main(["inspect", "runs/sweep"])
    text = capfd.readouterr().out
    assert re.search(r"^ +20 +0.05 +2 ", text, re.M)


def test_finished_runs_are_kept_unless_a_file_or_what_it_imports_has_changed(here, counted):
    (here / "walk.py").write_text(WALK.replace("import jax.numpy", "import fast\nimport jax.numpy"))
    (here / "fast.py").write_text("from slow import HOW\n")
    (here / "slow.py").write_text("HOW = 1\n")
    command = ["sweep", "clean", *FLAGS, "--robots=5", "--strategy=walk.py:Walk", "--over"]
    assert code_of(*command, "speed=0.5,1") == 0 and len(counted) == 2
    first = table()
    assert code_of(*command, "speed=0.5,1,1.5") == 0 and len(counted) == 3
    assert table()[:4] == first and [row["count"] for row in table()] == [1, 1, 2, 2, 3, 3]
    (here / "slow.py").write_text("HOW = 2\n")
    assert code_of(*command, "speed=0.5,1") == 0 and len(counted) == 5
    (here / "walk.py").write_text(WALK)
    assert code_of(*command, "speed=0.5,1") == 0 and len(counted) == 7


@pytest.mark.parametrize(
    "entry", [[], [{"max_steps": {}}], [{"max_steps": 30, "count": [[]]}], [{"count": 1}]]
)
def test_a_journal_of_other_entries_is_refused(here, counted, capfd, entry):
    command = ["sweep", "clean", *FLAGS, "--robots=5", "--over", "seed=1"]
    assert code_of(*command) == 0
    with closing(sqlite3.connect("runs/sweep/runs.sqlite")) as file, file:
        file.execute("UPDATE runs SET entry = ? WHERE key != '[]'", (json.dumps(entry),))
    capfd.readouterr()
    assert code_of(*command) == 2
    error = capfd.readouterr().err
    assert re.search(
        r"^iswarm: runs/sweep/runs.sqlite is not a journal of iswarm, or damaged .*\n\Z",
        error,
        re.M,
    )


def test_a_setting_needs_an_effect_in_one_run_only(here, counted):
    command = ["sweep", "clean", *FLAGS, "--robots=5", "--optics.photodiode-splay=20", "--over"]
    assert code_of(*command, "optics.mode=sector,power") == 0 and len(counted) == 2
    assert (
        code_of(*command, "optics.mode=sector,power", "--optics.photodiode-aperture=80", "--again")
        == 0
    )
    assert code_of(*command, "seed=1,2") == 2
    assert (
        code_of(*command[:-2], "--over", "optics.photodiode-splay=30,20") == 2
    )  # the first is the default


def test_switches_vary_too(here, counted):
    assert (
        code_of("sweep", "clean", *FLAGS, "--robots=5", "--over", "use_hop_count=True,False") == 0
    )
    assert [row["use_hop_count"] for row in table()] == [True, True, False, False]


def test_metrics_of_a_task_are_columns(here):
    command = [
        "sweep",
        "run",
        "--task=aggregation",
        "--engine=planar",
        "--threads=1",
        "--steps=5",
        "--robots=12",
    ]
    assert code_of(*command, "--over", "strategy=beeclust", "seed=0,1", "--out=found") == 0
    rows = table("found/sweep.csv")
    assert [(row["strategy"], row["seed"]) for row in rows] == [("beeclust", 0), ("beeclust", 1)]
    assert "delivered" not in rows[0] and any(
        isinstance(value, float) for value in rows[0].values()
    )


@pytest.mark.parametrize(
    "over, words",
    [
        (["density"], r"--over must be FLAG=VALUE,VALUE,\.\.\. .* \(got 'density'\)"),
        (["density=0.1:0.2:one"], "--over must be FLAG=VALUE"),
        (["density=0.1,0.2", "density=0.3"], "each flag once"),
        ([], "one or more of FLAG=VALUE"),
        (["density=0.1,3"], r"--density must be above 0 and at most 1 \(got 3.0\)"),
        (["seed=0:99:100", "robots=1:1000:1000"], "at most 10000 runs .got '?100000 runs"),
        (["steps=1,2"], "--steps is given twice"),
        (["seed=1,2", "--again=1"], "Unrecognized options: 1"),
        (["seed=1,2", "--again", "--again"], "--again is given twice"),
        (["seed=1,2", "--stop-at=500"], "--stop-at must be between 1 and the number of balls, 24"),
    ],
)
def test_what_varies_is_checked_first(here, capfd, over, words):
    assert re.search(words, refused(capfd, here, "sweep", "clean", *FLAGS, "--over", *over))
