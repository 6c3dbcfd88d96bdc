"""`iswarm reproduce`: what it makes, keeps and refuses; runs are by a stand-in that takes no time."""

import os

import pytest

from iswarm_mj.commands.main import main
from iswarm_mj.experiments.report.reproduce import PUBLISHED
from iswarm_mj.experiments.runner import pool
from iswarm_mj.experiments.runner.jobs import Outcome
from iswarm_mj.tasks.measures import Measures
from iswarm_mj.utils.tables import read_table, write_table

PARTS = ["hop-count", "density", "evolve-random"]
PAGE = """Text with 17 of its own.
<!-- results: hop-count -->
<!-- end -->
"""


@pytest.fixture
def jobs(monkeypatch, tmp_path):
    """Jobs that are really done; the working directory is empty but for a page."""
    seen = []

    def run_jobs(jobs, execution):
        for index, job in enumerate(jobs):
            seen.append(job)
            yield index, Outcome(Measures(66, 66, 280, 50.0, 100 + job.seed % 50), 150, 5000.0 + job.seed % 100)

    monkeypatch.setattr(pool, "run_jobs", run_jobs)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "README.md").write_text(PAGE)
    return seen


def run(*flags, only=PARTS):
    main(["reproduce", "--quick", "--results", "results", "--pages", "README.md", "--only", *only, *flags])


class TestRuns:
    def test_all_is_made_and_nothing_twice(self, jobs, tmp_path, capsys):
        run()
        made, results = len(jobs), tmp_path / "results"
        assert made == 6 + 8 + 2 * 3 * 4 and "hop-count: to be made, not there" in capsys.readouterr().out
        assert {path.name for path in (results / "hop-count").iterdir()} == {
            "hop_count.parquet",
            "hop_count.png",
            "findings.csv",
        }
        assert (results / "evolve-random" / "best.json").is_file()
        assert len(read_table(results / "evolve-random" / "evolution.parquet")[0]) == 24
        assert (tmp_path / "runs/reproduce-quick/report.html").is_file()
        text = (tmp_path / "README.md").read_text()
        assert text.startswith("Text with 17 of its own.\n") and "with hop counts, 3 runs" in text
        run()
        assert len(jobs) == made and "density: there" in capsys.readouterr().out
        run("--list")
        assert capsys.readouterr().out.splitlines() == [f"{name:13}  there" for name in PARTS]
        assert (tmp_path / "README.md").read_text() == text

    @pytest.mark.parametrize(
        "flags, why",
        [
            (["--seed", "3"], "made with another seed"),
            (["--optics.wall-range", "2"], "made with another config"),
            (["--engine", "planar", "--same-engine"], "made with another accuracy, another engine, another refinement"),
            (["--engine", "planar"], "there"),
        ],
    )
    def test_what_differs_is_made_again(self, jobs, capsys, flags, why):
        run(only=["density"])
        capsys.readouterr()
        run("--list", *flags, only=["density"])
        assert capsys.readouterr().out == f"density  {why}\n"

    def test_tables_that_lack_runs_or_are_of_another_version(self, jobs, tmp_path, capsys):
        run(only=["density"])
        path = tmp_path / "results/density/density.parquet"
        rows, settings = read_table(path)
        for change, why in (
            (lambda: write_table(path, rows[1:], settings), "made of other runs"),
            (lambda: write_table(path, rows, settings | {"version": "0"}), "made with another version"),
            (lambda: path.write_bytes(b"PAR1"), "not readable"),
        ):
            change()
            capsys.readouterr()
            run("--list", only=["density"])
            assert capsys.readouterr().out == f"density  {why}\n"

    def test_an_interruption_leaves_the_results_alone_and_loses_no_run(self, jobs, monkeypatch, tmp_path):
        ordinary = pool.run_jobs

        def interrupted(jobs, execution):
            for number, item in enumerate(ordinary(jobs, execution)):
                if number == 5:
                    raise KeyboardInterrupt
                yield item

        monkeypatch.setattr(pool, "run_jobs", interrupted)
        for name in ("hop-count", "evolve-random"):
            with pytest.raises(SystemExit) as stop:
                run(only=[name])
            assert stop.value.code == 130 and not (tmp_path / "results" / name).exists()
        n_done = len(jobs)
        monkeypatch.setattr(pool, "run_jobs", ordinary)
        run(only=["hop-count", "evolve-random"])
        assert len(jobs) == n_done + (6 - 5) + (24 - 5)  # of each, the sixth was done but not kept

    def test_what_cannot_be_made_is_left_out_and_named(self, jobs, tmp_path, capsys):
        """Damaged journals of an experiment and a search, and a file in the place of a directory."""
        for name in ("hop-count/runs.sqlite", "evolve-random/checkpoint.sqlite"):
            path = tmp_path / "runs/reproduce-quick" / name
            path.parent.mkdir(parents=True)
            path.write_text("something else\n")
        (path.parent.parent / "evolve-paper").write_text("")
        parts = [*PARTS, "evolve-paper", "evolve-cmaes"]
        with pytest.raises(SystemExit) as stop:
            run(only=parts)
        out, error = capsys.readouterr()
        assert stop.value.code == 2 and error.count("\n") == 1 and error.startswith("iswarm: hop-count was not made (")
        assert "; evolve-random was not made (" in error and "; evolve-paper was not made (" in error
        assert "/hop-count/runs.sqlite is not a journal of iswarm, or damaged" in error
        assert error.endswith("; all other parts are there: make it anew with --only and --again\n")
        assert "hop-count: not made, runs/" in out and "density: made" in out and "report in" in out
        assert {path.parent.name for path in (tmp_path / "results").glob("*/*.parquet")} == {"density", parts[-1]}
        run("--again", only=["evolve-random"])
        assert (tmp_path / "results/evolve-random/best.json").is_file()

    def test_again_begins_anew(self, jobs):
        run(only=["hop-count", "evolve-random"])
        made = len(jobs)
        run("--again", only=["hop-count", "evolve-random"])
        assert len(jobs) == 2 * made

    def test_blocks_of_parts_that_are_not_made_yet_stay(self, jobs, tmp_path):
        page = tmp_path / "README.md"
        page.write_text(
            "<!-- results: hop-count -->\nas it was\n<!-- end -->\n<!-- results: density -->\n<!-- end -->\n"
        )
        run(only=["density"])
        text = page.read_text()
        assert (
            text.startswith("<!-- results: hop-count -->\nas it was\n<!-- end -->\n") and "| density | robots" in text
        )

    def test_older_figures_do_not_stay(self, jobs, tmp_path):
        old = tmp_path / "results/density" / PUBLISHED[0].replace("*", "old")
        old.parent.mkdir(parents=True)
        old.write_bytes(b"")
        (old.parent / "notes.txt").write_text("mine")
        run(only=["density", "hop-count"])
        assert not old.exists() and (old.parent / "notes.txt").exists()


class TestTables:
    def test_findings_and_pages_follow_from_the_tables(self, jobs, tmp_path, capsys):
        run()
        n_done, page = len(jobs), tmp_path / "README.md"
        right = page.read_text(), (tmp_path / "results/density/findings.csv").read_bytes()
        page.write_text(right[0].replace("3 runs", "4 runs"))
        (tmp_path / "results/density/findings.csv").write_text("something else")
        main(["reproduce", "--tables"])
        assert (page.read_text(), (tmp_path / "results/density/findings.csv").read_bytes()) == right
        assert len(jobs) == n_done and "tables in README.md" in capsys.readouterr().out

    def test_a_page_that_cannot_be_filled_leaves_all_as_it_was(self, jobs, tmp_path, capsys):
        run()
        findings = tmp_path / "results/density/findings.csv"
        findings.write_text("old")
        (tmp_path / "README.md").write_text(PAGE + "<!-- results: types -->\n<!-- end -->\n")
        before = (tmp_path / "README.md").read_text()
        with pytest.raises(SystemExit) as stop:
            main(["reproduce", "--tables"])
        assert stop.value.code == 2 and "README.md:4: results has no results for the block" in capsys.readouterr().err
        assert findings.read_text() == "old" and (tmp_path / "README.md").read_text() == before

    def test_tables_of_another_directory(self, jobs, tmp_path):
        """Such as those of another configuration, beside the first."""
        run()
        (tmp_path / "README.md").write_text(PAGE)
        main(
            [
                "reproduce",
                "--quick",
                "--results",
                "results-far",
                "--only",
                "hop-count",
                "--optics.wall-range",
                "3",
                "--out",
                "runs/far",
            ]
        )
        (tmp_path / "README.md").write_text(PAGE + PAGE.replace("results:", "results-far:"))
        main(["reproduce", "--tables"])
        assert (tmp_path / "README.md").read_text().count("with hop counts, 3 runs") == 2


class TestBadInput:
    @pytest.mark.parametrize(
        "flags, said",
        [
            (["--only", "densty"], "The part was 'densty'; there are grasp, hop-count, density,"),
            (["--tables", "--quick"], "--quick has no effect with --tables"),
            (["--replicates", "0"], "--replicates must be"),
            (["--trials", "0"], "--trials must be"),
            (["--tables", "--results", "nowhere"], "--results must be an existing directory"),
            (["--results", "bad.md"], "--results must be a writable directory (got bad.md); choose another ("),
            (["--pages", "none.md"], "none.md cannot be read"),
            (["--pages", "pipe.md"], "pipe.md cannot be read"),
            (["--pages", "bad.md"], "bad.md:1: The block was 'densty'; there are"),
        ],
    )
    def test_it_is_one_sentence_and_nothing_is_written(self, jobs, tmp_path, capsys, flags, said):
        (tmp_path / "bad.md").write_text("<!-- results: densty -->\n<!-- end -->\n")
        os.mkfifo(tmp_path / "pipe.md")
        with pytest.raises(SystemExit) as stop:
            main(["reproduce", *flags])
        error = capsys.readouterr().err
        assert stop.value.code == 2 and said in error and error.count("\n") == 1
        assert {path.name for path in tmp_path.iterdir()} == {"README.md", "bad.md", "pipe.md"} and jobs == []
