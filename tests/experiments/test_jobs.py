"""One world as a job: the same run as by hand, its measures and its fitness; jobs in worker processes."""

import pickle

import pytest
from helpers_jobs import jobs_of, outcomes_of

from iswarm_mj.experiments.runner.jobs import Job, run_job
from iswarm_mj.experiments.runner.pool import Execution, run_jobs
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.utils.errors import SimulationFault, UserError

GENOME = PRESETS["type2"]


def test_a_job_is_the_run_by_hand(small):
    outcome = run_job(Job(small, GENOME, n_robots=30, seed=5, steps=25, failed_fraction=0.2))
    run = Run(small, GENOME, RunSettings(30, 25, seed=5, failed_fraction=0.2))
    for _ in range(25):
        run.advance()
    found = outcome.measures
    assert found == run.measures(0) and outcome.steps == 25
    assert found.collisions > 0 and found.picked > found.delivered
    points = 40 * found.delivered + 20 * (found.picked - found.delivered) - 0.05 / 30 * found.collisions
    assert outcome.fitness == pytest.approx(points, abs=1e-9)


def test_a_job_ends_when_it_is_finished(small):
    """What is left of the job's steps counts, but only where all balls are delivered."""
    clean = run_job(Job(small, PRESETS["type1"], 30, seed=0, steps=500))
    assert clean.measures.delivered == 24 and clean.measures.finished_at == clean.steps < 500
    points = 40 * 24 - 0.05 / 30 * clean.measures.collisions + 10 * (500 - clean.steps)
    assert clean.fitness == pytest.approx(points, abs=1e-9)
    some = run_job(Job(small, PRESETS["type1"], 30, seed=0, steps=500, stop_at=5))
    assert 5 <= some.measures.delivered < 24 and some.measures.finished_at == some.steps < clean.steps
    assert some.fitness <= 20 * (some.measures.delivered + some.measures.picked)


def test_jobs_and_outcomes_travel(small):
    job = Job(small, GENOME, 30, seed=1, steps=2)
    assert pickle.loads(pickle.dumps(job)) == job
    outcome = run_job(job)
    assert pickle.loads(pickle.dumps(outcome)) == outcome
    assert len(pickle.dumps(job)) < 4000


def test_faults_name_the_job(small, monkeypatch):
    monkeypatch.setattr(Run, "fault_of_each", [SimulationFault("gone", step=1)])
    with pytest.raises(SimulationFault, match=r"^run of 30 robots with seed 7: step 1: gone$"):
        run_job(Job(small, GENOME, 30, seed=7, steps=3))


def test_a_job_that_is_not_possible_is_refused(small):
    with pytest.raises(UserError, match=r"n_robots must be .*got 217"):
        run_job(Job(small, GENOME, 217, seed=7, steps=3))


@pytest.fixture(scope="module")
def jobs(small):
    return jobs_of(small)


@pytest.fixture(scope="module")
def expected(jobs):
    outcomes = [run_job(job) for job in jobs]
    assert len(set(outcomes)) == len(jobs)
    return outcomes


@pytest.mark.parametrize(
    "how", [Execution(workers=2), Execution(workers=2, backend="ray")], ids=lambda how: how.backend
)
def test_outcomes_are_those_of_the_jobs_by_themselves(jobs, expected, how):
    if how.backend == "ray":
        pytest.importorskip("ray")
    assert outcomes_of(jobs, how) == expected


def test_long_jobs_begin_first(jobs, expected):
    finished = list(run_jobs(jobs, Execution(workers=1)))
    assert [index for index, _ in finished] == [1, 5, 3, 2, 0, 4]
    assert all(outcome == expected[index] for index, outcome in finished)
