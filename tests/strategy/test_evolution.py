"""The paper's evolution: rates over many draws, against binomial and uniform distributions."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from iswarm_mj.search.methods import (
    IS_BOOLEAN,
    NAMES,
    Operators,
    cross_over,
    mutate,
    next_generation,
    random_population,
    random_vector,
    ranges,
    selection_probabilities,
    to_genome,
    to_vector,
)
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.utils.errors import UserError

PAPER = Operators()
STILL = Operators(dependent_rate=0.0, independent_rate=0.0, crossover_rate=0.0)
REAL = ~IS_BOOLEAN
"""Real values of a vector."""
DRAWS = 20_000
CHILDREN = 6_000
"""Children of pairs that are selected, one after the other."""


def rng(seed=0):
    """Return a generator of random numbers."""
    return np.random.default_rng(seed)


def near(count, n, p):
    """Return whether counts of n trials are within 5 standard deviations of a probability."""
    return np.all(np.abs(np.asarray(count) - n * p) <= 5 * np.sqrt(n * p * (1 - p)))


def is_uniform(values, low, high):
    """Return whether values may be drawn evenly from a range."""
    return stats.kstest(values, stats.uniform(low, high - low).cdf).pvalue > 1e-3


def largest_correlation(columns):
    """Return the largest correlation of two columns."""
    coefficients = np.corrcoef(np.asarray(columns).T)
    return abs(coefficients - np.eye(len(coefficients))).max()


def test_the_defaults_are_the_papers():
    named = (
        "elite",
        "dependent_rate",
        "span",
        "independent_rate",
        "crossover_rate",
        "intermediate_share",
    )
    assert [getattr(PAPER, name) for name in named] == [2, 0.5, 0.05, 0.05, 0.2, 0.5]
    assert (PAPER.density_min, PAPER.density_max) == (0.01, 0.33)


@pytest.mark.parametrize(
    "genome",
    [*PRESETS.values(), Genome(use_hop_count=False, priority_signal_scouts=True)],
)
def test_vectors_are_genomes(genome):
    assert to_genome(to_vector(genome)) == genome
    assert [NAMES[i] for i in np.flatnonzero(IS_BOOLEAN)] == [
        "use_hop_count",
        "priority_signal_scouts",
        "priority_signal_loaded",
    ]


def test_random_values_are_even():
    low, high = ranges(PAPER)
    values = random_vector(PAPER, rng(1), (DRAWS,))
    for i in np.flatnonzero(REAL):
        assert is_uniform(values[:, i], low[i], high[i])
    assert near(values[:, IS_BOOLEAN].sum(axis=0), DRAWS, 0.5)
    assert largest_correlation(values) < 0.04


class TestMutation:
    MIDDLE = np.where(IS_BOOLEAN, 1.0, sum(ranges(PAPER)) / 2)

    def mutants(self, operators, vector=MIDDLE, seed=0):
        """Return many mutants of a vector."""
        return mutate(operators, np.tile(vector, (DRAWS, 1)), rng(seed))

    def test_dependent_mutation(self):
        """Half of the values change, evenly within 0.05, and half of the Booleans; all by chance.

        Values change independently of each other.
        """
        mutants = self.mutants(replace(PAPER, independent_rate=0.0))
        changed = mutants != self.MIDDLE
        assert near(changed.sum(axis=0), DRAWS, 0.5)
        assert largest_correlation(changed) < 0.04
        for i in np.flatnonzero(REAL):
            steps = (mutants - self.MIDDLE)[changed[:, i], i]
            assert is_uniform(steps, -0.05, 0.05)

    def test_a_relative_span(self):
        mutants = self.mutants(replace(PAPER, independent_rate=0.0, relative_span=True))
        share = (mutants / self.MIDDLE - 1)[:, REAL]
        np.testing.assert_allclose(np.abs(share).max(axis=0), 0.05, rtol=0.01)

    @pytest.mark.parametrize("mutation, share", [("flip", 0.5), ("redraw", 0.25), ("keep", 0.0)])
    def test_booleans_change_as_configured(self, mutation, share):
        """This share of either value changes, independently; real values change as ever."""
        operators = replace(PAPER, independent_rate=0.0, boolean_mutation=mutation)
        for value in (0.0, 1.0):
            start = np.where(IS_BOOLEAN, value, self.MIDDLE)
            changed = self.mutants(operators, start) != start
            assert near(changed[:, IS_BOOLEAN].sum(axis=0), DRAWS, share)
            assert near(changed[:, REAL].sum(axis=0), DRAWS, 0.5)
            if share:
                assert largest_correlation(changed[:, IS_BOOLEAN]) < 0.04

    def test_independent_mutation(self):
        """One value in twenty is drawn again from its range, independently.

        Half of such Booleans stay the same.
        """
        mutants = self.mutants(replace(PAPER, dependent_rate=0.0))
        changed = mutants != self.MIDDLE
        assert near(changed[:, REAL].sum(axis=0), DRAWS, 0.05)
        assert near(changed[:, IS_BOOLEAN].sum(axis=0), DRAWS, 0.025)
        assert largest_correlation(changed) < 0.04
        low, high = ranges(PAPER)
        for i in np.flatnonzero(REAL):
            assert is_uniform(mutants[changed[:, i], i], low[i], high[i])

    @pytest.mark.parametrize("edge", [0, 1])
    def test_values_stay_in_their_ranges(self, edge):
        """Half of the steps from an edge lead out, and end at the edge."""
        low, high = ranges(PAPER)
        start = np.where(IS_BOOLEAN, 0.0, (low, high)[edge])
        mutants = self.mutants(PAPER, start)
        assert (mutants >= low).all()
        assert (mutants <= high).all()
        at_edge = (mutants == start)[:, REAL].sum(axis=0)
        assert near(at_edge, DRAWS, 0.95 * (0.5 + 0.25))


class TestCrossover:
    ONE = np.where(IS_BOOLEAN, 1.0, 0.1)
    OTHER = np.where(IS_BOOLEAN, 0.0, 0.3)

    @pytest.fixture(scope="class")
    @classmethod
    def children(cls):
        """Values of many children (DRAWS, V), and the kinds of their crossovers."""
        generator = rng(2)
        values = []
        kinds = []
        for _ in range(DRAWS):
            child, kind = cross_over(PAPER, cls.ONE, cls.OTHER, generator)
            values.append(child)
            kinds.append(kind)
        return np.array(values), np.array(kinds)

    def test_half_are_averages_and_half_are_either_parent(self, children):
        """A child that is no average has all values of one parent."""
        values, kinds = children
        is_average = kinds == "intermediate"
        assert near(is_average.sum(), DRAWS, 0.5)
        assert set(kinds) == {"intermediate", "discrete"}
        np.testing.assert_allclose(values[is_average][:, REAL], 0.2)

        copies = values[~is_average]
        is_of_one = (copies == self.ONE).all(axis=1)
        assert ((copies == self.OTHER).all(axis=1) ^ is_of_one).all()
        assert near(is_of_one.sum(), len(copies), 0.5)

    def test_each_value_may_come_from_either_parent(self):
        operators = replace(PAPER, intermediate_share=0.0, discrete_crossover="values")
        generator = rng(4)
        children = [cross_over(operators, self.ONE, self.OTHER, generator) for _ in range(DRAWS)]
        assert {kind for _, kind in children} == {"discrete"}
        mixed = np.array([values for values, _ in children])
        is_of_one = mixed == self.ONE
        assert ((mixed == self.OTHER) ^ is_of_one).all()
        assert near(is_of_one.sum(axis=0), DRAWS, 0.5)
        assert largest_correlation(is_of_one) < 0.04

    def test_booleans_come_from_either_parent(self, children):
        values, kinds = children
        booleans = values[kinds == "intermediate"][:, IS_BOOLEAN]
        assert set(np.unique(booleans)) == {0.0, 1.0}
        assert near(booleans.sum(axis=0), len(booleans), 0.5)


POPULATION = [Genome(p_vector_forget=i / 10) for i in range(10)]


class TestSelection:
    def children(self, operators, fitness):
        """Return children of many generations after `POPULATION`, without the elite."""
        generator = rng(3)
        children = []
        for _ in range(CHILDREN // 8):
            generation = next_generation(operators, POPULATION, fitness, generator)
            children += generation[operators.elite :]
        return children

    def test_both_parents_are_drawn_by_their_shares_of_the_fitness(self):
        fitness = np.arange(0.0, 1000.0, 100.0)
        share = fitness / fitness.sum()
        children = self.children(replace(STILL, crossover_rate=0.2), fitness)

        # Children of one parent.
        of_one = [child for child in children if child.origin == "mutation"]
        assert near(len(of_one), CHILDREN, 0.8)
        parents = [child.parents[0] for child in of_one]
        assert [child.genome for child in of_one] == [POPULATION[parent] for parent in parents]
        counts = np.bincount(parents, minlength=10)
        assert counts[0] == 0
        assert stats.chisquare(counts[1:], share[1:] * len(of_one)).pvalue > 1e-3

        # Children of two parents.
        of_two = [child for child in children if child.origin != "mutation"]
        pairs = np.zeros((10, 10))
        np.add.at(pairs, tuple(np.array([child.parents for child in of_two]).T), 1)
        assert not pairs[0].any()
        assert not pairs[:, 0].any()
        expected = np.outer(share, share)[1:, 1:] * len(of_two)
        assert stats.chisquare(pairs[1:, 1:].ravel(), expected.ravel()).pvalue > 1e-3
        n_averages = sum(child.origin == "intermediate" for child in of_two)
        assert near(n_averages, len(of_two), 0.5)

    def test_children_have_the_genes_of_both_parents_that_they_name(self):
        """A gene is the average of both, or as often the one's as the other's."""
        children = self.children(replace(STILL, crossover_rate=1.0), np.ones(10))
        genes = np.array([genome.p_vector_forget for genome in POPULATION])
        gene = np.array([child.genome.p_vector_forget for child in children])
        first, second = genes[np.array([child.parents for child in children])].T
        is_average = np.array([child.origin == "intermediate" for child in children])
        np.testing.assert_allclose(gene[is_average], ((first + second) / 2)[is_average])

        is_mixed = ~is_average & (first != second)
        is_of_first = (gene == first)[is_mixed]
        is_of_second = (gene == second)[is_mixed]
        assert (is_of_first ^ is_of_second).all()
        assert near(is_of_first.sum(), is_mixed.sum(), 0.5)

    def test_fitness_below_zero_counts_as_zero(self):
        np.testing.assert_allclose(selection_probabilities([-50, 0, 30, 10]), [0, 0, 0.75, 0.25])
        np.testing.assert_allclose(selection_probabilities([-50, 0, -30, -10]), 0.25)
        np.testing.assert_allclose(selection_probabilities([0.0]), 1.0)

    def test_the_elite_passes_unchanged(self):
        fitness = [1, 5, 3, 9, 2, 9, 4, 0, 7, 6]
        wild = Operators(dependent_rate=1.0, independent_rate=1.0, crossover_rate=1.0)
        for generator in map(rng, range(50)):
            best, second, *children = next_generation(wild, POPULATION, fitness, generator)
            assert best == (POPULATION[3], "elite", (3,))
            assert second == (POPULATION[5], "elite", (5,))
            assert len(children) == 8
            for child in children:
                assert child.origin != "elite"
                assert child.genome not in POPULATION


def test_the_seed_determines_all_generations():
    def generations(seed):
        generator = rng(seed)
        first = random_population(PAPER, 10, generator)
        genomes = [individual.genome for individual in first]
        return first, next_generation(PAPER, genomes, range(10), generator)

    assert generations(5) == generations(5)
    assert generations(5) != generations(6)
    first, _ = generations(5)
    assert {individual.origin for individual in first} == {"random"}


@pytest.mark.parametrize(
    "values, message",
    [
        ({"elite": -1}, r"operators\.elite must be a whole number at least 0 \(got -1\)"),
        (
            {"boolean_mutation": "turn"},
            r"operators\.boolean_mutation must be flip or redraw or keep \(got 'turn'\)",
        ),
        ({"density_min": 0.0}, r"operators\.density_min must be above 0.*\(got 0\.0\)"),
        (
            {"density_max": 0.005},
            r"operators\.density_max must be at least `operators.density_min` \(got 0\.005\)",
        ),
    ],
)
def test_operators_out_of_range_are_refused(values, message):
    with pytest.raises(UserError, match=message):
        Operators(**values)
