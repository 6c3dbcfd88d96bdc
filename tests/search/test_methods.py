"""Methods of searching: they beat chance, stay within the ranges, and do not get stuck."""

import numpy as np
import pytest
from support.search import worth

from iswarm_mj.search.methods import METHODS, Operators, generator, ranges, to_vector


def densities(individuals):
    """Return the densities of robots of some individuals."""
    return np.array([individual.genome.density_of_robots for individual in individuals])


def fitness_by_generation(method, n_generations=60):
    """Return the fitness of the genomes of a search (G, 10)."""
    search = METHODS[method](Operators(), 10, seed=1)
    fitness = [None]
    for _ in range(n_generations):
        individuals = search.send(fitness[-1])
        fitness.append([worth(individual.genome) for individual in individuals])
    return np.array(fitness[1:])


@pytest.mark.parametrize("method", ["paper", "cmaes"])
def test_searches_beat_chance(method):
    chance = fitness_by_generation("random")
    fitness = fitness_by_generation(method)
    without_learning = max(fitness[:5].mean(), chance.mean())
    assert fitness[-20:].mean() > without_learning + 3 * chance.std() / np.sqrt(50)
    assert fitness.max() > chance.max()


@pytest.mark.parametrize("method", METHODS)
def test_genomes_lie_in_their_ranges(method):
    """The densest swarms are the fittest, so that a search comes near the limit."""
    operators = Operators(density_min=0.1, density_max=0.2)
    low, high = ranges(operators)
    search = METHODS[method](operators, 10, seed=2)
    fitness = None
    for _ in range(30):
        population = search.send(fitness)
        vectors = np.array([to_vector(individual.genome) for individual in population])
        assert len(population) == 10
        assert (vectors >= low).all()
        assert (vectors <= high).all()
        fitness = (1000 * densities(population)).tolist()
    assert densities(population).max() <= 0.2
    assert method == "random" or densities(population).mean() > 0.17


def test_cma_es_restarts_when_it_has_converged():
    search = METHODS["cmaes"](Operators(), 10, seed=0)
    population = next(search)
    spreads = []
    for _ in range(400):
        spreads.append(densities(population).std())
        population = search.send([1.0] * 10)
    converged = int(np.argmin(spreads))
    assert max(spreads[converged + 1 :]) > 5 * spreads[converged]


def test_generations_have_random_numbers_of_their_own():
    draws = set()
    for seed in range(5):
        for generation in range(20):
            draws.add(generator(seed, generation).random())
    assert len(draws) == 100

    search = METHODS["random"](Operators(), 10, 3)
    genomes = set()
    for _ in range(4):
        genomes |= {individual.genome for individual in next(search)}
    assert len(genomes) == 40
