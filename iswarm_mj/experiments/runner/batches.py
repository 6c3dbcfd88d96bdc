"""Jobs as worlds of batches, on the devices of this machine."""

import math
from collections.abc import Sequence
from typing import Any

from iswarm_mj.engines.settings import EngineSettings
from iswarm_mj.experiments.runner.jobs import CAPACITY_STEP, Job, NumberedOutcomes, Outcome
from iswarm_mj.simulation.common import common
from iswarm_mj.simulation.memory_check import most_worlds
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.simulation.worlds import World
from iswarm_mj.tasks.layout import free_cells
from iswarm_mj.tasks.measures import Measures


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
        batch = [jobs[index] for index in indices]
        for index, job, measures in zip(indices, batch, _measured(batch, engine), strict=True):
            yield index, Outcome.of(job, measures, measures.finished_at or job.steps)


def _parts(indices: Sequence[int], jobs: Sequence[Job], engine: EngineSettings) -> list[list[int]]:
    """Jobs in batches, as many in each as the memory has room for."""
    most = most_worlds(engine, max(jobs[index].n_robots for index in indices))
    n_parts = max(1, math.ceil(len(indices) / most))
    return [list(indices[len(indices) * k // n_parts : len(indices) * (k + 1) // n_parts]) for k in range(n_parts)]


def _measured(jobs: Sequence[Job], engine: EngineSettings) -> list[Measures]:
    """Run the jobs as worlds of one batch; the first fault is raised.

    Batches share a compiled program if their largest swarms round up to the same multiple of `CAPACITY_STEP`.
    """
    job, largest = jobs[0], max(job.n_robots for job in jobs)
    capacity = largest
    if any(job.n_robots < largest for job in jobs):
        capacity = min(-(-largest // CAPACITY_STEP) * CAPACITY_STEP, len(free_cells(job.config.arena)))
    settings = RunSettings(
        largest, job.steps, n_worlds=len(jobs), stop_at=job.stop_at, capacity=capacity, record_worlds=()
    )
    worlds = [
        World(job.genome, job.n_robots, job.seed, failed_fraction=job.failed_fraction, config=job.config)
        for job in jobs
    ]
    run = Run(job.config, job.genome, settings, engine, worlds=worlds)
    while not run.is_over:
        run.advance()
    for job, fault in zip(jobs, run.fault_of_each, strict=True):
        if fault is not None:
            raise job.fault(fault)
    return [run.measures(world) for world in range(len(jobs))]
