"""The replicates of a search: generation after generation, with outcomes from its journal."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from typing import Any

from iswarm_mj.experiments.runner import experiment
from iswarm_mj.experiments.runner.checkpoint import Journal, Key
from iswarm_mj.experiments.runner.jobs import Job, Outcome, is_outcome
from iswarm_mj.experiments.runner.optimisers import optimiser
from iswarm_mj.experiments.runner.search_settings import Search
from iswarm_mj.experiments.runner.search_table import Place, rows_of
from iswarm_mj.strategy.evolution import Individual
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.errors import UserError


class Replicates:
    """The replicates of a search, which advance together.

    Attributes:
        rows: of all generations so far, see `search_table.rows_of`.
    """

    def __init__(self, search: Search, journal: Journal):
        self._search, self._journal = search, journal
        seeds = [replicate_seed(search.seed, replicate) for replicate in range(search.replicates)]
        self._methods = [optimiser(search.method, search.operators, search.population, seed) for seed in seeds]
        self._asked: list[tuple[list[Individual], dict[Place, Job]]] = []
        self.rows: list[dict[str, Any]] = []

    @property
    def learns(self) -> bool:
        """Whether a generation depends on the outcomes of those before."""
        return any(method.learns for method in self._methods)

    def ask(self, generations: Sequence[int]) -> dict[Key, Job]:
        """Jobs of the next generations of all replicates, by their keys in the journal; one generation if it learns."""
        self._asked = []
        for generation in generations:
            for replicate, method in enumerate(self._methods):
                individuals = method.ask()
                self._asked.append((individuals, _jobs(self._search, generation, replicate, individuals)))
        return {place.key: job for _, jobs in self._asked for place, job in jobs.items()}

    def tell(self) -> list[dict[str, Any]]:
        """Go on with the outcomes of these jobs, which are in the journal; return their rows."""
        made: list[dict[str, Any]] = []
        for number, (individuals, jobs) in enumerate(self._asked):
            rows = rows_of(individuals, jobs, _outcomes(jobs, self._journal))
            fitness = [row["genome_fitness"] for row in rows[:: self._search.evaluations]]
            self._methods[number % len(self._methods)].tell(fitness)
            made += rows
        self.rows += made
        return made


def replicate_seed(seed: int, replicate: int) -> int:
    """Seed of a replicate: the search's own for the first, which is the search with one replicate."""
    # Two numbers, since keys of one belong to generations (`optimisers`) and keys of three to runs.
    return seed if replicate == 0 else experiment.run_seed(seed, replicate, 0)


def run_seed(search: Search, place: Place) -> int:
    """Seed of one run, within 0 to 2^32 - 2."""
    return experiment.run_seed(replicate_seed(search.seed, place.replicate), *place[:3])


def entry_of(job: Job, outcome: Outcome) -> dict[str, Any]:
    """What the journal keeps of a run."""
    return {"genome": astuple(job.genome), "outcome": outcome}


def is_entry(entry: Any) -> bool:
    """Whether a value from the journal is what `entry_of` returns."""
    known = isinstance(entry, dict) and set(entry) == {"genome", "outcome"}
    return known and isinstance(entry["genome"], list) and is_outcome(entry["outcome"])


def forget_partial(search: Search, journal: Journal) -> None:
    """Forget generations of which only some runs are known; of a run that is written twice, the later one counts."""
    n_known = Counter(key[0] for key in journal.entries)
    journal.entries = {key: entry for key, entry in journal.entries.items() if n_known[key[0]] == search.n_runs}


def _jobs(search: Search, generation: int, replicate: int, individuals: Sequence[Individual]) -> dict[Place, Job]:
    """Jobs of a generation of one replicate by their places."""
    jobs = {}
    for index, individual in enumerate(individuals):
        n_robots = robots_for(search.config.arena, individual.genome.density_of_robots, "density_of_robots")
        for evaluation in range(search.evaluations):
            place = Place(generation, index, evaluation, replicate)
            jobs[place] = Job(search.config, individual.genome, n_robots, run_seed(search, place), search.steps)
    return jobs


def _outcomes(jobs: Mapping[Place, Job], journal: Journal) -> list[Outcome]:
    """Outcomes of jobs from the journal."""
    for place, job in jobs.items():
        if list(journal.entries[place.key]["genome"]) != list(astuple(job.genome)):
            raise UserError(
                f"{journal.name} contains another genome in generation {place.generation} than this version of the "
                "program would try there; begin again in another `out`."
            )
    return [Outcome(*journal.entries[place.key]["outcome"]) for place in jobs]
