"""`iswarm reproduce`: what it makes, keeps and refuses; runs are by a stand-in that takes no
time."""

from pathlib import Path

import pytest

from iswarm_mj.commands.main import main
from iswarm_mj.paper.report.reproduce import Part
from iswarm_mj.search import pool
from iswarm_mj.search.pool import outcome_of
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.tables import read_table, write_table

pytestmark = pytest.mark.usefixtures("few_pixels")
PARTS = ["hop-count", "evolve-random"]
PAGE = "Text with 17 of its own.\n<!-- results: {} -->\n<!-- end -->\n"


@pytest.fixture
def jobs(monkeypatch, tmp_path):
    """Jobs that are really done; the working directory is empty but for a page."""
    seen = []

    def run_jobs(jobs, execution):
        for index, job in enumerate(jobs):
            seen.append(job)
            yield (
                index,
                outcome_of(
                    Measures(66, 66, 280, 50.0, 100 + job.seed % 50), 150, 5000.0 + job.seed % 100
                ),
            )

    monkeypatch.setattr(pool, "run_jobs", run_jobs)
    monkeypatch.setattr("iswarm_mj.paper.report.reproduce.write_report", lambda *_: None)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "README.md").write_text(PAGE.format("hop-count"))
    return seen


def run(*flags, only=PARTS):
    main(
        [
            "reproduce",
            "--quick",
            "--results",
            "results",
            "--pages",
            "README.md",
            "--only",
            *only,
            *flags,
        ]
    )


def test_all_is_made_and_nothing_twice(jobs, tmp_path, capsys):
    """Older figures go, other files stay; findings and pages follow from the tables, also without
    runs."""
    results, page = tmp_path / "results", tmp_path / "README.md"
    (results / "hop-count").mkdir(parents=True)
    for name in ("old.png", "notes.txt"):
        (results / "hop-count" / name).touch()
    run()
    made = len(jobs)
    names = {"hop_count.parquet", "hop_count.png", "findings.csv", "notes.txt"}
    assert (
        made == 6 + 2 * 3 * 4 and {path.name for path in (results / "hop-count").iterdir()} == names
    )
    assert (results / "evolve-random" / "best.json").is_file()
    assert len(read_table(results / "evolve-random" / "evolution.parquet")[0]) == 24
    text, findings = page.read_text(), (results / "hop-count/findings.csv").read_bytes()
    assert text.startswith("Text with 17 of its own.\n") and "| with | 3 of 3 |" in text
    run()
    capsys.readouterr()
    run("--list")
    assert capsys.readouterr().out.splitlines() == [f"{name:13}  there" for name in PARTS]
    assert page.read_text() == text
    page.write_text(text.replace("3 of 3", "4 of 4"))
    (results / "hop-count/findings.csv").write_text("something else")
    main(["reproduce", "--tables", "--results", "results"])
    assert (page.read_text(), (results / "hop-count/findings.csv").read_bytes()) == (text, findings)
    assert len(jobs) == made
    run("--again")
    assert len(jobs) == 2 * made


def test_quick_results_are_kept_away_from_the_others_and_from_pages(jobs, monkeypatch, tmp_path):
    given = []
    monkeypatch.setattr(
        "iswarm_mj.paper.report.reproduce.reproduce",
        lambda *args, again: given.append((*args, again)),
    )
    for flags in (["--quick"], ["--trials=7"]):
        main(["reproduce", "--only", "grasp", *flags])
    quick = Path("runs/reproduce-quick")
    assert [args[1:] for args in given] == [
        (quick / "results", quick, (), False),
        (Path("results/default"), Path("runs/reproduce"), [Path("README.md")], False),
    ]
    assert [args[0][0].settings["repeats"] for args in given] == [1, 7]


def test_what_differs_is_made_again(jobs, tmp_path, capsys):
    run(only=["density"])
    path = tmp_path / "results/density/density.parquet"
    rows, settings = read_table(path)

    def listed(*flags):
        capsys.readouterr()
        run("--list", *flags, only=["density"])
        return capsys.readouterr().out.removeprefix("density  ").strip()

    assert listed("--seed", "3") == "made with another seed"
    assert listed("--optics.wall-range", "2") == "made with another config"
    assert listed("--engine", "planar") == "there"
    write_table(path, rows, settings | {"version": "0"})
    assert listed() == "made with another version"
    path.write_bytes(b"PAR1")
    assert listed() == "not readable"


def test_studies_with_an_engine_of_their_own_are_not_made_with_another(tmp_path):
    for name, lacks in (("time-step", "made with another engine"), ("density", "")):
        (tmp_path / name).mkdir()
        write_table(tmp_path / name / "t.parquet", [{"a": 1}], {"engine": "mujoco"})
        assert Part(name, "t.parquet", {"engine": "planar"}, None).reason_to_make(tmp_path) == lacks


def test_an_interruption_leaves_the_results_alone_and_loses_no_run(jobs, monkeypatch, tmp_path):
    ordinary = pool.run_jobs

    def interrupted(jobs, execution):
        for number, item in enumerate(ordinary(jobs, execution)):
            if number == 5:
                raise KeyboardInterrupt
            yield item

    monkeypatch.setattr(pool, "run_jobs", interrupted)
    for name in PARTS:
        with pytest.raises(SystemExit) as stop:
            run(only=[name])
        assert stop.value.code == 130 and not (tmp_path / "results" / name).exists()
    n_done = len(jobs)
    monkeypatch.setattr(pool, "run_jobs", ordinary)
    run()
    assert len(jobs) == n_done + (6 - 5) + (24 - 5)  # of each, the sixth was done but not kept


def test_a_page_that_cannot_be_filled_leaves_all_as_it_was(jobs, tmp_path, capsys):
    run(only=["density"])
    findings, page = tmp_path / "results/density/findings.csv", tmp_path / "README.md"
    findings.write_text("old")
    page.write_text(before := PAGE.format("density") + PAGE.format("densty"))
    with pytest.raises(SystemExit) as stop:
        main(["reproduce", "--tables", "--results", "results"])
    assert stop.value.code == 2 and "The block was 'densty'" in capsys.readouterr().err
    assert findings.read_text() == "old" and page.read_text() == before
