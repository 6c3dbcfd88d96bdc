"""The search for fit swarms: its table with a row per run, and its files."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.search.best import LAST_GENERATIONS, Best, best_of, by_replicate
from iswarm_mj.search.journal import Journal, Key, journal
from iswarm_mj.search.methods import METHODS, Individual
from iswarm_mj.search.plots import draw_fitness
from iswarm_mj.search.pool import Execution, Job, Outcome, progress, run_missing
from iswarm_mj.search.rows import Rows, by
from iswarm_mj.search.seeds import run_seed
from iswarm_mj.search.settings import SearchPlan
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.scenario_flags import is_same
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.constraints import check_kind
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.extras import require
from iswarm_mj.utils.files import atomic_write, remove_parts
from iswarm_mj.utils.pool import Backend
from iswarm_mj.utils.tables import write_table

MAX_BATCH_RUNS = 4096
"""Maximum number of runs in a set of jobs that holds several generations of random search."""
CHECKPOINT = "checkpoint.sqlite"
TABLE = "evolution.parquet"
BEST = "best.json"
FIGURE = "fitness"
_USED_FIELDS = ("config", "engine", "seed", "steps")
"""Fields of its scenario that a search uses."""


@dataclass(frozen=True)
class Search(SearchPlan):
    """A search, and the scenario of its runs.

    Replicate 0 is the search with one; the others are those with the seeds of
    `search.replicate_seed`. In batches this is so up to rounding, see `pool.run_batches`.
    """

    scenario: Scenario = field(default_factory=Scenario)
    """Configuration, engine, seed and control steps of the runs; genomes and numbers of robots are
    searched for."""

    def __post_init__(self):
        super().__post_init__()
        unused = _unused_fields(self.scenario)
        if unused:
            raise UserError(
                "a search finds genomes, and with them numbers of robots, that clean one world "
                f"with the paper's robots; it does not use {' and '.join(unused)} of its scenario: "
                "leave them out"
            )

    @property
    def config(self) -> SwarmConfig:
        """Configuration of all runs."""
        return self.scenario.config

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that determine the outcome, apart from the engine, as files state them."""
        return {
            **_plan_of(self),
            "operators": asdict(self.operators),
            "steps": self.scenario.steps,
            "seed": self.scenario.seed,
            "config": asdict(self.config),
        }

    @property
    def n_runs(self) -> int:
        """Runs of a generation, in all replicates."""
        return self.replicates * self.population * self.evaluations


def _plan_of(plan: SearchPlan) -> dict[str, Any]:
    """Return the values of a plan by the names of its fields.

    A `Search` is a plan, too; what it has beside that, its scenario, is left out.
    """
    return {each.name: getattr(plan, each.name) for each in fields(SearchPlan)}


def _unused_fields(scenario: Scenario) -> list[str]:
    """Return the names of the fields of a scenario that are set and that a search does not use."""
    default = Scenario()
    unused = []
    for each in fields(Scenario):
        is_set = not is_same(getattr(scenario, each.name), getattr(default, each.name))
        if each.compare and each.name not in _USED_FIELDS and is_set:
            unused.append(each.name)
    return unused


def replicate_seed(seed: int, replicate: int) -> int:
    """Return the seed of a replicate.

    That of the first is the search's own, so that it is the search with one replicate.
    """
    # Two numbers, since keys of one belong to generations (`evolution`) and keys of three to runs.
    return seed if replicate == 0 else run_seed(seed, replicate, 0)


def settings_of(search: Search, execution: Execution) -> dict[str, Any]:
    """Return the settings that determine the outcome, as files contain them."""
    return {**search.settings, **execution.identity}


def evolve(
    scenario: Scenario,
    out: Path,
    plan: SearchPlan | None = None,
    *,
    workers: int = 0,
    backend: Backend = "processes",
    again: bool = False,
) -> Best:
    """Search for fit genomes in a scenario, as `iswarm evolve`, and return the best.

    Results are written into a directory, see `run_search`.

    Args:
        scenario: configuration, engine, seed and control steps of the runs; robots follow from each
            genome.
        out: directory of the results; a search that it holds is resumed.
        plan: how genomes are searched for; by default the paper's evolution.
        workers: processes, 0 for one per core; the results do not depend on it.
        backend: workers on this machine, or on a Ray cluster.
        again: discard the search in `out`, which is otherwise resumed.

    Raises:
        UserError: the scenario has fields that a search does not use, or the directory holds
            another search.
    """
    require("search")
    check_kind("scenario", scenario, Scenario)
    # `Search` refuses fields of the scenario that it does not use.
    search = Search(**_plan_of(plan or SearchPlan()), scenario=scenario)
    return run_search(search, Path(out), Execution(scenario.engine, workers, backend), again)


def run_search(
    search: Search, out: Path, execution: Execution | None = None, again: bool = False
) -> Best:
    """Search, write the results into a directory, print a summary, and return the best genome.

    Files:

    - evolution.parquet: a row per run with its place, the genome and where that comes from, seed,
      measures, `fitness`, and `genome_fitness`, the mean over the runs of the genome in this
      generation, by which genomes are selected.
    - best.json: a genome; with replicates also the best of each, best-0.json and so on.
    - fitness.png and .svg.
    - checkpoint.sqlite.

    The table is written after each set of jobs, the others at the end. A generation of all
    replicates is one set of jobs; in batches so are several generations of random search.

    Neither the number of workers nor an interruption changes a byte of the files. In batches a
    generation that a checkpoint contains in part is repeated as a whole; its bytes are then the
    same on CPUs, and on GPUs if these round reproducibly.

    Args:
        search: what to do.
        out: directory of the results.
        execution: how to run the jobs, by default on all cores; a search must be resumed with its
            own engine.
        again: discard the search in `out`, which is otherwise resumed.

    Raises:
        UserError: the directory holds another search.
    """
    execution = execution or Execution()
    settings = settings_of(search, execution)

    def write_rows(rows: Rows) -> None:
        write_table(out / TABLE, rows, settings)

    with journal(out / CHECKPOINT, settings, again) as finished:
        remove_parts(out, TABLE, BEST, "best-*.json", f"{FIGURE}.png", f"{FIGURE}.svg")
        if execution.in_batches:
            _forget_partial_generations(finished, search.n_runs)
        rows = _rows(search, execution, finished, write_rows)
        write_rows(rows)
        best = best_of(rows)
        _write_genome(out / BEST, best)
        if search.replicates > 1:
            for number, replicate_rows in enumerate(by_replicate(rows)):
                _write_genome(out / f"best-{number}.json", best_of(replicate_rows))
        draw_fitness(rows, search.config.arena.n_dust, out / FIGURE)
    print(summary(search, rows, best, out))
    return best


def _forget_partial_generations(finished: Journal, n_runs: int) -> None:
    """Leave out the runs of generations of which not all runs are known.

    Args:
        finished: journal, whose file stays as it is.
        n_runs: number of runs of a generation.
    """
    n_known = Counter(key[0] for key in finished.entries)
    partial = [key for key in finished.entries if n_known[key[0]] != n_runs]
    for key in partial:
        del finished.entries[key]


def _write_genome(path: Path, best: Best) -> None:
    """Write a genome as a file that `load_genome` reads."""
    with atomic_write(path) as part:
        part.write_text(json.dumps(asdict(best.genome), indent=2) + "\n", encoding="utf-8")


class _Planned(NamedTuple):
    """A run of a search."""

    individual: Individual
    job: Job


class _Replicate:
    """A replicate of a search, which proposes generations and learns from their fitness."""

    def __init__(self, search: Search, number: int):
        self._search = search
        self._number = number
        self._seed = replicate_seed(search.scenario.seed, number)
        method = METHODS[search.method]
        self._proposals = method(search.operators, search.population, self._seed)
        self._fitness: Any = None  # a generator begins with None

    def propose(self, generation: int) -> dict[Key, _Planned]:
        """Return the runs of the next generation by their places in the search."""
        planned = {}
        for index, individual in enumerate(self._proposals.send(self._fitness)):
            for evaluation in range(self._search.evaluations):
                place = (generation, index, evaluation)
                planned[(*place, self._number)] = _Planned(individual, self._job(individual, place))
        return planned

    def learn(self, rows: Rows, generation: int) -> None:
        """Take the fitness of a generation from the rows of its runs, for the next proposal."""
        fitness_of = {}
        for row in rows:
            if (row["replicate"], row["generation"]) == (self._number, generation):
                fitness_of[row["individual"]] = row["genome_fitness"]
        self._fitness = list(fitness_of.values())

    def _job(self, individual: Individual, place: Key) -> Job:
        """Return a run of an individual."""
        config = self._search.config
        density = individual.genome.density_of_robots
        return Job(
            config,
            individual.genome,
            n_robots=robots_for(config.arena, density, "density_of_robots"),
            seed=run_seed(self._seed, *place),
            steps=self._search.scenario.steps,
        )


def _rows(
    search: Search, execution: Execution, finished: Journal, save: Callable[[Rows], None]
) -> list[dict[str, Any]]:
    """Carry out the runs that are not in the journal, and return the rows of all.

    Args:
        search: what to do.
        execution: how to run the jobs.
        finished: journal, to which runs are added.
        save: is called with the rows so far after each set of jobs with new runs.
    """
    replicates = [_Replicate(search, number) for number in range(search.replicates)]
    rows: list[dict[str, Any]] = []
    with progress(search.generations * search.n_runs, done=len(finished.entries)) as bar:
        for generations in _sets_of_generations(search, execution):
            planned = _propose(replicates, generations)
            n_known = len(finished.entries)
            jobs = {key: run.job for key, run in planned.items()}
            outcomes = run_missing(jobs, finished, execution, bar)

            new_rows = list(map(_row, planned.keys(), planned.values(), outcomes))
            _add_genome_fitness(new_rows)
            for replicate in replicates:
                replicate.learn(new_rows, generations[-1])

            rows += new_rows
            best = max(row["fitness"] for row in new_rows)
            bar.say(f"generation {generations[-1] + 1}, best {best:z.0f}")
            if len(finished.entries) > n_known:
                save(rows)
    return rows


def _sets_of_generations(search: Search, execution: Execution) -> Iterator[range]:
    """Yield the numbers of the generations that are run together.

    Random search needs no fitness, and the time of a batch hardly grows with its worlds.
    """
    together = 1
    if execution.in_batches and search.method == "random":
        together = max(1, MAX_BATCH_RUNS // search.n_runs)
    for first in range(0, search.generations, together):
        yield range(first, min(first + together, search.generations))


def _propose(replicates: Iterable[_Replicate], generations: range) -> dict[Key, _Planned]:
    """Return the runs of some generations of all replicates by their places in the search."""
    planned: dict[Key, _Planned] = {}
    for generation in generations:
        for replicate in replicates:
            planned |= replicate.propose(generation)
    return planned


def _row(key: Key, run: _Planned, outcome: Outcome) -> dict[str, Any]:
    """Return the row of a run, but for the fitness of its genome."""
    generation, index, evaluation, replicate = key
    parent, second_parent, *_ = (*run.individual.parents, None, None)
    return {
        "replicate": replicate,
        "generation": generation,
        "individual": index,
        "evaluation": evaluation,
        "origin": run.individual.origin,
        "parent": parent,
        "second_parent": second_parent,
        **asdict(run.job.genome),
        "n_robots": run.job.n_robots,
        "seed": run.job.seed,
        **outcome,
    }


def _add_genome_fitness(rows: list[dict[str, Any]]) -> None:
    """Add the mean fitness over the runs of each genome in its generation to the rows."""
    for runs in by(rows, "replicate", "generation", "individual").values():
        mean = float(np.mean([row["fitness"] for row in runs]))
        for row in runs:
            row["genome_fitness"] = mean


def summary(search: Search, rows: Rows, best: Best, out: Path) -> str:
    """Return a readable summary of a search."""
    n_dust = search.config.arena.n_dust
    n_clean = sum(row["delivered"] == n_dust for row in rows)
    first_of_last = search.generations - LAST_GENERATIONS
    last_fitness = [row["fitness"] for row in rows if row["generation"] >= first_of_last]
    lines = {
        "search": (
            f"{search.method}, {search.replicates} replicate(s) of {search.generations} "
            f"generations of {search.population}, seed {search.scenario.seed}"
        ),
        "runs": f"{len(rows)}, of which {n_clean} delivered all {n_dust} balls",
        "fitness": (
            f"{np.mean(last_fitness):z.0f} on average over the last {LAST_GENERATIONS} generations"
        ),
        "best": f"{best.fitness:z.0f} on average over its {best.n_runs} run(s)",
    }
    for name, value in asdict(best.genome).items():
        lines[name] = f"{value:.3g}" if isinstance(value, float) else str(value)
    lines["results"] = f"{out}; try the best by: iswarm clean --genome {out / BEST}"
    return "\n".join(f"{name:>24}  {text}" for name, text in lines.items())
