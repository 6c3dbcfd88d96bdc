"""Jobs as worlds of batches in MJX, on the devices of this machine."""

import importlib.util
from collections.abc import Generator, Sequence
from typing import Any

import jax
import numpy as np

from iswarm_mj.engines.mjx.motion import TOO_MANY_CONTACTS, TOO_MANY_PAIRS
from iswarm_mj.experiments.runner.jobs import PLACES, Job, Outcome, outcome
from iswarm_mj.simulation.initial import free_cells
from iswarm_mj.simulation.metrics import Measures
from iswarm_mj.simulation.run_mjx import BatchRun, BatchSettings
from iswarm_mj.simulation.worlds import World
from iswarm_mj.utils.errors import SimulationFault
from iswarm_mj.utils.jax_setup import configure_jax

FIRST_ROOM = {"jax": 1.0, "warp": 4.0}
"""Room for contacts at first, by implementation, relative to the rule of `engines.mjx_arena.capacities`."""
MOST_ROOM = 8.0
"""Room for contacts at most. A batch that finds too little begins again with twice as much, up to this.

In 250 steps, the swarms of an evolution that collide most needed up to 2.1 times the rule's, swarms that do not avoid
each other at all up to 3.6 times; robots side by side all over the floor would need 7 times. The JAX implementation
takes time for room that is not used: 6 times as long with 4 times the rule's.
"""


def implementation() -> str:
    """MJX's implementation for batches: warp where JAX's first device is an NVIDIA GPU and Warp is there, else jax."""
    device = jax.devices()[0]
    is_nvidia = device.platform == "gpu" and "nvidia" in device.device_kind.lower()
    return "warp" if is_nvidia and importlib.util.find_spec("warp") else "jax"


def run_batches(jobs: Sequence[Job]) -> Generator[tuple[int, Outcome], None, None]:
    """Yield (index of the job, outcome), a batch at a time: jobs of equal settings are worlds of one.

    Rounding differs a little with the size of the largest world, the room for contacts and, on GPUs, the number of
    worlds, so that another batch may bring a job to another, equally likely end.

    Raises:
        SimulationFault: a run could not go on.
        UserError: a job is not possible.
    """
    configure_jax()
    alike: dict[Any, list[int]] = {}
    for index, job in enumerate(jobs):
        alike.setdefault((job.config, job.steps, job.stop_at), []).append(index)
    for indices in alike.values():
        batch = [jobs[index] for index in indices]
        for index, job, measures in zip(indices, batch, _measured(batch), strict=True):
            yield index, outcome(job, measures, measures.finished_at or job.steps)


def _measured(jobs: Sequence[Job]) -> list[Measures]:
    """Measures of jobs of equal settings, with as much room as they need."""
    impl = implementation()
    room, worlds = FIRST_ROOM[impl], _worlds(jobs)
    while True:
        settings = BatchSettings(jobs[0].steps, impl, stop_at=jobs[0].stop_at, contact_room=room)
        run = BatchRun(jobs[0].config, worlds, settings)
        try:
            return _run(run, len(jobs))
        except SimulationFault:
            if not _lacks_room(run) or 2 * room > MOST_ROOM:
                raise
            room *= 2


def _worlds(jobs: Sequence[Job]) -> list[World]:
    """Worlds of the jobs. Of different sizes, one more: batches that are alike up to `PLACES` share a program.

    In that one, robots are dead: they do nothing but take up places.
    """
    worlds = [World(job.genome, job.n_robots, job.seed, failed_fraction=job.failed_fraction) for job in jobs]
    most = max(job.n_robots for job in jobs)
    if any(job.n_robots < most for job in jobs):
        places = min(-(-most // PLACES) * PLACES, len(free_cells(jobs[0].config.arena)))
        worlds.append(World(jobs[0].genome, places, failed_fraction=1.0))
    return worlds


def _run(run: BatchRun, n_jobs: int) -> list[Measures]:
    """Measures of the first worlds at the end, when all of them are finished or the time is up."""
    while True:
        measures = [run.measures(world) for world in range(n_jobs)]
        if run.is_over or all(found.finished_at is not None for found in measures):
            return measures
        run.advance()


def _lacks_room(run: BatchRun) -> bool:
    """Whether contacts found no room in a world."""
    bits = np.asarray(run.arrays()[1].fault.bits)
    return bool((bits & (TOO_MANY_PAIRS | TOO_MANY_CONTACTS)).any())
