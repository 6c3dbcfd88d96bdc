"""The table of a search: a row per run, and the best genome in it."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.experiments.runner.checkpoint import Key
from iswarm_mj.experiments.runner.jobs import Job, Outcome
from iswarm_mj.strategy.evolution import Individual
from iswarm_mj.strategy.genome import Genome

RUNS_OF_THE_BEST = 3
"""The best genome is chosen among those with at least this many runs, if there are any."""


class Best(NamedTuple):
    """The fittest genome of a search."""

    genome: Genome
    fitness: float
    """Mean over its runs."""
    n_runs: int


def rows_of(
    individuals: Sequence[Individual], jobs: Mapping[Key, Job], outcomes: Sequence[Outcome]
) -> list[dict[str, Any]]:
    """Rows of a generation: place, origin and parents, genome, robots and seed, measures, both fitness values.

    In a row, `fitness` is that of the run; `genome_fitness`, by which genomes are selected, is the mean over the runs
    of the genome in this generation.

    Args:
        individuals: of the generation.
        jobs: by generation, index of the individual, and index of the evaluation.
        outcomes: of the jobs.
    """
    fitness: dict[int, list[float]] = {}
    for (_, place, _), outcome in zip(jobs, outcomes, strict=True):
        fitness.setdefault(place, []).append(outcome.fitness)
    rows = []
    for ((generation, place, evaluation), job), outcome in zip(jobs.items(), outcomes, strict=True):
        individual = individuals[place]
        parent, second_parent = (*individual.parents, None, None)[:2]
        rows.append(
            {
                "generation": generation,
                "individual": place,
                "evaluation": evaluation,
                "origin": individual.origin,
                "parent": parent,
                "second_parent": second_parent,
                **asdict(job.genome),
                "n_robots": job.n_robots,
                "seed": job.seed,
                **outcome._asdict(),
                "genome_fitness": float(np.mean(fitness[place])),
            }
        )
    return rows


def best_of(rows: Sequence[dict[str, Any]]) -> Best:
    """Genome with the highest mean fitness over all its runs, among those with at least `RUNS_OF_THE_BEST` runs.

    One run says little about a genome, and the luckiest of many runs even less. If no genome has enough runs, all of
    them are compared.
    """
    runs: dict[Genome, list[float]] = {}
    for row in rows:
        runs.setdefault(genome_of(row), []).append(row["fitness"])
    known = {genome: values for genome, values in runs.items() if len(values) >= RUNS_OF_THE_BEST} or runs
    genome = max(known, key=lambda g: float(np.mean(known[g])))
    return Best(genome, float(np.mean(known[genome])), len(known[genome]))


def genome_of(row: dict[str, Any]) -> Genome:
    """Genome of a row."""
    return Genome(**{name: row[name] for name in asdict(Genome())})
