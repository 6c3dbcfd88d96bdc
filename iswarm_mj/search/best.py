"""The best genome of a search, and the searches of a table with replicates."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import NamedTuple

import numpy as np

from iswarm_mj.search.rows import Row, Rows, by
from iswarm_mj.strategy.genome import Genome

LAST = 20
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
    """Genome with the highest mean fitness over all its runs, among those with at least
    `RUNS_OF_THE_BEST` runs.

    One run says little about a genome, and the luckiest of many runs even less. If no genome has
    enough runs, all of them are compared.
    """
    runs = {values: [row["fitness"] for row in mine] for values, mine in by(rows, *_NAMES).items()}
    known = {
        values: fitness for values, fitness in runs.items() if len(fitness) >= RUNS_OF_THE_BEST
    } or runs
    values = max(known, key=lambda v: float(np.mean(known[v])))
    return Best(Genome(*values), float(np.mean(known[values])), len(known[values]))


def by_replicate(rows: Rows) -> list[Sequence[Row]]:
    """Rows of each replicate, in the order of their numbers; tables without that column have
    one."""
    return (
        [mine for _, mine in sorted(by(rows, "replicate").items())]
        if "replicate" in rows[0]
        else [rows]
    )
