"""The directory of an experiment: its table, findings and figures, and the runs that it keeps."""

import csv
from dataclasses import replace

import pytest
from support.outcomes import PLAN, done

from iswarm_mj.engines.mjx.settings import MjxSettings
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.paper.analysis.findings import TOO_FEW
from iswarm_mj.paper.studies.experiment import Plan, run_experiment
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.search import pool
from iswarm_mj.search.journal import count
from iswarm_mj.search.pool import Execution, outcomes
from iswarm_mj.utils.tables import read_table

HOP_COUNT = EXPERIMENTS["hop-count"]
QUICK = replace(PLAN, quick=True)


@pytest.fixture
def jobs(monkeypatch):
    """Return the jobs that are carried out, by a stand-in that takes no time."""
    jobs_done = []

    def run_jobs(jobs, execution):
        for index, job in enumerate(jobs):
            jobs_done.append(job)
            delay = 0 if job.genome.use_hop_count else 300
            yield index, done(job, 100 + job.seed % 50 + delay)

    monkeypatch.setattr(pool, "run_jobs", run_jobs)
    return jobs_done


class TestFiles:
    """Those of a quick comparison of hop counts."""

    @pytest.fixture
    def out(self, jobs, tmp_path):
        """Return the directory of the experiment."""
        run_experiment(HOP_COUNT, replace(QUICK, seed=3), tmp_path)
        return tmp_path

    def test_the_table_has_a_row_for_each_run_and_all_settings(self, out):
        rows, settings = read_table(out / "hop_count.parquet")
        entries = HOP_COUNT.entries(replace(QUICK, seed=3))
        assert [row["seed"] for row in rows] == [entry.job.seed for entry in entries]
        assert rows[0]["collisions_per_robot"] == 1.0
        assert rows[0]["goal"] == 66
        assert rows[0]["max_steps"] == 300
        assert settings["seed"] == 3
        assert settings["quick"] is True
        assert settings["genome"]["p_vector_forget"] == 0.29
        assert settings["config"]["optics"]["led_beam_aperture"] == 60.0
        assert settings["version"]

    def test_findings_and_figures_are_made_of_it(self, out):
        findings = list(csv.DictReader((out / "findings.csv").open()))
        assert len(findings) == 4
        assert findings[0]["verdict"] == TOO_FEW
        assert findings[0]["kind"] == "predicted, held out"
        assert (out / "hop_count.png").stat().st_size > 10_000
        assert "</svg>" in (out / "hop_count.svg").read_text()


def test_findings_are_printed(jobs, tmp_path, capsys):
    run_experiment(HOP_COUNT, QUICK, tmp_path)
    assert "too few runs to judge" in capsys.readouterr().out


def test_finished_runs_are_not_repeated_unless_it_is_asked_for(jobs, tmp_path):
    density = replace(EXPERIMENTS["density"], figure=lambda *_: [])
    other_seed = replace(QUICK, seed=1)
    in_batches = Execution(MjxSettings())
    for plan, execution, again, n_jobs in (
        (QUICK, None, False, 8),
        (QUICK, None, False, 8),
        (other_seed, None, False, 16),
        (QUICK, in_batches, False, 24),
        (QUICK, None, False, 24),
        (QUICK, None, True, 32),
    ):
        run_experiment(density, plan, tmp_path, execution, again=again)
        assert len(jobs) == n_jobs


@pytest.mark.slow
def test_workers_give_the_runs_that_each_job_gives_by_itself(small, tmp_path):
    plan = Plan(config=small, quick=True)
    short = replace(HOP_COUNT, quick_repeats=1, quick_limit=30)
    entries = short.entries(plan)
    run_experiment(short, plan, tmp_path, Execution(workers=2))

    rows, settings = read_table(tmp_path / "hop_count.parquet")
    for row, entry in zip(rows, entries, strict=True):
        (outcome,) = outcomes([entry.job], MujocoSettings())
        assert row.items() >= outcome.items()
    assert settings["config"]["arena"]["size"] == 15
    assert rows[0]["goal"] == 22
    assert rows[0]["n_robots"] == entries[0].job.n_robots == round(0.118 * 216)
    assert count(tmp_path / "runs.sqlite") == len(entries)
