"""One search as one sample: the quantities of section 4.6.1, each a number per search.

The runs of a search share ancestors, so that they are no independent samples of anything that evolves; searches with
other seeds are.
"""

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from jaxtyping import Float

from iswarm_mj.experiments.analysis.evolution_best import best_of, by_replicate
from iswarm_mj.experiments.analysis.findings import Row, Rows
from iswarm_mj.experiments.analysis.paper import SHORTEST
from iswarm_mj.experiments.analysis.statistics import correlation, rank_correlation
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.arrays import Array

FIRST, LAST = 5, 20
"""Generations at the beginning and at the end that are compared."""
RISE = 35
"""Up to this generation the paper's best swarms got steadily better."""
PLATEAU = (35, 100)
"""Generations from which the paper takes its fittest swarms."""
FITTEST = 250
"""How many it takes."""
BEST = 100
"""Best runs that are compared, since random search does not gather about its best as the others do."""
EVOLUTIONS = 6
"""Least evolutions over which anything is judged: of five or fewer, not even the range from the least to the greatest
is an interval of the median at 95 %, as 2 / 2^5 = 6 %."""
GROUP = 30
"""Least runs of a group of which a share or a mean is taken."""

SOME = 10
"""Least runs of a group of which a mean is told without a verdict."""


class Evolution:
    """One search, of any method. Its quantities are None where it is too short, or a group has too few runs.

    Args:
        rows: of its table.
        n_dust: balls in the arena.
    """

    def __init__(self, rows: Rows, n_dust: int):
        self.rows = rows
        self.good = [row for row in rows if row["delivered"] == n_dust]
        """Runs that clean the arena."""
        self.poor = [row for row in rows if row["delivered"] != n_dust]
        fitness: dict[int, list[float]] = {}
        for row in rows:
            fitness.setdefault(row["generation"], []).append(row["fitness"])
        self._fitness = [fitness[generation] for generation in sorted(fitness)]

    @cached_property
    def means(self) -> Float[Array, "G"]:
        """Mean fitness of each generation's runs."""
        return np.array([np.mean(values) for values in self._fitness])

    @cached_property
    def bests(self) -> Float[Array, "G"]:
        """Best fitness of each generation's runs."""
        return np.array([max(values) for values in self._fitness])

    @cached_property
    def top(self) -> Sequence[Row]:
        """The fittest of the plateau; none if the search was too short."""
        return fittest(self.rows, *PLATEAU)

    @cached_property
    def last(self) -> Sequence[Row]:
        """Runs of the last generations; none if the first and the last would overlap."""
        start = len(self._fitness) - LAST
        return [row for row in self.rows if row["generation"] >= start] if start >= FIRST else []

    @cached_property
    def best(self) -> Genome:
        """The best genome."""
        return best_of(self.rows).genome

    @property
    def rise(self) -> float | None:
        """Spearman's correlation of the best fitness with the generation, up to `RISE`."""
        return _defined(rank_correlation(range(RISE), self.bests[:RISE])[0]) if len(self.bests) >= RISE else None

    @property
    def gain(self) -> float | None:
        """Mean fitness of the last generations minus that of the first."""
        return float(self.means[-LAST:].mean() - self.means[:FIRST].mean()) if self.last else None

    @property
    def final(self) -> float:
        """Mean fitness of the last generations, of all if there are fewer."""
        return float(self.means[-LAST:].mean())

    @property
    def best_runs(self) -> float:
        """Mean fitness of the best runs."""
        return float(np.mean(sorted(row["fitness"] for row in self.rows)[-BEST:]))

    @property
    def best_run(self) -> float:
        """Fitness of the fittest run."""
        return float(self.bests.max())

    @cached_property
    def without(self) -> Sequence[Row]:
        """Runs without hop counts."""
        return [row for row in self.rows if not row["use_hop_count"]]

    @property
    def exceptions(self) -> float | None:
        """Share of the runs without hop counts that clean the arena."""
        clean = sum(not row["use_hop_count"] for row in self.good)
        return clean / len(self.without) if len(self.without) >= GROUP else None

    @property
    def early(self) -> float | None:
        """Share of the runs that clean the arena which do so before `SHORTEST`."""
        return float(np.mean([row["finished_at"] < SHORTEST for row in self.good])) if len(self.good) >= GROUP else None

    @property
    def trade(self) -> float | None:
        """Pearson's correlation of forgetting with scouts among the fittest of the plateau."""
        x, y = ([row[name] for row in self.top] for name in ("p_vector_forget", "fraction_scouts"))
        return _defined(correlation(x, y).estimate)

    @property
    def density(self) -> float | None:
        """Median density of the last generations."""
        return float(np.median([row["density_of_robots"] for row in self.last])) if self.last else None

    def level(self, name: str) -> float | None:
        """Mean of a parameter in runs that clean the arena."""
        return float(np.mean([row[name] for row in self.good])) if len(self.good) >= GROUP else None

    def apart(self, name: str, counted: bool = False) -> float | None:
        """Mean of a parameter in runs that clean the arena minus that in the others.

        Args:
            name: of the parameter.
            counted: only of runs with hop counts, of which few do not clean.
        """
        both = [[row for row in rows if not counted or row["use_hop_count"]] for rows in (self.good, self.poor)]
        if min(map(len, both)) < (SOME if counted else GROUP):
            return None
        clean, others = (np.mean([row[name] for row in rows]) for rows in both)
        return float(clean - others)

    def late(self, name: str) -> float | None:
        """Mean of a parameter in the last generations; of a Boolean the share of the elites in which it is true.

        Mutations make nearly a fair coin of an offspring's Booleans (`Operators.boolean_mutation`), so that of these
        only the elites show what was selected. Of a search without elites all runs count.
        """
        rows = self.last
        if rows and isinstance(rows[0][name], bool):
            rows = [row for row in rows if row.get("origin") == "elite"] or rows
        return float(np.mean([row[name] for row in rows])) if rows else None


def evolutions(rows: Rows, n_dust: int) -> list[Evolution]:
    """The replicates of a table; one that has no column for them is one."""
    return [Evolution(mine, n_dust) for mine in by_replicate(rows)]


def share_with(rows: Rows, flag: bool) -> float | None:
    """Share of the runs whose use_hop_count is `flag`; None of too few."""
    return sum(row["use_hop_count"] is flag for row in rows) / len(rows) if len(rows) >= GROUP else None


def fittest(rows: Rows, first: int, last: int) -> list[Row]:
    """The `FITTEST` fittest runs of these generations, the first one being 1; none if the search was shorter."""
    if max(row["generation"] for row in rows) + 1 < last:
        return []
    among = [row for row in rows if first <= row["generation"] + 1 <= last]
    return sorted(among, key=lambda row: -row["fitness"])[:FITTEST]


def _defined(value: float) -> float | None:
    return None if np.isnan(value) else value
