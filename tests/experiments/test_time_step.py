"""The study of the physics time step: which runs it is made of, what it observes, and what it finds in made-up rows."""

import re
from dataclasses import replace

import numpy as np
import pytest

from iswarm_mj.config import DriveConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.experiments.analysis.findings import CONSTRUCTED, FAILS, HOLDS, NOT_RUN, PREDICTED, UNDECIDED
from iswarm_mj.experiments.runner.experiment import Plan, row_of
from iswarm_mj.experiments.runner.jobs import Outcome, run_job
from iswarm_mj.experiments.studies import time_step
from iswarm_mj.tasks.measures import Measures

ENTRIES = time_step.entries(Plan())


def made_rows(overlap, time=lambda rate: 150, collisions=lambda rate: 2800):
    """Rows with 24 different times and collisions about functions of the number of physics steps."""
    rows = []
    for entry in ENTRIES:
        rate, k = entry.labels["rate"], entry.labels["repeat"]
        at = time(rate) + k
        outcome = Outcome(Measures(66, 70, collisions(rate) + 10 * k, 60.0 + k, at), at, 0.0)
        observed = {"overlap": overlap(rate), "ms_per_step": 2.0 + 0.01 * rate} if k < 6 else {}
        rows.append({**row_of(entry, outcome), "overlap": None, "ms_per_step": None, **observed})
    return rows


def test_runs_are_those_that_the_drive_allows():
    assert {e.labels["rate"] for e in ENTRIES} == {10, 20, 50, 100} and len(ENTRIES) == 2 * 4 * 24
    for entry in ENTRIES:
        drive = entry.job.config.drive
        assert drive.turn_substeps + drive.walk_substeps == entry.labels["rate"]
        assert replace(drive, turn_substeps=4, walk_substeps=6) == DriveConfig()
    assert time_step.refusals(SwarmConfig()).keys() == {2, 5}
    slow = SwarmConfig(drive=DriveConfig(step_length=0.08, max_turn=30))
    assert time_step.refusals(slow) == {}


def test_nothing_that_changes():
    *same, overlap, cost, refused = time_step.findings(made_rows(lambda rate: 6 / rate))
    assert [finding.verdict for finding in same] == [HOLDS] * 4 and overlap.verdict == HOLDS
    # Runs that reach the goal have delivered as many balls as it asks for, at any time step.
    assert [finding.kind for finding in same] == [PREDICTED, CONSTRUCTED, PREDICTED, PREDICTED]
    assert "type1, 10: 0.6, 20: 0.3, 50: 0.12, 100: 0.06" in overlap.ours
    assert "100: 3 ms" in cost.ours and "2: drive.walk_substeps must be at least 6" in refused.ours
    assert "6 comparisons, n = 24 + 24: type1 at 10: 0 (" in same[0].statistics and ", p = 1 (1)" in same[0].statistics
    assert same[0].ours.startswith("type1 (96 of 96 runs reached the goal), 10: 162 (")


def test_what_changes_is_named():
    rows = made_rows(lambda rate: 20 / rate, collisions=lambda rate: 2800 + 3000 * (rate == 10))
    time, _, collisions, *_, overlap, _, _ = time_step.findings(rows)
    assert (time.verdict, collisions.verdict, overlap.verdict) == (HOLDS, FAILS, FAILS)
    found = re.search(r"type1 at 10: (\S+) \(.*?\), p = (\S+) \((\S+)\), type1 at 20: 0 \(", collisions.statistics)
    assert float(found[1]) == pytest.approx(3000 / 280, rel=0.01) and float(found[2]) < float(found[3]) < 0.01


def test_what_only_may_have_changed_is_open():
    """Five runs of each scatter too much for an equivalence within 10 %, though their medians are the same."""
    rows = [row for row in made_rows(lambda rate: 6 / rate, time=lambda rate: 80) if row["repeat"] % 5 == 0]
    assert time_step.findings(rows)[0].verdict == UNDECIDED


def test_without_the_finest_steps_the_overlap_is_open():
    rows = [row for row in made_rows(lambda rate: 0.0) if row["rate"] < 100]
    assert {f.claim: f.verdict for f in time_step.findings(rows)}[time_step.OVERLAP.text] == NOT_RUN


def test_overlaps_and_times_are_observed(small):
    """Overlaps lessen with the time step."""
    plan = Plan(replace(small, arena=replace(small.arena, n_dust=4)), quick=True)
    entries = [e._replace(job=replace(e.job, n_robots=40, steps=30)) for e in time_step.entries(plan)]
    entries = [e for e in entries if e.labels["type"] == "type1"]
    rows = [row_of(e, run_job(e.job, PlanarSettings(1, refinement=1))) for e in entries]
    time_step.observe(plan, None, rows)
    overlap = {row["rate"]: row["overlap"] for row in rows if row["repeat"] == 0}
    assert 0.02 < overlap[50] < 0.5 * overlap[10] < 0.5
    assert all((row["overlap"] is None) == (row["repeat"] > 0) for row in rows)
    assert np.isfinite([row["ms_per_step"] for row in rows if row["repeat"] == 0]).all()
