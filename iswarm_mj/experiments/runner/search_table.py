"""The table of a search, which has a row per run."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.experiments.runner.checkpoint import Key
from iswarm_mj.experiments.runner.jobs import Job, Outcome
from iswarm_mj.strategy.evolution import Individual


class Place(NamedTuple):
    """Where a run stands in a search; the key of the run in the checkpoint follows from it."""

    generation: int
    individual: int
    evaluation: int
    replicate: int = 0

    @property
    def key(self) -> Key:
        """Key in the checkpoint; without the replicate if that is 0, as in searches without replicates."""
        return tuple(self) if self.replicate else tuple(self[:3])


def rows_of(
    individuals: Sequence[Individual], jobs: Mapping[Place, Job], outcomes: Sequence[Outcome]
) -> list[dict[str, Any]]:
    """Rows of a generation of one replicate: place, origin, parents, genome, robots, seed, measures, fitness values.

    In a row, `fitness` is that of the run; `genome_fitness`, by which genomes are selected, is the mean over the runs
    of the genome in this generation.

    Args:
        individuals: of the generation.
        jobs: by their places.
        outcomes: of the jobs.
    """
    fitness: dict[int, list[float]] = {}
    for place, outcome in zip(jobs, outcomes, strict=True):
        fitness.setdefault(place.individual, []).append(outcome.fitness)
    rows = []
    for (place, job), outcome in zip(jobs.items(), outcomes, strict=True):
        individual = individuals[place.individual]
        parent, second_parent = (*individual.parents, None, None)[:2]
        rows.append(
            {
                "replicate": place.replicate,
                "generation": place.generation,
                "individual": place.individual,
                "evaluation": place.evaluation,
                "origin": individual.origin,
                "parent": parent,
                "second_parent": second_parent,
                **asdict(job.genome),
                "n_robots": job.n_robots,
                "seed": job.seed,
                **outcome._asdict(),
                "genome_fitness": float(np.mean(fitness[place.individual])),
            }
        )
    return rows
