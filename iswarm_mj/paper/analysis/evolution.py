"""One search as one sample: its best genome and the quantities of section 4.6.1.

The runs of a search share ancestors, so that they are no independent samples of anything that
evolves; searches with other seeds are. Hence each quantity is one number per search.
"""

from collections.abc import Callable, Sequence
from functools import cached_property

import numpy as np
from scipy import stats

from iswarm_mj.paper.analysis.measures import SHORTEST_TIME
from iswarm_mj.search.best import LAST_GENERATIONS, best_of, by_replicate
from iswarm_mj.search.rows import Row, Rows, by
from iswarm_mj.strategy.genome import Genome

FIRST = 5
"""Number of generations at the beginning that are compared with the last."""
RISE = 35
"""Generation up to which the paper's best swarms got steadily better."""
PLATEAU = (35, 100)
"""First and last generation from which the paper takes its fittest swarms, counted from 1."""
N_FITTEST = 250
"""Number of the fittest swarms that the paper takes."""
N_BEST = 100
"""Number of best runs that are compared, since random search does not gather about its best as the
others do."""
MIN_GROUP = 30
"""Minimum number of runs of a group whose share or mean is taken."""


class Evolution:
    """One search, of any method.

    Its quantities are None where it is too short, or a group has too few runs.
    """

    def __init__(self, rows: Rows, n_dust: int):
        self.rows = rows
        self.cleaning_runs = [row for row in rows if row["delivered"] == n_dust]
        """Runs that clean the arena."""
        self.other_runs = [row for row in rows if row["delivered"] != n_dust]
        """Runs that do not clean the arena."""
        self.runs_without_hop_counts = [row for row in rows if not row["use_hop_count"]]

        generations = sorted(by(rows, "generation").items())
        fitness = [[row["fitness"] for row in runs] for _, runs in generations]
        self.means = np.array([np.mean(points) for points in fitness])
        """Mean fitness of each generation's runs (G,)."""
        self.bests = np.array([max(points) for points in fitness])
        """Best fitness of each generation's runs (G,)."""

        n_generations = len(generations)
        self.last_runs: list[Row] = []
        """Runs of the last generations; none if the first and the last would overlap."""
        if n_generations >= FIRST + LAST_GENERATIONS:
            self.last_runs = [
                row for row in rows if row["generation"] >= n_generations - LAST_GENERATIONS
            ]

        self.fittest: list[Row] = []
        """The fittest runs of the plateau; none if the search was too short."""
        if n_generations >= PLATEAU[1]:
            plateau = [row for row in rows if PLATEAU[0] <= row["generation"] + 1 <= PLATEAU[1]]
            self.fittest = sorted(plateau, key=lambda row: -row["fitness"])[:N_FITTEST]

    @cached_property
    def best(self) -> Genome:
        """Best genome of the search."""
        return best_of(self.rows).genome

    @property
    def rise(self) -> float | None:
        """Spearman's correlation of the best fitness with the generation, up to `RISE`."""
        bests = self.bests[:RISE]
        if len(bests) < RISE or not np.ptp(bests):
            return None
        return float(stats.spearmanr(range(RISE), bests).statistic)

    @property
    def gain(self) -> float | None:
        """Mean fitness of the last generations minus that of the first."""
        if not self.last_runs:
            return None
        return self.final_fitness - float(self.means[:FIRST].mean())

    @property
    def final_fitness(self) -> float:
        """Mean fitness of the last generations, of all if there are fewer."""
        return float(self.means[-LAST_GENERATIONS:].mean())

    @property
    def best_runs_fitness(self) -> float:
        """Mean fitness of the best runs."""
        return float(np.mean(sorted(row["fitness"] for row in self.rows)[-N_BEST:]))

    @property
    def forgetting_against_scouts(self) -> float | None:
        """Pearson's correlation of forgetting with scouts among the fittest of the plateau."""
        forgetting = [row["p_vector_forget"] for row in self.fittest]
        scouts = [row["fraction_scouts"] for row in self.fittest]
        if len(forgetting) <= 3 or not np.ptp(forgetting) or not np.ptp(scouts):
            return None
        return float(stats.pearsonr(forgetting, scouts).statistic)

    @property
    def density(self) -> float | None:
        """Median density of the last generations."""
        if not self.last_runs:
            return None
        return float(np.median([row["density_of_robots"] for row in self.last_runs]))

    @property
    def early_share(self) -> float | None:
        """Share of the runs that clean the arena which do so before `SHORTEST_TIME`."""
        return mean_of(self.cleaning_runs, lambda row: row["finished_at"] < SHORTEST_TIME)

    @property
    def failing_share(self) -> float | None:
        """Share of the runs that do not clean the arena."""
        if len(self.rows) < MIN_GROUP:
            return None
        return len(self.other_runs) / len(self.rows)

    @property
    def exception_share(self) -> float | None:
        """Share of the runs without hop counts that clean the arena."""
        if len(self.runs_without_hop_counts) < MIN_GROUP:
            return None
        n_cleaning = sum(not row["use_hop_count"] for row in self.cleaning_runs)
        return n_cleaning / len(self.runs_without_hop_counts)

    def cleaning_difference(self, name: str, *, with_hop_counts: bool = False) -> float | None:
        """Return the mean of a parameter in runs that clean the arena minus that in the others.

        Args:
            name: name of the parameter.
            with_hop_counts: take only runs with hop counts.
        """

        def mean(rows: Rows) -> float | None:
            if with_hop_counts:
                rows = [row for row in rows if row["use_hop_count"]]
            return mean_of(rows, lambda row: row[name])

        cleaning = mean(self.cleaning_runs)
        not_cleaning = mean(self.other_runs)
        if cleaning is None or not_cleaning is None:
            return None
        return cleaning - not_cleaning

    def late_mean(self, name: str) -> float | None:
        """Return the mean of a parameter over the runs of the last generations; None without runs.

        The mean of a Boolean is the share of runs in which it is true, and only elites count, if
        the search has any: mutation flips the Booleans of half of the offspring
        (`Operators.boolean_mutation`), which therefore hardly show what was selected.
        """
        rows = self.last_runs
        if rows and isinstance(rows[0][name], bool):
            elites = [row for row in rows if row.get("origin") == "elite"]
            rows = elites or rows
        return mean_of(rows, lambda row: row[name], min_runs=1)


Evolutions = Sequence[Evolution]
"""Searches by one method, with different seeds."""


def mean_of(rows: Rows, value: Callable[[Row], float], min_runs: int = MIN_GROUP) -> float | None:
    """Return the mean of a value over runs; None if they are too few."""
    if len(rows) < min_runs:
        return None
    return float(np.mean([value(row) for row in rows]))


def evolutions(rows: Rows, n_dust: int) -> Evolutions:
    """Return the replicates of a search.

    Args:
        rows: the runs of all replicates.
        n_dust: number of balls in the arena.
    """
    return [Evolution(runs, n_dust) for runs in by_replicate(rows)]
