"""Jobs in worker processes: nothing is mixed up."""

import pytest
from helpers_jobs import jobs_of, outcomes_of

from iswarm_mj.experiments.runner.jobs import run_job
from iswarm_mj.experiments.runner.pool import Execution, run_jobs


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
