"""The runs of a search, generation after generation, and its table, which has a row per run."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.experiments.runner.evolution import Individual
from iswarm_mj.experiments.runner.experiment import run_seed as seed_of_place
from iswarm_mj.experiments.runner.jobs import Job, Outcome
from iswarm_mj.experiments.runner.journal import Key
from iswarm_mj.experiments.runner.optimisers import optimiser
from iswarm_mj.experiments.runner.search_settings import Search
from iswarm_mj.tasks.layout import robots_for


class Place(NamedTuple):
    """Where a run stands in a search; its key in the journal."""

    generation: int
    individual: int
    evaluation: int
    replicate: int = 0


class Replicates:
    """The replicates of a search, which advance together.

    Attributes:
        rows: of all generations so far, see `rows_of`.
    """

    def __init__(self, search: Search):
        self._search = search
        seeds = [replicate_seed(search.seed, replicate) for replicate in range(search.replicates)]
        self._methods = [optimiser(search.method, search.operators, search.population, seed) for seed in seeds]
        self._asked: list[tuple[list[Individual], dict[Place, Job]]] = []
        self.rows: list[dict[str, Any]] = []

    @property
    def learns(self) -> bool:
        """Whether a generation depends on the outcomes of those before."""
        return self._methods[0].learns

    def ask(self, generations: Sequence[int]) -> dict[Key, Job]:
        """Jobs of the next generations of all replicates; one generation if it learns."""
        self._asked = []
        for generation in generations:
            for replicate, method in enumerate(self._methods):
                individuals = method.ask()
                self._asked.append((individuals, _jobs(self._search, generation, replicate, individuals)))
        return {place: job for _, jobs in self._asked for place, job in jobs.items()}

    def tell(self, outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
        """Take in the outcomes of these jobs; return their rows."""
        made, rest = [], iter(outcomes)
        for number, (individuals, jobs) in enumerate(self._asked):
            rows = rows_of(individuals, {place: (job, next(rest)) for place, job in jobs.items()})
            fitness = [row["genome_fitness"] for row in rows[:: self._search.evaluations]]
            self._methods[number % len(self._methods)].tell(fitness)
            made += rows
        self.rows += made
        return made


def replicate_seed(seed: int, replicate: int) -> int:
    """Seed of a replicate: the search's own for the first, which is the search with one replicate."""
    # Two numbers, since keys of one belong to generations (`optimisers`) and keys of three to runs.
    return seed if replicate == 0 else seed_of_place(seed, replicate, 0)


def run_seed(search: Search, place: Place) -> int:
    """Seed of one run, within 0 to 2^32 - 2."""
    return seed_of_place(replicate_seed(search.seed, place.replicate), *place[:3])


def rows_of(individuals: Sequence[Individual], runs: Mapping[Place, tuple[Job, Outcome]]) -> list[dict[str, Any]]:
    """Rows of a generation of one replicate: place, origin, parents, genome, robots, seed, measures, fitness values.

    In a row, `fitness` is that of the run; `genome_fitness`, by which genomes are selected, is the mean over the runs
    of the genome in this generation.
    """
    fitness: dict[int, list[float]] = {}
    for place, (_, outcome) in runs.items():
        fitness.setdefault(place.individual, []).append(outcome.fitness)
    rows = []
    for place, (job, outcome) in runs.items():
        individual = individuals[place.individual]
        parent, second_parent = (*individual.parents, None, None)[:2]
        rows.append(
            {
                "replicate": place.replicate,
                "generation": place.generation,
                "individual": place.individual,
                "evaluation": place.evaluation,
                "origin": individual.origin,
                "parent": parent,
                "second_parent": second_parent,
                **asdict(job.genome),
                "n_robots": job.n_robots,
                "seed": job.seed,
                **outcome.columns,
                "genome_fitness": float(np.mean(fitness[place.individual])),
            }
        )
    return rows


def _jobs(search: Search, generation: int, replicate: int, individuals: Sequence[Individual]) -> dict[Place, Job]:
    """Jobs of a generation of one replicate by their places."""
    jobs = {}
    for index, individual in enumerate(individuals):
        n_robots = robots_for(search.config.arena, individual.genome.density_of_robots, "density_of_robots")
        for evaluation in range(search.evaluations):
            place = Place(generation, index, evaluation, replicate)
            jobs[place] = Job(search.config, individual.genome, n_robots, run_seed(search, place), search.steps)
    return jobs
