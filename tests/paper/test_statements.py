"""The statements on swarms: too few runs, quantities by hand, and what is observed in runs."""

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

QUICK = replace(PLAN, quick=True)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_the_runs_of_a_quick_version_are_too_few(name):
    """Nothing is judged, however clear the runs are; `infer` judges nothing at all."""
    entries = EXPERIMENTS[name].entries(QUICK)
    observations = {"aggregation": 0.3, "overlap": 0.05, "ms_per_step": 2.0}
    rows = []
    for row in rows_of(entries, lambda entry: done(entry.job, 100 + entry.labels["repeat"])):
        rows.append({**row, **observations})
    verdicts = {finding.verdict for finding in EXPERIMENTS[name].findings(rows)}
    assert verdicts <= {TOO_FEW, NOT_RUN, ""}
    assert TOO_FEW in verdicts or name == "infer"


@pytest.mark.parametrize(
    ("points", "collisions_per_robot", "n_robots", "step"),
    [(7771, 180, 280, 310), (7766, 80, 314, 311)],
)
def test_the_papers_times_follow_from_its_fitness(points, collisions_per_robot, n_robots, step):
    """Section 4.6 gives its points with so many collisions, and fewer one step later."""
    run = Measures(72, 72, collisions_per_robot * n_robots, None, step)
    assert latest_finish(points) == step
    assert fitness(run, n_robots, 72, 800) == pytest.approx(points)
    later = run._replace(collisions=0, finished_at=step + 1)
    assert fitness(later, n_robots, 72, 800) < points


def test_attempts_are_per_ball_that_was_picked_up():
    row = {"attempts": 30, "picked": 10, "delivered": 5}
    assert ATTEMPTS.value(row) == 3
    assert ATTEMPTS.value({**row, "picked": 0}) == 30


def test_aggregation_by_hand():
    """Two of three empty workers are near a dust area in the first step, none in the second.

    The third step does not count, since half of the balls are delivered by then.
    """
    rd = 2e-3 * np.sqrt(2)
    far = [0.0, 20 * rd, 0.0]
    near = [16 * rd, 0.0, 0.0]
    edge = [(16 - 3 - 3.4) * rd, 0.0, 0.0]
    frames = {
        "pose": np.array([[near, edge, far, near, near], [far] * 5, [near] * 5]),
        "is_loaded": np.array([[False, False, False, True, False]] * 3),
        "scene_is_scout": np.array([False, False, False, False, True]),
        "scene_dust_areas": np.array([[13.0, -3, 19, 3], [-19, -3, -13, 3]]) * rd,
        "ball_position": np.zeros((3, 4, 3)),
        "delivered": np.array([0, 1, 2]),
    }
    assert observed_runs.aggregation_share(frames) == pytest.approx((2 / 3 + 0) / 2)


def test_the_first_run_of_each_type_is_recorded_and_drawn_when_half_is_delivered(
    monkeypatch, tmp_path
):
    recorded = []
    drawn = []
    frames = {
        "step": np.arange(9),
        "delivered": np.array([0, 0, 1, 1, 2, 3, 3, 4, 4]),
        "ball_position": np.zeros((9, 4, 3)),
    }
    stand_ins = {
        "Run": lambda scenario: (scenario.strategy, scenario.n_robots, scenario.seed),
        "run_swarm": lambda run, out: recorded.append((*run, out.name)),
        "load": lambda _: SimpleNamespace(arrays=frames),
        "aggregation_share": lambda _: 0.25,
    }
    for name, stand_in in stand_ins.items():
        monkeypatch.setattr(observed_runs, name, stand_in)

    def draw(_, step, title, path):
        drawn.append((step, title, path.name))

    monkeypatch.setattr("iswarm_mj.output.plot_swarm.draw_swarm", draw)

    rows = [
        {"type": "type1", "repeat": 0, "n_robots": 3, "seed": 30, "max_steps": 9},
        {"type": "type1", "repeat": 1, "n_robots": 3, "seed": 31, "max_steps": 9},
        {"type": "type2", "repeat": 0, "n_robots": 5, "seed": 50, "max_steps": 9},
        {"type": "type2", "repeat": 1, "n_robots": 5, "seed": 51, "max_steps": 9},
    ]
    observed_runs.record_types(QUICK, tmp_path, rows)
    assert recorded == [
        (PRESETS["type1"], 3, 30, "type1-0"),
        (PRESETS["type2"], 5, 50, "type2-0"),
    ]
    assert drawn == [
        (4, "type1, step 4, 2 of 4 balls delivered", "type1"),
        (4, "type2, step 4, 2 of 4 balls delivered", "type2"),
    ]
    assert [row["aggregation"] for row in rows] == [0.25, None, 0.25, None]


@pytest.mark.slow
def test_overlaps_and_times_are_observed_in_the_first_runs(small):
    """Overlaps lessen with the time step."""
    arena = replace(small.arena, n_dust=4)
    plan = Plan(replace(small, arena=arena), quick=True)
    rows = []
    for entry in EXPERIMENTS["time-step"].entries(plan):
        if entry.labels["type"] == "type1" and entry.labels["rate"] in (10, 50):
            short = entry._replace(job=replace(entry.job, n_robots=40, steps=30))
            rows.append(row_of(short, done(short.job, None)))
    observed_runs.observe_time_steps(plan, None, rows)

    first_runs = {row["rate"]: row for row in rows if row["repeat"] == 0}
    assert 0.02 < first_runs[50]["overlap"] < 0.5 * first_runs[10]["overlap"] < 0.5
    assert np.isfinite([row["ms_per_step"] for row in first_runs.values()]).all()
    for row in rows:
        assert (row["overlap"] is None) == (row["repeat"] > 0)
