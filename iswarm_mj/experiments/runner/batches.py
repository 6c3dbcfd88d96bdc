"""Jobs as worlds of batches, on the devices of this machine."""

import math
from collections.abc import Sequence
from dataclasses import replace
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
from iswarm_mj.utils.errors import FaultKind

MAX_CAPACITY = 8.0
"""Largest size of contact buffers, relative to `engines.mjx.arena.contact_capacity`. A batch whose buffers are full
starts again with buffers twice as large, up to this.

In 250 steps, the swarms of an evolution that collide most needed up to 2.1 times the default, swarms that do not avoid
each other at all up to 3.6 times; a floor full of robots would need 7 times. With the JAX implementation unused space
costs time: 4 times the default takes 6 times as long.
"""
LARGE_BATCH, SIMILAR = 128, 0.8
"""With mjx, a batch of so many worlds takes no worlds with less than this share of the robots of its largest. With
planar a world is a block: empty places cost little, and a step of a few hundred worlds takes as long as that of the
world in which robots jam most."""
_BUFFER_FULL = FaultKind.TOO_MANY_PAIRS | FaultKind.TOO_MANY_CONTACTS


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
    """Jobs in batches: of similar size with contact buffers, else as many as the memory has room for."""
    if has_buffers(engine):
        return _of_similar_size(indices, jobs)
    most = most_worlds(engine, max(jobs[index].n_robots for index in indices))
    n_parts = max(1, math.ceil(len(indices) / most))
    return [list(indices[len(indices) * k // n_parts : len(indices) * (k + 1) // n_parts]) for k in range(n_parts)]


def _of_similar_size(indices: Sequence[int], jobs: Sequence[Job]) -> list[list[int]]:
    """Jobs in batches of at least `LARGE_BATCH`, whose empty places would otherwise cost more than another program."""
    parts: list[list[int]] = []
    for index in sorted(indices, key=lambda index: -jobs[index].n_robots):
        n_robots = jobs[index].n_robots
        if not parts or (len(parts[-1]) >= LARGE_BATCH and n_robots < SIMILAR * jobs[parts[-1][0]].n_robots):
            parts.append([])
        parts[-1].append(index)
    return parts


def _measured(jobs: Sequence[Job], engine: EngineSettings) -> list[Measures]:
    """Measures of jobs of equal settings, with contact buffers as large as they need; the first fault is raised."""
    while True:
        run = _run(jobs, engine)
        larger = 2 * getattr(engine, "contact_capacity", math.inf)
        if not any(fault.kind & _BUFFER_FULL for fault in run.faults) or larger > MAX_CAPACITY:
            break
        engine = replace(engine, contact_capacity=larger)
    for job, fault in zip(jobs, run.fault_of_each, strict=True):
        if fault is not None:
            raise job.fault(fault)
    return [run.measures(world) for world in range(len(jobs))]


def has_buffers(engine: EngineSettings) -> bool:
    """Return whether an engine has contact buffers, whose room costs time."""
    return hasattr(engine, "contact_capacity")


def _run(jobs: Sequence[Job], engine: EngineSettings) -> Run:
    """Run the jobs as worlds of one batch until all have ended or a contact buffer is full.

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
    while not run.is_over and not any(fault.kind & _BUFFER_FULL for fault in run.faults):
        run.advance()
    return run
