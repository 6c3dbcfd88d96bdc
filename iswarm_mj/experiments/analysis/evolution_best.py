"""The best genome in the table of a search, and the rows of its replicates."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.experiments.analysis.findings import Row, Rows
from iswarm_mj.strategy.genome import Genome

RUNS_OF_THE_BEST = 3
"""The best genome is chosen among those with at least this many runs, if there are any."""


class Best(NamedTuple):
    """The fittest genome of a search."""

    genome: Genome
    fitness: float
    """Mean over its runs."""
    n_runs: int


def best_of(rows: Rows) -> Best:
    """Genome with the highest mean fitness over all its runs, among those with at least `RUNS_OF_THE_BEST` runs.

    One run says little about a genome, and the luckiest of many runs even less. If no genome has enough runs, all of
    them are compared.
    """
    runs: dict[tuple[Any, ...], list[float]] = {}
    for row in rows:
        runs.setdefault(tuple(row[name] for name in _NAMES), []).append(row["fitness"])
    known = {values: fitness for values, fitness in runs.items() if len(fitness) >= RUNS_OF_THE_BEST} or runs
    values = max(known, key=lambda v: float(np.mean(known[v])))
    return Best(Genome(*values), float(np.mean(known[values])), len(known[values]))


def genome_of(row: Row) -> Genome:
    """Genome of a row."""
    return Genome(*(row[name] for name in _NAMES))


def by_replicate(rows: Rows) -> list[Sequence[Row]]:
    """Rows of each replicate, in the order of their numbers; tables without that column have one, number 0."""
    found: dict[int, list[Row]] = {}
    for row in rows:
        found.setdefault(row.get("replicate", 0), []).append(row)
    return [found[replicate] for replicate in sorted(found)]


_NAMES = tuple(asdict(Genome()))
