"""Jobs as worlds of batches, on the devices of this machine."""

import math
from collections.abc import Sequence
from typing import Any

from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.experiments.runner.jobs import Job, NumberedOutcomes, outcomes
from iswarm_mj.simulation.common import common
from iswarm_mj.simulation.memory_check import most_worlds


def run_batches(jobs: Sequence[Job], engine: EngineSettings) -> NumberedOutcomes:
    """Yield (index of the job, outcome), a batch at a time: jobs with all in common that worlds share are one batch.

    Rounding depends slightly on the number of robots in the largest world, the size of the contact buffers and, on
    GPUs, the number of worlds. The same job may therefore end differently, but equally likely, in another batch.

    Args:
        jobs: the runs.
        engine: settings of a compiled engine.

    Raises:
        SimulationFault: a run could not go on.
        UserError: a job is not possible.
    """
    alike: dict[Any, list[int]] = {}
    for index, job in enumerate(jobs):
        alike.setdefault((common(job.config), job.steps, job.stop_at), []).append(index)
    for indices in (part for every in alike.values() for part in _parts(every, jobs, engine)):
        yield from zip(indices, outcomes([jobs[index] for index in indices], engine), strict=True)


def _parts(indices: Sequence[int], jobs: Sequence[Job], engine: EngineSettings) -> list[list[int]]:
    """Jobs in batches, as many in each as the memory has room for."""
    most = most_worlds(engine, max(jobs[index].n_robots for index in indices))
    n_parts = max(1, math.ceil(len(indices) / most))
    return [list(indices[len(indices) * k // n_parts : len(indices) * (k + 1) // n_parts]) for k in range(n_parts)]
