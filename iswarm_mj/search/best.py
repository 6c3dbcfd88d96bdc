"""The best genome of a search, and the searches of a table with replicates."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import NamedTuple

import numpy as np

from iswarm_mj.search.rows import Row, Rows, by
from iswarm_mj.strategy.genome import Genome

LAST_GENERATIONS = 20
"""Generations at the end of a search whose mean fitness sums it up."""
RUNS_OF_THE_BEST = 3
"""The best genome is chosen among those with at least this many runs, if there are any."""
_NAMES = tuple(asdict(Genome()))


class Best(NamedTuple):
    """The fittest genome of a search."""

    genome: Genome
    fitness: float
    """Mean over its runs."""
    n_runs: int


def best_of(rows: Rows) -> Best:
    """Return the genome with the highest mean fitness over all its runs.

    One run says little about a genome, and the luckiest of many runs even less. Therefore only
    genomes with at least `RUNS_OF_THE_BEST` runs are compared, or all if no genome has so many.
    """
    fitness_of: dict[tuple, list[float]] = {}
    for values, runs in by(rows, *_NAMES).items():
        fitness_of[values] = [row["fitness"] for row in runs]
    often_run = [
        values for values, fitness in fitness_of.items() if len(fitness) >= RUNS_OF_THE_BEST
    ]

    mean_of = {values: float(np.mean(fitness_of[values])) for values in often_run or fitness_of}
    best = max(mean_of, key=mean_of.__getitem__)
    return Best(Genome(*best), mean_of[best], len(fitness_of[best]))


def by_replicate(rows: Rows) -> list[Sequence[Row]]:
    """Return the rows of each replicate, in the order of their numbers.

    A table without the column `replicate` has one.
    """
    if "replicate" not in rows[0]:
        return [rows]
    groups = by(rows, "replicate")
    return [groups[number] for number in sorted(groups)]
