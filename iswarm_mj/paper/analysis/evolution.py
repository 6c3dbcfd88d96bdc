"""One search as one sample: its best genome, and the quantities of section 4.6.1, each a number per
search.

The runs of a search share ancestors, so that they are no independent samples of anything that
evolves; searches with other seeds are.
"""

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from scipy import stats

from iswarm_mj.paper.analysis.measures import SHORTEST
from iswarm_mj.search.best import LAST, best_of, by_replicate
from iswarm_mj.search.rows import Row, Rows, by
from iswarm_mj.strategy.genome import Genome

FIRST = 5
"""Generations at the beginning and at the end that are compared."""
RISE = 35
"""Up to this generation the paper's best swarms got steadily better."""
PLATEAU = (35, 100)
"""Generations from which the paper takes its fittest swarms."""
FITTEST = 250
"""How many it takes."""
BEST = 100
"""Best runs that are compared, since random search does not gather about its best as the others
do."""
GROUP = 30
"""Least runs of a group of which a share or a mean is taken."""


class Evolution:
    """One search, of any method. Its quantities are None where it is too short, or a group has too few runs."""

    def __init__(self, rows: Rows, n_dust: int):
        self.rows = rows
        self.good = [row for row in rows if row["delivered"] == n_dust]
        """Runs that clean the arena."""
        self.poor = [row for row in rows if row["delivered"] != n_dust]
        self.without = [row for row in rows if not row["use_hop_count"]]
        """Runs without hop counts."""
        runs = [
            [row["fitness"] for row in mine] for _, mine in sorted(by(rows, "generation").items())
        ]
        self.means = np.array([np.mean(values) for values in runs])
        """Mean fitness of each generation's runs (G,)."""
        self.bests = np.array([max(values) for values in runs])
        """Best fitness of each generation's runs (G,)."""
        n = len(runs)
        self.last = (
            [row for row in rows if row["generation"] >= n - LAST] if n >= FIRST + LAST else []
        )
        """Runs of the last generations; none if the first and the last would overlap."""
        among = (
            [row for row in rows if PLATEAU[0] <= row["generation"] + 1 <= PLATEAU[1]]
            if n >= PLATEAU[1]
            else []
        )
        self.top = sorted(among, key=lambda row: -row["fitness"])[:FITTEST]
        """The fittest of the plateau; none if the search was too short."""

    @cached_property
    def best(self) -> Genome:
        """The best genome."""
        return best_of(self.rows).genome

    @property
    def rise(self) -> float | None:
        """Spearman's correlation of the best fitness with the generation, up to `RISE`."""
        first = self.bests[:RISE]
        return (
            float(stats.spearmanr(range(RISE), first).statistic)
            if len(first) >= RISE and np.ptp(first)
            else None
        )

    @property
    def gain(self) -> float | None:
        """Mean fitness of the last generations minus that of the first."""
        return self.final - float(self.means[:FIRST].mean()) if self.last else None

    @property
    def final(self) -> float:
        """Mean fitness of the last generations, of all if there are fewer."""
        return float(self.means[-LAST:].mean())

    @property
    def best_runs(self) -> float:
        """Mean fitness of the best runs."""
        return float(np.mean(sorted(row["fitness"] for row in self.rows)[-BEST:]))

    @property
    def trade(self) -> float | None:
        """Pearson's correlation of forgetting with scouts among the fittest of the plateau."""
        x, y = ([row[name] for row in self.top] for name in ("p_vector_forget", "fraction_scouts"))
        return (
            float(stats.pearsonr(x, y).statistic)
            if len(x) > 3 and np.ptp(x) and np.ptp(y)
            else None
        )

    @property
    def density(self) -> float | None:
        """Median density of the last generations."""
        return (
            float(np.median([row["density_of_robots"] for row in self.last])) if self.last else None
        )

    @property
    def early(self) -> float | None:
        """Share of the runs that clean the arena which do so before `SHORTEST`."""
        return mean_of(self.good, lambda row: row["finished_at"] < SHORTEST)

    @property
    def failing(self) -> float | None:
        """Share of the runs that do not clean the arena."""
        return len(self.poor) / len(self.rows) if len(self.rows) >= GROUP else None

    @property
    def exceptions(self) -> float | None:
        """Share of the runs without hop counts that clean the arena."""
        clean = sum(not row["use_hop_count"] for row in self.good)
        return clean / len(self.without) if len(self.without) >= GROUP else None

    def apart(self, name: str, counted: bool = False) -> float | None:
        """Mean of a parameter in runs that clean the arena minus that in the others; of those with
        hop counts alone."""
        groups = (
            [row for row in rows if row["use_hop_count"] or not counted]
            for rows in (self.good, self.poor)
        )
        clean, others = (mean_of(rows, lambda row: row[name]) for rows in groups)
        return None if clean is None or others is None else clean - others

    def late(self, name: str) -> float | None:
        """Mean of a parameter in the last generations; of a Boolean the share of the elites in
        which it is true.

        Mutations make nearly a fair coin of an offspring's Booleans (`Operators.boolean_mutation`),
        so that of these only the elites show what was selected. Of a search without elites all runs
        count.
        """
        rows = self.last
        if rows and isinstance(rows[0][name], bool):
            rows = [row for row in rows if row.get("origin") == "elite"] or rows
        return mean_of(rows, lambda row: row[name], 1)


Evolutions = Sequence[Evolution]


def mean_of(rows: Rows, value: Callable[[Row], float], least: int = GROUP) -> float | None:
    """Mean of a value over runs; None of too few."""
    return float(np.mean([value(row) for row in rows])) if len(rows) >= least else None


def evolutions(rows: Rows, n_dust: int) -> Evolutions:
    """The replicates of a search."""
    return [Evolution(mine, n_dust) for mine in by_replicate(rows)]
