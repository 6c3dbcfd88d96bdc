"""Jobs on a Ray cluster."""

import logging
import os
import warnings
from collections.abc import Sequence
from typing import Any

from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.experiments.runner import worker
from iswarm_mj.experiments.runner.jobs import Job, NumberedOutcomes
from iswarm_mj.utils.errors import UserError


def run_on_ray(numbered: Sequence[tuple[int, Job]], workers: int, engine: EngineSettings) -> NumberedOutcomes:
    """Yield (index, outcome) of numbered jobs from a Ray cluster, which itself repeats the jobs of lost workers.

    Args:
        numbered: (index, job), in the order in which they start.
        workers: jobs at a time, 0 for as many as the cluster has CPUs.
        engine: settings of the jobs' physics, which runs on CPUs.

    Raises:
        SimulationFault: a run could not go on, or workers keep dying.
        UserError: Ray is not installed, or a job is not possible.
    """
    ray = _connect(workers)
    remote = ray.remote(num_cpus=1, max_retries=worker.MAX_LOSSES)(worker.work)
    waiting, running = list(reversed(numbered)), []
    try:
        while waiting or running:
            while waiting and (not workers or len(running) < workers):
                running.append(remote.remote(*waiting.pop(), engine))
            (done, *_), running = ray.wait(running)
            yield ray.get(done)
    except ray.exceptions.RayTaskError as error:
        raise error.cause from None
    except ray.exceptions.WorkerCrashedError:
        raise worker.lost(worker.MAX_LOSSES + 1, numbered[0][1]) from None
    finally:
        for task in running:
            ray.cancel(task, force=True)


def _connect(workers: int) -> Any:
    """Return Ray, connected to the cluster that RAY_ADDRESS names, or else to a new one on this machine."""
    try:
        import ray  # pyright: ignore[reportMissingImports]
    except ImportError:
        raise UserError("`backend` ray needs Ray; install it by pip install 'iswarm-mj[cluster]'") from None
    if not ray.is_initialized():
        local = {} if os.environ.get("RAY_ADDRESS") else {"num_cpus": workers or None, "include_dashboard": False}
        with warnings.catch_warnings():  # JAX warns of each fork, but Ray's children start another program at once
            warnings.simplefilter("ignore", RuntimeWarning)
            ray.init(logging_level=logging.ERROR, log_to_driver=False, **local)
    return ray
