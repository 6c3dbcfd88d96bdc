"""Methods of searching for a fit genome, one generation at a time: the paper's, and two for comparison.

A search is a generator: it yields the individuals of a generation and is sent their fitness. Its random numbers depend
on the seed and the generation only, so that the same fitness values lead to the same genomes when it is repeated.
"""

from collections.abc import Generator, Sequence
from itertools import count
from typing import get_args

import numpy as np
from cmaes import CMAwM

from iswarm_mj.experiments.runner.evolution import (
    IS_BOOLEAN,
    Individual,
    Operators,
    next_generation,
    random_population,
    ranges,
    to_genome,
)
from iswarm_mj.experiments.runner.search_settings import Method

METHODS: tuple[Method, ...] = get_args(Method)
SIGMA = 0.3
"""Standard deviation of CMA-ES at the start, as a share of the ranges."""
Proposals = Generator[list[Individual], Sequence[float], None]


def proposals(method: Method, operators: Operators, population: int, seed: int) -> Proposals:
    """Return the search of this name, with `population` genomes per generation; of random search fitness is ignored."""
    return {"paper": _paper, "cmaes": _cmaes, "random": _random}[method](operators, population, seed)


def generator(seed: int, generation: int) -> np.random.Generator:
    """Random numbers of a generation."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(generation,)))


def _random(operators: Operators, size: int, seed: int) -> Proposals:
    for generation in count():
        yield random_population(operators, size, generator(seed, generation))


def _paper(operators: Operators, size: int, seed: int) -> Proposals:
    """The elite is evaluated again in each generation, with other random numbers.

    This yields the paper's 1200 simulations in 120 generations of 10 swarms, and a swarm that was lucky once does not
    stay at the top.
    """
    population = random_population(operators, size, generator(seed, 0))
    for generation in count(1):
        fitness = yield population
        genomes = [individual.genome for individual in population]
        population = next_generation(operators, genomes, fitness, generator(seed, generation))


def _cmaes(operators: Operators, size: int, seed: int) -> Proposals:
    """CMA-ES with margin (Hamano et al. 2022), of the `cmaes` package, from the middle of the ranges.

    The search space is the unit cube, onto which the ranges are mapped; a Boolean is true above 0.5, and the margin
    keeps both of its values possible. When the search has converged, it restarts at a random point.
    """
    low, high = ranges(operators)
    search = None
    for generation in count():
        if search is None or search.should_stop():
            mean = np.full(len(low), 0.5) if search is None else generator(seed, generation).random(len(low))
            number, bounds = int(generator(seed, generation).integers(2**31)), np.tile([0.0, 1.0], (len(low), 1))
            with np.errstate(divide="ignore"):  # of two or three, one is learned from; its rank-mu update has no weight
                search = CMAwM(mean, SIGMA, bounds, IS_BOOLEAN.astype(float), seed=number, population_size=size)
        asked = [search.ask() for _ in range(size)]
        values = [low + np.clip(x, 0.0, 1.0) * (high - low) for x, _ in asked]
        fitness = yield [Individual(to_genome(np.clip(v, low, high)), "cmaes") for v in values]
        search.tell([(point, -value) for (_, point), value in zip(asked, fitness, strict=True)])
