"""Jobs whose outcomes are kept in a journal, so that only missing ones are run."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from typing import Any

from iswarm_mj.experiments.runner.checkpoint import Journal, Key
from iswarm_mj.experiments.runner.jobs import Job, Outcome
from iswarm_mj.experiments.runner.pool import Execution, run_jobs
from iswarm_mj.utils.progress import Progress


def run_missing(
    wanted: Sequence[tuple[Mapping[Key, Job], Journal]],
    execution: Execution,
    bar: Progress,
    entry: Callable[[Job, Outcome], Any],
) -> None:
    """Run the jobs whose keys are not in their journal and add them to it as they finish.

    Args:
        wanted: jobs by their keys in a journal, and that journal of finished runs.
        execution: how to run the jobs.
        bar: advanced by each finished run.
        entry: what the journals keep of a run.
    """
    missing = [(key, job, journal) for jobs, journal in wanted for key, job in jobs.items()]
    missing = [each for each in missing if each[0] not in each[2].entries]
    with closing(run_jobs([job for _, job, _ in missing], execution)) as finished:
        for index, outcome in finished:
            key, job, journal = missing[index]
            journal.add(key, entry(job, outcome))
            bar.update()
