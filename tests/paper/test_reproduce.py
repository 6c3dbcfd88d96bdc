"""`iswarm reproduce`: what it makes, keeps and refuses.

Runs are done by a stand-in that takes no time.
"""

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
N_HOP_COUNT_RUNS = 6
N_SEARCH_RUNS = 24
PAGE = "Text with 17 of its own.\n<!-- results: {} -->\n<!-- end -->\n"


@pytest.fixture
def jobs(monkeypatch, tmp_path):
    """Return the jobs that are done; the working directory is empty but for a page."""
    jobs_done = []

    def run_jobs(jobs, execution):
        for index, job in enumerate(jobs):
            jobs_done.append(job)
            measures = Measures(66, 66, 280, 50.0, 100 + job.seed % 50)
            yield index, outcome_of(measures, 150, 5000.0 + job.seed % 100)

    monkeypatch.setattr(pool, "run_jobs", run_jobs)
    monkeypatch.setattr("iswarm_mj.paper.report.reproduce.write_report", lambda *_: None)
    monkeypatch.chdir(tmp_path)
    Path("README.md").write_text(PAGE.format("hop-count"))
    return jobs_done


@pytest.fixture
def interruptible(jobs, monkeypatch):
    """Return a function that interrupts the command after so many runs, or never with None."""
    run_jobs = pool.run_jobs

    def interrupt_after(n_runs):
        def interrupted(jobs, execution):
            for number, outcome in enumerate(run_jobs(jobs, execution)):
                if number == n_runs:
                    raise KeyboardInterrupt
                yield outcome

        monkeypatch.setattr(pool, "run_jobs", interrupted)

    return interrupt_after


def reproduce(*flags, only=PARTS):
    """Run the command for a quick version of some parts."""
    common = ["reproduce", "--quick", "--results", "results", "--pages", "README.md"]
    main([*common, "--only", *only, *flags])


def make_tables():
    """Run the command without runs, for findings and pages."""
    main(["reproduce", "--tables", "--results", "results"])


class TestResults:
    def test_older_figures_go_and_other_files_stay(self, jobs):
        directory = Path("results/hop-count")
        directory.mkdir(parents=True)
        for name in ("old.png", "notes.txt"):
            (directory / name).touch()
        reproduce()
        assert len(jobs) == N_HOP_COUNT_RUNS + N_SEARCH_RUNS
        names = {path.name for path in directory.iterdir()}
        assert names == {"hop_count.parquet", "hop_count.png", "findings.csv", "notes.txt"}
        assert Path("results/evolve-random/best.json").is_file()
        assert len(read_table(Path("results/evolve-random/evolution.parquet"))[0]) == N_SEARCH_RUNS

    def test_the_page_is_filled(self, jobs):
        reproduce()
        page = Path("README.md").read_text()
        assert page.startswith("Text with 17 of its own.\n")
        assert "| with | 3 of 3 |" in page

    def test_nothing_is_made_twice_unless_it_is_asked_for(self, jobs, capsys):
        reproduce()
        page = Path("README.md").read_text()
        n_jobs = len(jobs)
        reproduce()
        assert len(jobs) == n_jobs
        assert Path("README.md").read_text() == page
        capsys.readouterr()
        reproduce("--list")
        assert capsys.readouterr().out.splitlines() == [f"{name:13}  there" for name in PARTS]

        reproduce("--again")
        assert len(jobs) == 2 * n_jobs

    def test_findings_and_pages_follow_from_the_tables(self, jobs):
        reproduce()
        files = [Path("README.md"), Path("results/hop-count/findings.csv")]
        contents = [path.read_bytes() for path in files]
        n_jobs = len(jobs)
        files[0].write_bytes(contents[0].replace(b"3 of 3", b"4 of 4"))
        files[1].write_text("something else")
        make_tables()
        assert [path.read_bytes() for path in files] == contents
        assert len(jobs) == n_jobs

    def test_a_page_that_cannot_be_filled_leaves_all_as_it_was(self, jobs, capsys):
        reproduce(only=["density"])
        findings = Path("results/density/findings.csv")
        findings.write_text("old")
        page = PAGE.format("density") + PAGE.format("densty")
        Path("README.md").write_text(page)
        with pytest.raises(SystemExit) as exit_:
            make_tables()
        assert exit_.value.code == 2
        assert "The block was 'densty'" in capsys.readouterr().err
        assert findings.read_text() == "old"
        assert Path("README.md").read_text() == page


def test_quick_results_are_kept_away_from_the_others_and_from_pages(jobs, monkeypatch):
    calls = []

    def pretend(*arguments, again):
        assert not again
        calls.append(arguments)

    monkeypatch.setattr("iswarm_mj.paper.report.reproduce.reproduce", pretend)
    main(["reproduce", "--only", "grasp", "--quick"])
    main(["reproduce", "--only", "grasp", "--trials=7"])
    (quick_parts, *quick_places), (parts, *places) = calls
    directory = Path("runs/reproduce-quick")
    assert quick_places == [directory / "results", directory, ()]
    assert places == [Path("results/default"), Path("runs/reproduce"), [Path("README.md")]]
    assert quick_parts[0].settings["repeats"] == 1
    assert parts[0].settings["repeats"] == 7


class TestWhatIsMadeAgain:
    TABLE = Path("results/density/density.parquet")

    @pytest.fixture
    def listed(self, jobs, capsys):
        """Return a function that tells whether a finished experiment is to be made again."""
        reproduce(only=["density"])

        def listed(*flags):
            capsys.readouterr()
            reproduce("--list", *flags, only=["density"])
            return capsys.readouterr().out.removeprefix("density  ").strip()

        return listed

    @pytest.mark.parametrize(
        ("flags", "reason"),
        [
            (["--seed", "3"], "made with another seed"),
            (["--optics.wall-range", "2"], "made with another config"),
            (["--engine", "planar"], "there"),
        ],
    )
    def test_results_with_other_settings(self, listed, flags, reason):
        assert listed(*flags) == reason

    def test_results_of_another_version(self, listed):
        rows, settings = read_table(self.TABLE)
        write_table(self.TABLE, rows, {**settings, "version": "0"})
        assert listed() == "made with another version"

    def test_files_that_are_not_readable(self, listed):
        self.TABLE.write_bytes(b"PAR1")
        assert listed() == "not readable"

    @pytest.mark.parametrize(
        ("study", "reason"), [("time-step", "made with another engine"), ("density", "")]
    )
    def test_only_studies_with_an_engine_of_their_own_depend_on_it(self, tmp_path, study, reason):
        (tmp_path / study).mkdir()
        write_table(tmp_path / study / "t.parquet", [{"a": 1}], {"engine": "mujoco"})
        assert (
            Part(study, "t.parquet", {"engine": "planar"}, None).reason_to_make(tmp_path) == reason
        )


def test_an_interruption_leaves_the_results_alone_and_loses_no_run(jobs, interruptible):
    interruptible(5)
    for name in PARTS:
        with pytest.raises(SystemExit) as exit_:
            reproduce(only=[name])
        assert exit_.value.code == 130
        assert not (Path("results") / name).exists()

    # The sixth run of each was done but not kept.
    n_done = len(jobs)
    interruptible(None)
    reproduce()
    assert len(jobs) == n_done + (N_HOP_COUNT_RUNS - 5) + (N_SEARCH_RUNS - 5)
