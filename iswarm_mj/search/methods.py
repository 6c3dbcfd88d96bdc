"""Methods of searching for a fit genome, one generation at a time.

The paper's evolution, and two others for comparison. Nothing here runs a swarm.

A search is a generator: it yields the individuals of a generation and is sent their fitness. Its
random numbers depend on the seed and the generation only, so that the same fitness values lead to
the same genomes when it is repeated.

Source of the paper's "Evolutionary Strategy": Valdastri et al. (2006), section 4.6, which
specifies: the best two pass unchanged; parents are drawn with probabilities proportional to their
fitness; dependent mutation at a rate of 0.5 within +-0.05 of the parent's value; independent
mutation at a rate of 0.05; crossover at a rate of 0.2, half of it intermediate, and in the other
half "the values of one of the two parents were transferred". Choices where it is silent:

- Crossover comes first, then dependent, then independent mutation; both kinds of mutation apply to
  each parameter independently. The second parent is drawn like the first, and may be the same.
- A crossover that is not intermediate copies all values of one parent, either with equal
  probability; `discrete_crossover` has the other reading.
- "+-0.05 of the parent's parameter value" is read as an absolute difference; `relative_span` reads
  it as a share of the value.
- A mutation that leaves the range ends at its limit: Table 2 has a value of 1.00.
- A dependent mutation flips a Boolean, which gives as many swarms without hop counts as the paper
  counts, 484 of 1200; `boolean_mutation` has other choices. An intermediate crossover takes a
  Boolean from either parent.
- A fitness below zero counts as zero; if none is above zero, all swarms are equally probable. The
  elite takes part in the draw.
- Densities lie within 0.01 and 0.33, that of "the biggest swarm that was tested during the
  evolutionary run", of 785 robots. All other parameters lie within 0 and 1, distances in units of
  the sensory radius.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, fields
from functools import cache
from itertools import count
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from iswarm_mj.strategy.genome import Genome, Share
from iswarm_mj.utils.constraints import Above, Within, check, validate

NAMES = [field.name for field in fields(Genome)]
"""Names of the P parameters of a genome."""
IS_BOOLEAN = np.array([field.type is bool for field in fields(Genome)])
"""Whether each of the P parameters is a Boolean (P,); in vectors Booleans are 0 or 1."""
SIGMA = 0.3
"""Standard deviation of CMA-ES at the start, as a share of the ranges."""


@dataclass(frozen=True)
class Operators:
    """Rates of the evolution; the defaults are the paper's where the module's docstring says so."""

    elite: Annotated[int, Within(0)] = 2
    """Number of the fittest swarms that pass to the next generation unchanged."""
    dependent_rate: Share = 0.5
    """Probability that a parameter mutates to a value near its own; for a Boolean see
    `boolean_mutation`."""
    span: Share = 0.05
    """Largest difference from its own value in a dependent mutation. Section 4.6: "the span of
    mutation was +-0.05 of the parent's parameter value"."""
    relative_span: bool = False
    """The span is a share of the parent's value instead of an absolute difference. "+-0.05 of the
    parent's parameter value" can mean either. The default is absolute since the paper writes 0.05
    and not 5 %, as it does for the errors of Table 1, and since a value near zero would hardly move
    otherwise. The spread of its swarms does not tell: with either, and a fitness that depends on
    hop counts alone, the fraction of scouts has a standard deviation of 0.19 within an evolution
    (median of 40), as independent mutations and the first generation decide it."""
    boolean_mutation: Literal["flip", "redraw", "keep"] = "flip"
    """What a dependent mutation does to a Boolean: flip it, redraw it (true or false with equal
    probability), or keep it. Section 4.6 has a span "of the parent's parameter value" only, which
    says nothing of Booleans. Its counts say more: 464 of 525 and 20 of 675 swarms, 484 of 1200, had
    no hop counts, though few of these were fit. With a fitness that depends on hop counts alone,
    flips give 481 (standard deviation 18 over 40 evolutions), redrawn values 288 (14), kept ones 36
    (7)."""
    independent_rate: Share = 0.05
    """Probability that a parameter is drawn anew from its whole range."""
    crossover_rate: Share = 0.2
    """Probability that an offspring has two parents."""
    intermediate_share: Share = 0.5
    """Share of the crossovers that average both parents; for the others see
    `discrete_crossover`."""
    discrete_crossover: Literal["parent", "values"] = "parent"
    """What a crossover that averages nothing transfers: all values of one parent, or each value
    from either parent. Section 4.6: "the values of one of the two parents were transferred to the
    offspring". By its words they are those of one parent, so that such a crossover is none; the
    usual discrete recombination of evolution strategies draws a parent for each value."""
    density_min: Annotated[float, Above(0, 1)] = 0.01
    """Smallest density of robots; 24 robots in the paper's arena."""
    density_max: Annotated[float, Above(0, 1)] = 0.33
    """Largest density of robots, that of the paper's biggest swarm; at 1, 2376 robots stand in the
    paper's arena, and generations take many times as long."""

    def __post_init__(self):
        validate(self, "operators")
        is_ordered = self.density_min <= self.density_max
        check(
            "operators.density_max",
            self.density_max,
            "at least `operators.density_min`",
            is_ordered,
        )


class Individual(NamedTuple):
    """One swarm of a generation."""

    genome: Genome
    origin: str
    """Operator that made it: random, elite, mutation, intermediate (crossover), discrete
    (crossover); or the name of another method."""
    parents: tuple[int, ...] = ()
    """Indices of its parents in the generation before."""


Proposals = Generator[list[Individual], Sequence[float], None]
"""A search: yields the individuals of a generation, and is sent their fitness."""


def to_vector(genome: Genome) -> Float[np.ndarray, "P"]:
    """Return the values of a genome, Booleans as 0 or 1."""
    return np.array([getattr(genome, name) for name in NAMES], float)


def to_genome(vector: Float[np.ndarray, "P"]) -> Genome:
    """Return the genome with these values; a Boolean is true above 0.5."""
    values: list[Any] = []
    for value, is_boolean in zip(vector, IS_BOOLEAN, strict=True):
        values.append(bool(value > 0.5) if is_boolean else float(value))
    return Genome(*values)


@cache
def ranges(operators: Operators) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the largest values of the parameters, (P,) each."""
    low = np.zeros(len(NAMES))
    high = np.ones(len(NAMES))
    density = NAMES.index("density_of_robots")
    low[density] = operators.density_min
    high[density] = operators.density_max
    for limits in (low, high):
        limits.flags.writeable = False  # all callers share them
    return low, high


def random_vector(
    operators: Operators, rng: np.random.Generator, shape: tuple[int, ...] = ()
) -> np.ndarray:
    """Draw values (*shape, P) uniformly from their ranges.

    Booleans are true or false with equal probability.
    """
    vector = rng.uniform(*ranges(operators), (*shape, len(NAMES)))
    return np.where(IS_BOOLEAN, vector > 0.5, vector)


def random_population(
    operators: Operators, size: int, rng: np.random.Generator
) -> list[Individual]:
    """Draw a first generation."""
    return [Individual(to_genome(random_vector(operators, rng)), "random") for _ in range(size)]


def selection_probabilities(fitness: Sequence[float]) -> Float[np.ndarray, "B"]:
    """Return the probability that each of B swarms is drawn as a parent.

    It is the swarm's share of the total fitness, where a fitness below zero counts as zero.
    """
    weight = np.maximum(fitness, 0.0)
    total = weight.sum()
    return weight / total if total > 0 else np.full(len(weight), 1 / len(weight))


def cross_over(
    operators: Operators, first: np.ndarray, second: np.ndarray, rng: np.random.Generator
) -> tuple[np.ndarray, str]:
    """Return the values of a child of two parents (P,), and the kind of the crossover."""
    is_of_first = rng.random(len(first)) < 0.5
    either = np.where(is_of_first, first, second)
    if rng.random() < operators.intermediate_share:
        return np.where(IS_BOOLEAN, either, (first + second) / 2), "intermediate"
    if operators.discrete_crossover == "parent":
        return (first if rng.random() < 0.5 else second), "discrete"
    return either, "discrete"


def mutate(operators: Operators, vector: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Return values (*M, P) after dependent and independent mutation of each."""
    shape = vector.shape

    # Dependent mutation: a value near the parent's, within its range.
    span = operators.span * (vector if operators.relative_span else 1.0)
    near = np.clip(vector + rng.uniform(-1.0, 1.0, shape) * span, *ranges(operators))
    match operators.boolean_mutation:
        case "flip":
            booleans = 1.0 - vector
        case "redraw":
            booleans = np.where(rng.random(shape) < 0.5, 1.0, 0.0)
        case "keep":
            booleans = vector
    dependent = np.where(IS_BOOLEAN, booleans, near)
    vector = np.where(rng.random(shape) < operators.dependent_rate, dependent, vector)

    # Independent mutation: a new value from the whole range.
    mutates = rng.random(shape) < operators.independent_rate
    return np.where(mutates, random_vector(operators, rng, shape[:-1]), vector)


def next_generation(
    operators: Operators,
    population: Sequence[Genome],
    fitness: Sequence[float],
    rng: np.random.Generator,
) -> list[Individual]:
    """Draw the generation that follows a population, of the same size.

    The elite comes first, its fittest ahead.
    """
    ranking = np.argsort(-np.asarray(fitness, float), kind="stable")
    elite = []
    for parent in ranking[: operators.elite].tolist():
        elite.append(Individual(population[parent], "elite", (parent,)))
    vectors = [to_vector(genome) for genome in population]
    probabilities = selection_probabilities(fitness)

    def draw_offspring() -> Individual:
        first, second = rng.choice(len(population), 2, p=probabilities).tolist()
        if rng.random() < operators.crossover_rate:
            vector, origin = cross_over(operators, vectors[first], vectors[second], rng)
            parents = (first, second)
        else:
            vector, origin = vectors[first], "mutation"
            parents = (first,)
        return Individual(to_genome(mutate(operators, vector, rng)), origin, parents)

    return elite + [draw_offspring() for _ in range(len(population) - len(elite))]


def generator(seed: int, generation: int) -> np.random.Generator:
    """Return the random numbers of a generation."""
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(generation,)))


def _random(operators: Operators, size: int, seed: int) -> Proposals:
    """Draw each generation as the first one."""
    for generation in count():
        yield random_population(operators, size, generator(seed, generation))


def _paper(operators: Operators, size: int, seed: int) -> Proposals:
    """Evolve as the paper does.

    The elite is evaluated again in each generation, with other random numbers. This yields the
    paper's 1200 simulations in 120 generations of 10 swarms, and a swarm that was lucky once does
    not stay at the top.
    """
    population = random_population(operators, size, generator(seed, 0))
    for generation in count(1):
        fitness = yield population
        genomes = [individual.genome for individual in population]
        population = next_generation(operators, genomes, fitness, generator(seed, generation))


def _cmaes(operators: Operators, size: int, seed: int) -> Proposals:
    """Search by CMA-ES with margin (Hamano et al. 2022), of the `cmaes` package.

    The search space is the unit cube, onto which the ranges are mapped; a Boolean is true above
    0.5, and the margin keeps both of its values possible. The search begins in the middle, and
    restarts at a random point when it has converged.
    """
    low, high = ranges(operators)
    search = None
    for generation in count():
        if search is None:
            search = _new_cmaes(np.full(len(low), 0.5), size, generator(seed, generation))
        elif search.should_stop():
            start = generator(seed, generation).random(len(low))
            search = _new_cmaes(start, size, generator(seed, generation))

        candidates = [search.ask() for _ in range(size)]
        individuals = []
        for point, _ in candidates:
            vector = low + np.clip(point, 0.0, 1.0) * (high - low)
            individuals.append(Individual(to_genome(np.clip(vector, low, high)), "cmaes"))

        fitness = yield individuals
        costs = []
        for (_, learnt), value in zip(candidates, fitness, strict=True):
            costs.append((learnt, -value))
        search.tell(costs)


def _new_cmaes(start: np.ndarray, size: int, rng: np.random.Generator) -> Any:
    """Return a search in the unit cube that begins at a point, its seed drawn from `rng`."""
    from cmaes import CMAwM  # it imports scipy.stats, which takes long, and flags need this module

    bounds = np.tile([0.0, 1.0], (len(start), 1))
    # Of populations of two or three one is learned from, and the rank-mu update has no weight.
    with np.errstate(divide="ignore"):
        return CMAwM(
            start,
            SIGMA,
            bounds,
            IS_BOOLEAN.astype(float),
            seed=int(rng.integers(2**31)),
            population_size=size,
        )


METHODS = {"paper": _paper, "random": _random, "cmaes": _cmaes}
"""Searches by operators, size of a generation, and seed, in the order of their results."""
