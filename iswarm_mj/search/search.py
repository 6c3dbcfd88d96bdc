"""The search for fit swarms: its table with a row per run, and its files."""

import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.search.best import LAST, Best, best_of, by_replicate
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
from iswarm_mj.utils.files import atomic_write, remove_parts
from iswarm_mj.utils.pool import Backend
from iswarm_mj.utils.tables import write_table

AT_ONCE = 4096
"""Runs of a set of jobs at most, where several generations of random search are a batch."""
Asked = dict[Key, tuple[Individual, Job]]
CHECKPOINT, TABLE, BEST, FIGURE = "checkpoint.sqlite", "evolution.parquet", "best.json", "fitness"


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
                "a search finds genomes, and with them numbers of robots, that clean one world with the paper's "
                f"robots; it does not use {' and '.join(unused)} of its scenario: leave them out"
            )

    @property
    def config(self) -> SwarmConfig:
        """Configuration of all runs."""
        return self.scenario.config

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that determine the outcome, apart from the engine, as files state them."""
        plan = {f.name: getattr(self, f.name) for f in fields(SearchPlan)}
        operators = asdict(plan.pop("operators"))
        run = {
            "steps": self.scenario.steps,
            "seed": self.scenario.seed,
            "config": asdict(self.config),
        }
        return {**plan, "operators": operators, **run}

    @property
    def n_runs(self) -> int:
        """Runs of a generation, in all replicates."""
        return self.replicates * self.population * self.evaluations


def _unused_fields(scenario: Scenario) -> list[str]:
    """Return the names of the fields of a scenario that are set and that a search does not use."""
    used = {"config", "engine", "seed", "steps"}
    usual = Scenario()
    return [
        f.name
        for f in fields(Scenario)
        if f.compare
        and f.name not in used
        and not is_same(getattr(scenario, f.name), getattr(usual, f.name))
    ]


def replicate_seed(seed: int, replicate: int) -> int:
    """Seed of a replicate: the search's own for the first, which is the search with one
    replicate."""
    # Two numbers, since keys of one belong to generations (`evolution`) and keys of three to runs.
    return seed if replicate == 0 else run_seed(seed, replicate, 0)


def settings_of(search: Search, execution: Execution) -> dict[str, Any]:
    """Settings that determine the outcome, as files contain them."""
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
    """Search for fit genomes in a scenario, as `iswarm evolve`; write results into `out` and return
    the best.

    Args:
        scenario: configuration, engine, seed and control steps of the runs; robots follow from each
            genome.
        out: directory of the results, see `run_search`; a search in it goes on.
        plan: how genomes are searched for; by default the paper's evolution.
        workers: processes, 0 for one per core; the results do not depend on it.
        backend: workers on this machine, or on a Ray cluster.
        again: discard the search in `out`, which otherwise goes on.

    Raises:
        UserError: the scenario has fields that a search does not use, or the directory holds
            another search.
    """
    check_kind("scenario", scenario, Scenario)
    plan = plan or SearchPlan()
    chosen = {f.name: getattr(plan, f.name) for f in fields(SearchPlan)}
    search = Search(**chosen, scenario=scenario)
    return run_search(search, Path(out), Execution(scenario.engine, workers, backend), again)


def run_search(
    search: Search, out: Path, execution: Execution | None = None, again: bool = False
) -> Best:
    """Search, write the results into a directory, print a summary; return the best genome.

    Files: evolution.parquet, a row per run: its place, the genome and where that comes from, seed,
        measures, `fitness`,
    and `genome_fitness`, the mean over the runs of the genome in this generation, by which genomes
    are selected; best.json, a genome, and with replicates the best of each, best-0.json and so on;
    fitness.png and .svg; checkpoint.sqlite. The table is written after each set of jobs, the others
    at the end. A generation of all replicates is one set of jobs, and in batches so are several
    generations of random search. Neither the number of workers nor an interruption changes a byte
    of the files. In batches a generation that a checkpoint contains in part is repeated as a whole;
    its bytes are then the same on CPUs, and on GPUs if these round reproducibly.

    Args:
        search: what to do.
        out: directory of the results.
        execution: how to run the jobs, by default on all cores; a search must be resumed with its
            own engine.
        again: discard the search in `out`, which otherwise goes on.
    """
    execution = execution or Execution()
    settings = settings_of(search, execution)
    with journal(out / CHECKPOINT, settings, again) as finished:
        remove_parts(out, TABLE, BEST, "best-*.json", f"{FIGURE}.png", f"{FIGURE}.svg")
        if execution.in_batches:  # a generation is run as a whole
            known = Counter(key[0] for key in finished.entries)
            finished.entries = {
                k: run for k, run in finished.entries.items() if known[k[0]] == search.n_runs
            }
        rows = _rows(
            search, execution, finished, lambda rows: write_table(out / TABLE, rows, settings)
        )
        write_table(out / TABLE, rows, settings)
        best = {BEST: best_of(rows)}
        if search.replicates > 1:
            best |= {
                f"best-{number}.json": best_of(mine)
                for number, mine in enumerate(by_replicate(rows))
            }
        for name, own in best.items():
            with atomic_write(out / name) as part:
                part.write_text(json.dumps(asdict(own.genome), indent=2) + "\n", encoding="utf-8")
        draw_fitness(rows, search.config.arena.n_dust, out / FIGURE)
    print(summary(search, rows, best[BEST], out))
    return best[BEST]


def _rows(
    search: Search, execution: Execution, finished: Journal, save: Callable[[Rows], None]
) -> list[dict[str, Any]]:
    """Rows of all runs, of which those are carried out that are not in the journal; `save` is
    called after each set."""
    rows: list[dict[str, Any]] = []
    seeds = [
        replicate_seed(search.scenario.seed, replicate) for replicate in range(search.replicates)
    ]
    methods = [METHODS[search.method](search.operators, search.population, seed) for seed in seeds]
    fitness: list[Any] = [None] * search.replicates
    is_large = (
        execution.in_batches and search.method == "random"
    )  # the time of batches hardly grows with their worlds
    stride = max(1, AT_ONCE // search.n_runs) if is_large else 1
    every = range(search.generations)
    with progress(search.generations * search.n_runs, done=len(finished.entries)) as bar:
        for generations in (every[first : first + stride] for first in every[::stride]):
            asked: Asked = {}
            for generation in generations:
                for replicate, (method, seed) in enumerate(zip(methods, seeds, strict=True)):
                    asked |= _jobs(
                        search, generation, replicate, seed, method.send(fitness[replicate])
                    )
            known = len(finished.entries)
            outcomes = run_missing(
                {key: job for key, (_, job) in asked.items()}, finished, execution, bar
            )
            new = [
                _row(key, *asked[key], outcome)
                for key, outcome in zip(asked, outcomes, strict=True)
            ]
            for (replicate, _), mine in by(new, "replicate", "generation").items():
                means = {
                    k: float(np.mean([row["fitness"] for row in own]))
                    for k, own in by(mine, "individual").items()
                }
                fitness[replicate] = list(means.values())
                for row in mine:
                    row["genome_fitness"] = means[row["individual"]]
            rows += new
            bar.say(
                f"generation {generations[-1] + 1}, best {max(row['fitness'] for row in new):z.0f}"
            )
            if len(finished.entries) > known:
                save(rows)
    return rows


def _jobs(
    search: Search, generation: int, replicate: int, seed: int, individuals: Sequence[Individual]
) -> Asked:
    """Runs of a generation of one replicate, by their places in the search."""
    jobs = {}
    for index, individual in enumerate(individuals):
        n_robots = robots_for(
            search.config.arena, individual.genome.density_of_robots, "density_of_robots"
        )
        for place in ((generation, index, evaluation) for evaluation in range(search.evaluations)):
            job = Job(
                search.config,
                individual.genome,
                n_robots,
                run_seed(seed, *place),
                search.scenario.steps,
            )
            jobs[(*place, replicate)] = individual, job
    return jobs


def _row(key: Key, individual: Individual, job: Job, outcome: Outcome) -> dict[str, Any]:
    """Row of a run, but for the fitness of its genome."""
    parents = (*individual.parents, None, None)
    return {
        "replicate": key[3],
        **dict(zip(("generation", "individual", "evaluation"), key, strict=False)),
        "origin": individual.origin,
        "parent": parents[0],
        "second_parent": parents[1],
        **asdict(job.genome),
        "n_robots": job.n_robots,
        "seed": job.seed,
        **outcome,
    }


def summary(search: Search, rows: Rows, best: Best, out: Path) -> str:
    """Readable summary of a search."""
    n_dust = search.config.arena.n_dust
    last = [row["fitness"] for row in rows if row["generation"] >= search.generations - LAST]
    lines = {
        "search": f"{search.method}, {search.replicates} replicate(s) of {search.generations} generations of "
        f"{search.population}, seed {search.scenario.seed}",
        "runs": f"{len(rows)}, of which {sum(row['delivered'] == n_dust for row in rows)} delivered all {n_dust} balls",
        "fitness": f"{np.mean(last):z.0f} on average over the last {LAST} generations",
        "best": f"{best.fitness:z.0f} on average over its {best.n_runs} run(s)",
        **{
            name: f"{v:.3g}" if isinstance(v, float) else str(v)
            for name, v in asdict(best.genome).items()
        },
        "results": f"{out}; try the best by: iswarm clean --genome {out / BEST}",
    }
    return "\n".join(f"{name:>24}  {text}" for name, text in lines.items())
