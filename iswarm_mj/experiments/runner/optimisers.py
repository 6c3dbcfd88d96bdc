"""Methods of searching for a fit genome, one generation at a time: the paper's, and two for comparison.

Their random numbers depend on the seed and the generation only, so that the same fitness values lead to the same
genomes when a search is repeated or resumed.
"""

from collections.abc import Sequence
from typing import Protocol, get_args

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


class Optimiser(Protocol):
    """A search that proposes genomes and receives their fitness, in turn.

    Attributes:
        learns: whether what it proposes depends on that fitness; otherwise it may be asked several times first.
    """

    learns: bool

    def ask(self) -> list[Individual]:
        """Return the genomes of the next generation."""
        ...

    def tell(self, fitness: Sequence[float]) -> None:
        """Receive the fitness of the genomes that the last `ask` returned."""
        ...


def optimiser(method: str, operators: Operators, population: int, seed: int) -> Optimiser:
    """Return the search of this name, with `population` genomes per generation."""
    if method == "cmaes":
        return CmaEs(operators, population, seed)
    return (Evolution if method == "paper" else RandomSearch)(operators, population, seed)


def generator(seed: int, generation: int) -> np.random.Generator:
    """Random numbers of a generation."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(generation,)))


class RandomSearch:
    """Every genome is drawn at random, as in the first generation of the evolution."""

    learns = False

    def __init__(self, operators: Operators, population: int, seed: int):
        self._operators, self._size, self._seed = operators, population, seed
        self._generation = 0

    def ask(self) -> list[Individual]:
        """Return the genomes of the next generation."""
        return random_population(self._operators, self._size, self._next_generator())

    def tell(self, fitness: Sequence[float]) -> None:
        """Learn nothing."""

    def _next_generator(self) -> np.random.Generator:
        self._generation += 1
        return generator(self._seed, self._generation - 1)


class Evolution(RandomSearch):
    """The paper's evolution; the elite is evaluated again in each generation, with other random numbers.

    This yields the paper's 1200 simulations in 120 generations of 10 swarms, and a swarm that was lucky once does not
    stay at the top.
    """

    learns = True
    _population: list[Individual] | None = None
    _fitness: Sequence[float] = ()

    def ask(self) -> list[Individual]:
        """Return the genomes of the next generation."""
        if self._population is None:
            self._population = super().ask()
        else:
            genomes = [individual.genome for individual in self._population]
            self._population = next_generation(self._operators, genomes, self._fitness, self._next_generator())
        return self._population

    def tell(self, fitness: Sequence[float]) -> None:
        """Receive the fitness of the genomes that the last `ask` returned."""
        self._fitness = fitness


class CmaEs:
    """CMA-ES with margin (Hamano et al. 2022), of the `cmaes` package, from the middle of the ranges.

    The search space is the unit cube, onto which the ranges are mapped; a Boolean is true above 0.5, and the margin
    keeps both of its values possible. When the search has converged, it restarts at a random point.
    """

    learns = True
    SIGMA = 0.3
    """Standard deviation at the start, as a share of the ranges."""

    def __init__(self, operators: Operators, population: int, seed: int):
        self._low, self._high = ranges(operators)
        self._size, self._seed = population, seed
        self._generation = 0
        self._begin(np.full(len(self._low), 0.5))

    def ask(self) -> list[Individual]:
        """Return the genomes of the next generation."""
        asked = [self._search.ask() for _ in range(self._size)]
        self._points = [point for _, point in asked]
        values = [self._low + np.clip(x, 0.0, 1.0) * (self._high - self._low) for x, _ in asked]
        return [Individual(to_genome(np.clip(v, self._low, self._high)), "cmaes") for v in values]

    def tell(self, fitness: Sequence[float]) -> None:
        """Receive the fitness of the genomes that the last `ask` returned."""
        self._search.tell([(point, -value) for point, value in zip(self._points, fitness, strict=True)])
        self._generation += 1
        if self._search.should_stop():
            self._begin(generator(self._seed, self._generation).random(len(self._low)))

    def _begin(self, mean: np.ndarray) -> None:
        seed = int(generator(self._seed, self._generation).integers(2**31))
        bounds = np.tile([0.0, 1.0], (len(mean), 1))
        steps = IS_BOOLEAN.astype(float)
        with np.errstate(divide="ignore"):  # of two or three, one is learned from; its rank-mu update has no weight
            self._search = CMAwM(mean, self.SIGMA, bounds, steps, seed=seed, population_size=self._size)
