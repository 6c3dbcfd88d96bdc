"""The paper's evolution: rates measured over many draws, against the binomial and uniform
distributions."""

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
DRAWS = 20_000
CHILDREN = 6_000
"""Of pairs that are selected, one after the other."""


def rng(seed=0):
    return np.random.default_rng(seed)


def near(count, n, p):
    """Whether a count of n trials agrees with a probability, within five standard deviations."""
    return np.all(np.abs(np.asarray(count) - n * p) <= 5 * np.sqrt(n * p * (1 - p)))


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
        assert stats.kstest(values[:, i], stats.uniform(low[i], high[i] - low[i]).cdf).pvalue > 1e-3
    assert near(values[:, IS_BOOLEAN].sum(axis=0), DRAWS, 0.5)
    assert abs(np.corrcoef(values.T) - np.eye(len(NAMES))).max() < 0.04


class TestMutation:
    MIDDLE = np.where(IS_BOOLEAN, 1.0, sum(ranges(PAPER)) / 2)

    def mutants(self, operators, vector=MIDDLE, seed=0):
        return mutate(operators, np.tile(vector, (DRAWS, 1)), rng(seed))

    def test_dependent_mutation(self):
        """Half of the values change, evenly within 0.05; half of the Booleans turn over; each by
        itself."""
        mutants = self.mutants(replace(PAPER, independent_rate=0.0))
        changed = mutants != self.MIDDLE
        assert near(changed.sum(axis=0), DRAWS, 0.5)
        assert abs(np.corrcoef(changed.T) - np.eye(len(NAMES))).max() < 0.04
        for i in np.flatnonzero(REAL):
            steps = (mutants - self.MIDDLE)[changed[:, i], i]
            assert stats.kstest(steps, stats.uniform(-0.05, 0.1).cdf).pvalue > 1e-3

    def test_a_relative_span(self):
        mutants = self.mutants(replace(PAPER, independent_rate=0.0, relative_span=True))
        share = (mutants / self.MIDDLE - 1)[:, REAL]
        np.testing.assert_allclose(np.abs(share).max(axis=0), 0.05, rtol=0.01)

    @pytest.mark.parametrize("mutation, turned", [("flip", 0.5), ("redraw", 0.25), ("keep", 0.0)])
    def test_what_it_does_to_booleans(self, mutation, turned):
        """From either value alike, each by itself; real values mutate as ever."""
        operators = replace(PAPER, independent_rate=0.0, boolean_mutation=mutation)
        for value in (0.0, 1.0):
            start = np.where(IS_BOOLEAN, value, self.MIDDLE)
            changed = self.mutants(operators, start) != start
            assert near(changed.sum(axis=0)[IS_BOOLEAN], DRAWS, turned) and near(
                changed.sum(axis=0)[REAL],
                DRAWS,
                0.5,
            )
            assert (
                turned == 0 or abs(np.corrcoef(changed[:, IS_BOOLEAN].T) - np.eye(3)).max() < 0.04
            )

    def test_independent_mutation(self):
        """One value in twenty is drawn anew from its range, each by itself; half of such Booleans
        change."""
        mutants = self.mutants(replace(PAPER, dependent_rate=0.0))
        changed = mutants != self.MIDDLE
        assert near(changed.sum(axis=0)[REAL], DRAWS, 0.05) and near(
            changed.sum(axis=0)[IS_BOOLEAN],
            DRAWS,
            0.025,
        )
        assert abs(np.corrcoef(changed.T) - np.eye(len(NAMES))).max() < 0.04
        low, high = ranges(PAPER)
        for i in np.flatnonzero(REAL):
            drawn = mutants[changed[:, i], i]
            assert stats.kstest(drawn, stats.uniform(low[i], high[i] - low[i]).cdf).pvalue > 1e-3

    @pytest.mark.parametrize("edge", [0, 1])
    def test_values_stay_in_their_ranges(self, edge):
        low, high = ranges(PAPER)
        start = np.where(IS_BOOLEAN, 0.0, (low, high)[edge])
        mutants = self.mutants(PAPER, start)
        assert (mutants >= low).all() and (mutants <= high).all()
        at_edge = (mutants == start)[:, REAL].sum(axis=0)
        assert near(
            at_edge,
            DRAWS,
            0.95 * (0.5 + 0.25),
        )  # half of the steps lead out, and end at the edge


class TestCrossover:
    ONE = np.where(IS_BOOLEAN, 1.0, 0.1)
    OTHER = np.where(IS_BOOLEAN, 0.0, 0.3)

    def children(self, operators=PAPER):
        generator = rng(2)
        values, kinds = zip(
            *(cross_over(operators, self.ONE, self.OTHER, generator) for _ in range(DRAWS)),
            strict=True,
        )
        return np.array(values), np.array(kinds)

    def test_half_are_averages_and_half_are_mixed(self):
        values, kinds = self.children()
        average = kinds == "intermediate"
        assert near(average.sum(), DRAWS, 0.5) and set(kinds) == {"intermediate", "discrete"}
        np.testing.assert_allclose(values[average][:, REAL], 0.2)
        mixed = values[~average] == self.ONE
        assert ((values[~average] == self.OTHER) ^ mixed).all()
        assert near(mixed.sum(axis=0), len(mixed), 0.5)
        assert abs(np.corrcoef(mixed.T) - np.eye(len(NAMES))).max() < 0.06

    def test_booleans_come_from_either_parent(self):
        values, kinds = self.children()
        booleans = values[kinds == "intermediate"][:, IS_BOOLEAN]
        assert set(np.unique(booleans)) == {0.0, 1.0} and near(
            booleans.sum(axis=0),
            len(booleans),
            0.5,
        )


POPULATION = [Genome(p_vector_forget=i / 10) for i in range(10)]


class TestSelection:
    def parents(self, operators, fitness):
        generator, found = rng(3), []
        for _ in range(CHILDREN // 8):
            found += next_generation(operators, POPULATION, fitness, generator)[operators.elite :]
        return found

    def test_both_parents_are_drawn_by_their_shares_of_the_fitness(self):
        fitness = np.arange(0.0, 1000.0, 100.0)
        children = self.parents(replace(STILL, crossover_rate=0.2), fitness)
        alone = [c for c in children if c.origin == "mutation"]
        assert all(c.genome == POPULATION[c.parents[0]] for c in alone) and near(
            len(alone),
            CHILDREN,
            0.8,
        )
        counts = np.bincount([c.parents[0] for c in alone], minlength=10)
        assert counts[0] == 0
        assert stats.chisquare(counts[1:], fitness[1:] / 4500 * len(alone)).pvalue > 1e-3
        pairs = np.zeros((10, 10))
        np.add.at(
            pairs,
            tuple(np.array([c.parents for c in children if c.origin != "mutation"]).T),
            1,
        )
        assert not pairs[0].any() and not pairs[:, 0].any()
        expected = np.outer(fitness, fitness)[1:, 1:] / 4500**2 * pairs.sum()
        assert stats.chisquare(pairs[1:, 1:].ravel(), expected.ravel()).pvalue > 1e-3
        assert near(sum(c.origin == "intermediate" for c in children), pairs.sum(), 0.5)

    def test_children_have_the_genes_of_both_parents_that_they_name(self):
        """The average of both, or as often the one's as the other's."""
        children = self.parents(replace(STILL, crossover_rate=1.0), np.ones(10))
        one, other = (
            np.array([POPULATION[i].p_vector_forget for i in names])
            for names in zip(*(c.parents for c in children), strict=True)
        )
        own, average = (
            np.array([f(c) for c in children])
            for f in (lambda c: c.genome.p_vector_forget, lambda c: c.origin == "intermediate")
        )
        np.testing.assert_allclose(own[average], ((one + other) / 2)[average])
        mixed = ~average & (one != other)
        assert ((own == one) ^ (own == other))[mixed].all()
        assert near((own == one)[mixed].sum(), mixed.sum(), 0.5)

    def test_fitness_below_zero_counts_as_zero(self):
        np.testing.assert_allclose(selection_probabilities([-50, 0, 30, 10]), [0, 0, 0.75, 0.25])
        np.testing.assert_allclose(selection_probabilities([-50, 0, -30, -10]), 0.25)
        np.testing.assert_allclose(selection_probabilities([0.0]), 1.0)

    def test_the_elite_passes_unchanged(self):
        fitness = [1, 5, 3, 9, 2, 9, 4, 0, 7, 6]
        wild = Operators(dependent_rate=1.0, independent_rate=1.0, crossover_rate=1.0)
        for generator in map(rng, range(50)):
            best, second, *others = next_generation(wild, POPULATION, fitness, generator)
            assert (best, second) == (
                (POPULATION[3], "elite", (3,)),
                (POPULATION[5], "elite", (5,)),
            )
            assert len(others) == 8 and not any(
                o.origin == "elite" or o.genome in POPULATION for o in others
            )


def test_a_seed_tells_all():
    def generations(seed):
        generator = rng(seed)
        population = random_population(PAPER, 10, generator)
        return [
            population,
            next_generation(PAPER, [i.genome for i in population], range(10), generator),
        ]

    assert generations(5) == generations(5) != generations(6)
    assert {i.origin for i in generations(5)[0]} == {"random"}


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
def test_what_cannot_be_is_refused(values, message):
    with pytest.raises(UserError, match=message):
        Operators(**values)
