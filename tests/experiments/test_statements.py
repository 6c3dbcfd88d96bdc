"""What the statements on swarms say of made-up runs, no two of whose groups and columns are alike."""

from dataclasses import replace

import numpy as np
import pytest
from helpers_outcomes import PLAN, done, rows_of, type_rows

from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, NOT_RUN, TOO_FEW, UNDECIDED
from iswarm_mj.experiments.analysis.measures import ATTEMPTS, latest_finish
from iswarm_mj.experiments.runner.experiment import Plan, row_of
from iswarm_mj.experiments.studies import observed
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.tasks.measures import Measures, fitness

ENTRIES = {name: experiment.entries(PLAN) for name, experiment in EXPERIMENTS.items() if name != "infer"}


def judged(name, rows):
    return EXPERIMENTS[name].findings(rows)


def verdicts(name, rows):
    return [finding.verdict for finding in judged(name, rows)]


def made(name, outcome):
    return rows_of(ENTRIES[name], outcome)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_the_runs_of_a_quick_version_are_too_few(name):
    """Nothing is judged, however clear the runs are."""
    entries = EXPERIMENTS[name].entries(replace(PLAN, quick=True))
    rows = rows_of(entries, lambda e: done(e.job, 100 + e.labels["repeat"]))
    found = set(verdicts(name, [row | {"aggregation": 0.3, "overlap": 0.05, "ms_per_step": 2.0} for row in rows]))
    assert found <= {TOO_FEW, NOT_RUN, ""} and (TOO_FEW in found or name == "infer")  # which judges nothing


@pytest.mark.parametrize("measure", range(4))
def test_statements_on_hop_counts_are_on_one_measure_each(measure):
    """Runs differ in one of time, dust, collisions and carriage, and the others are equal to the last digit."""

    def outcome(entry):
        values = [100, 50, 2800, 60.0]
        way = 1 if entry.job.genome.use_hop_count == (measure == 1) else -1
        values[measure] += way * (20 + entry.labels["repeat"])
        return done(entry.job, *values)

    assert verdicts("hop-count", made("hop-count", outcome)) == [HOLDS if n == measure else FAILS for n in range(4)]


class TestTypes:
    @pytest.mark.parametrize(
        "one, two, repeats, expected",
        [
            (310, 380, 96, [FAILS, FAILS, FAILS, FAILS]),  # 22 % later; 7075 points, 9 % off
            (200, 201, 96, [FAILS, HOLDS, FAILS, HOLDS]),
            (310, 360, 8, [UNDECIDED] * 4),
            (310, 345, 4, [TOO_FEW] * 4),
        ],
    )
    def test_types_that_are_not(self, one, two, repeats, expected):
        """By intervals: what differs is told from what is only uncertain, and nothing follows from a few runs."""
        _, times, alike, _, points, as_fit, *_ = verdicts(
            "types", [row for row in type_rows(one, two) if row["repeat"] < repeats]
        )
        assert [times, alike, points, as_fit] == expected

    @pytest.mark.parametrize("time, early, expected", [(250, 0, HOLDS), (None, 0, HOLDS), (250, 12, FAILS)])
    def test_runs_that_are_faster_than_the_papers_shortest_time(self, time, early, expected):
        """The first `early` runs of type 2 finish in 249 steps, the others at `time`."""
        rows = [
            row | {"finished_at": 249 if row["type"] == "type2" and row["repeat"] < early else time}
            for row in type_rows(310, 311)
        ]
        assert verdicts("types", rows)[3] == expected

    @pytest.mark.parametrize("points, collisions, n_robots, step", [(7771, 180, 280, 310), (7766, 80, 314, 311)])
    def test_the_papers_times_follow_from_its_fitness(self, points, collisions, n_robots, step):
        """The formula of section 4.6 gives the paper's points with so many collisions a robot, and not a step later."""
        run = Measures(72, 72, collisions * n_robots, None, step)
        assert latest_finish(points) == step and fitness(run, n_robots, 72, 800) == pytest.approx(points)
        assert fitness(run._replace(collisions=0, finished_at=step + 1), n_robots, 72, 800) < points

    def test_aggregation_by_hand(self):
        """Of the empty workers two of three are near a dust area in the first step, none in the second."""
        rd = 2e-3 * np.sqrt(2)
        far, near, edge = [0.0, 20 * rd, 0.0], [16 * rd, 0.0, 0.0], [(16 - 3 - 3.4) * rd, 0.0, 0.0]
        frames = {
            "pose": np.array([[near, edge, far, near, near], [far] * 5, [near] * 5]),
            "is_loaded": np.array([[False, False, False, True, False]] * 3),
            "scene_is_scout": np.array([False, False, False, False, True]),
            "scene_dust_areas": np.array([[13.0, -3, 19, 3], [-19, -3, -13, 3]]) * rd,
            "ball_position": np.zeros((3, 4, 3)),
            "delivered": np.array([0, 1, 2]),
        }
        assert observed.aggregation(frames) == pytest.approx((2 / 3 + 0) / 2)


def test_overlaps_and_times_are_observed(small):
    """Overlaps lessen with the time step."""
    plan = Plan(replace(small, arena=replace(small.arena, n_dust=4)), quick=True)
    entries = [e._replace(job=replace(e.job, n_robots=40, steps=30)) for e in EXPERIMENTS["time-step"].entries(plan)]
    entries = [e for e in entries if e.labels["type"] == "type1" and e.labels["rate"] in (10, 50)]
    rows = [row_of(e, done(e.job, None)) for e in entries]
    observed.observe(plan, None, rows)
    overlap = {row["rate"]: row["overlap"] for row in rows if row["repeat"] == 0}
    assert 0.02 < overlap[50] < 0.5 * overlap[10] < 0.5
    assert all((row["overlap"] is None) == (row["repeat"] > 0) for row in rows)
    assert np.isfinite([row["ms_per_step"] for row in rows if row["repeat"] == 0]).all()


def test_attempts_are_per_ball_that_was_picked():
    row = {"attempts": 30, "picked": 10, "delivered": 5}
    assert ATTEMPTS.value(row) == 3 and ATTEMPTS.value(row | {"picked": 0}) == 30
