"""Jobs of several lengths, as a pool is given them."""

from contextlib import closing

from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.experiments.runner.pool import Execution, run_jobs
from iswarm_mj.strategy.genome import Genome

TWO = Execution(workers=2)


def outcomes_of(jobs, execution=TWO):
    """Outcomes in the order of the jobs; none comes twice."""
    found = {}
    with closing(run_jobs(jobs, execution)) as finished:
        for index, outcome in finished:
            assert index not in found
            found[index] = outcome
    return [found[index] for index in range(len(jobs))]


def jobs_of(config):
    """Real runs of different lengths."""
    return [Job(config, Genome(), 30, seed, steps=steps) for seed, steps in enumerate((5, 40, 10, 20, 1, 30))]
