"""Jobs whose outcomes are kept in a journal, so that only missing ones are run."""

from collections.abc import Callable, Mapping
from contextlib import closing
from typing import Any

from iswarm_mj.experiments.runner.checkpoint import Journal, Key
from iswarm_mj.experiments.runner.jobs import Job, Outcome
from iswarm_mj.experiments.runner.pool import Execution, run_jobs
from iswarm_mj.utils.progress import Progress


def run_missing(
    jobs: Mapping[Key, Job], journal: Journal, execution: Execution, bar: Progress, entry: Callable[[Job, Outcome], Any]
) -> None:
    """Run the jobs whose keys are not in the journal and add them to it as they finish.

    Args:
        jobs: by their keys in the journal.
        journal: of finished runs.
        execution: how to run the jobs.
        bar: advanced by each finished run.
        entry: what the journal keeps of a run.
    """
    missing = [key for key in jobs if key not in journal.entries]
    with closing(run_jobs([jobs[key] for key in missing], execution)) as finished:
        for index, outcome in finished:
            key = missing[index]
            journal.add(key, entry(jobs[key], outcome))
            bar.update()
