"""What the statements on swarms say of made-up runs, no two of whose groups and columns are
alike."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from support.outcomes import PLAN, done, rows_of

from iswarm_mj.paper.analysis.findings import NOT_RUN, TOO_FEW
from iswarm_mj.paper.analysis.measures import ATTEMPTS, latest_finish
from iswarm_mj.paper.studies import observed_runs
from iswarm_mj.paper.studies.experiment import Plan, row_of
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.measures import Measures, fitness


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_the_runs_of_a_quick_version_are_too_few(name):
    """Nothing is judged, however clear the runs are."""
    entries = EXPERIMENTS[name].entries(replace(PLAN, quick=True))
    rows = rows_of(entries, lambda e: done(e.job, 100 + e.labels["repeat"]))
    rows = [row | {"aggregation": 0.3, "overlap": 0.05, "ms_per_step": 2.0} for row in rows]
    found = {finding.verdict for finding in EXPERIMENTS[name].findings(rows)}
    assert found <= {TOO_FEW, NOT_RUN, ""} and (
        TOO_FEW in found or name == "infer"
    )  # which judges nothing


class TestTypes:
    @pytest.mark.parametrize(
        "points, collisions, n_robots, step", [(7771, 180, 280, 310), (7766, 80, 314, 311)]
    )
    def test_the_papers_times_follow_from_its_fitness(self, points, collisions, n_robots, step):
        """The formula of section 4.6 gives the paper's points with so many collisions a robot, and
        not a step later."""
        run = Measures(72, 72, collisions * n_robots, None, step)
        assert latest_finish(points) == step and fitness(run, n_robots, 72, 800) == pytest.approx(
            points
        )
        assert fitness(run._replace(collisions=0, finished_at=step + 1), n_robots, 72, 800) < points

    def test_aggregation_by_hand(self):
        """Of the empty workers two of three are near a dust area in the first step, none in the
        second."""
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
        assert observed_runs.aggregation_share(frames) == pytest.approx((2 / 3 + 0) / 2)


def test_the_first_run_of_each_type_is_recorded_and_drawn_where_half_is_delivered(
    monkeypatch, tmp_path
):
    made, drawn = [], []
    frames = {"step": np.arange(9), "delivered": np.array([0, 0, 1, 1, 2, 3, 3, 4, 4])}
    frames |= {"ball_position": np.zeros((9, 4, 3))}
    stand_ins = {
        "Run": lambda scenario: (scenario.strategy, scenario.n_robots, scenario.seed),
        "run_swarm": lambda run, out: made.append((*run, out.name)),
        "load": lambda _: SimpleNamespace(arrays=frames),
        "aggregation_share": lambda _: 0.25,
        "draw_swarm": lambda _, step, title, path: drawn.append((step, title, path.name)),
    }
    for name, stand_in in stand_ins.items():
        monkeypatch.setattr(observed_runs, name, stand_in)
    about = [
        {"type": name, "repeat": k, "n_robots": n}
        for name, n in (("type1", 3), ("type2", 5))
        for k in (0, 1)
    ]
    rows = [{**row, "max_steps": 9, "seed": 10 * row["n_robots"] + row["repeat"]} for row in about]
    observed_runs.record_types(replace(PLAN, quick=True), tmp_path, rows)
    assert made == [(PRESETS["type1"], 3, 30, "type1-0"), (PRESETS["type2"], 5, 50, "type2-0")]
    assert drawn == [
        (4, f"{name}, step 4, 2 of 4 balls delivered", name) for name in ("type1", "type2")
    ]
    assert [row["aggregation"] for row in rows] == [0.25, None, 0.25, None]


@pytest.mark.slow
def test_overlaps_and_times_are_observed(small):
    """Overlaps lessen with the time step."""
    plan = Plan(replace(small, arena=replace(small.arena, n_dust=4)), quick=True)
    entries = [
        e._replace(job=replace(e.job, n_robots=40, steps=30))
        for e in EXPERIMENTS["time-step"].entries(plan)
    ]
    entries = [e for e in entries if e.labels["type"] == "type1" and e.labels["rate"] in (10, 50)]
    rows = [row_of(e, done(e.job, None)) for e in entries]
    observed_runs.observe_time_steps(plan, None, rows)
    overlap = {row["rate"]: row["overlap"] for row in rows if row["repeat"] == 0}
    assert 0.02 < overlap[50] < 0.5 * overlap[10] < 0.5
    assert all((row["overlap"] is None) == (row["repeat"] > 0) for row in rows)
    assert np.isfinite([row["ms_per_step"] for row in rows if row["repeat"] == 0]).all()


def test_attempts_are_per_ball_that_was_picked():
    row = {"attempts": 30, "picked": 10, "delivered": 5}
    assert ATTEMPTS.value(row) == 3 and ATTEMPTS.value(row | {"picked": 0}) == 30
