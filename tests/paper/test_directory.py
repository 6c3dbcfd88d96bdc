"""What the directory of an experiment keeps."""

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

HOP_COUNT, QUICK = EXPERIMENTS["hop-count"], replace(PLAN, quick=True, seed=3)


@pytest.fixture
def counted(monkeypatch):
    """Jobs that are really done, by a stand-in that takes no time."""
    seen = []

    def run_jobs(jobs, execution):
        for index, job in enumerate(jobs):
            seen.append(job)
            yield index, done(job, 100 + job.seed % 50 + (0 if job.genome.use_hop_count else 300))

    monkeypatch.setattr(pool, "run_jobs", run_jobs)
    return seen


def test_table_findings_and_figures(counted, tmp_path, capsys):
    run_experiment(HOP_COUNT, QUICK, tmp_path)
    rows, settings = read_table(tmp_path / "hop_count.parquet")
    assert [row["seed"] for row in rows] == [entry.job.seed for entry in HOP_COUNT.entries(QUICK)]
    assert (
        rows[0]["collisions_per_robot"] == 1.0
        and rows[0]["goal"] == 66
        and rows[0]["max_steps"] == 300
    )
    assert (
        settings["seed"] == 3
        and settings["quick"] is True
        and settings["genome"]["p_vector_forget"] == 0.29
    )
    assert settings["config"]["optics"]["led_beam_aperture"] == 60.0 and settings["version"]
    found = list(csv.DictReader((tmp_path / "findings.csv").open()))
    assert (
        len(found) == 4
        and found[0]["verdict"] == TOO_FEW
        and found[0]["kind"] == "predicted, held out"
    )
    assert (tmp_path / "hop_count.png").stat().st_size > 10_000
    assert "</svg>" in (tmp_path / "hop_count.svg").read_text()
    assert "too few runs to judge" in capsys.readouterr().out


def test_finished_runs_are_not_done_again(counted, tmp_path):
    plan, density = replace(PLAN, quick=True), replace(EXPERIMENTS["density"], figure=lambda *_: [])
    for own, execution, again, expected in (
        (plan, None, False, 8),
        (plan, None, False, 8),
        (replace(plan, seed=1), None, False, 16),
        (plan, Execution(MjxSettings()), False, 24),
        (plan, None, False, 24),
        (plan, None, True, 32),
    ):
        run_experiment(density, own, tmp_path, execution, again=again)
        assert len(counted) == expected


def test_real_runs_of_a_small_arena(small, tmp_path):
    """In workers: the table tells what the runs give by themselves, and all of it follows from
    it."""
    plan = Plan(config=small, quick=True)
    few = replace(HOP_COUNT, quick_repeats=1, quick_limit=30)
    short = few.entries(plan)
    run_experiment(few, plan, tmp_path, Execution(workers=2))
    rows, settings = read_table(tmp_path / "hop_count.parquet")
    assert all(
        row.items() >= outcomes([entry.job], MujocoSettings())[0].items()
        for row, entry in zip(rows, short, strict=True)
    )
    assert settings["config"]["arena"]["size"] == 15
    assert rows[0]["goal"] == 22 and rows[0]["n_robots"] == short[0].job.n_robots == round(
        0.118 * 216
    )
    assert count(tmp_path / "runs.sqlite") == len(short)
