"""The search for fit swarms: generations of runs, their table, the best genome, and a checkpoint to resume from."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.experiments.analysis.evolution_best import Best, best_of, by_replicate
from iswarm_mj.experiments.analysis.evolution_figures import draw_fitness
from iswarm_mj.experiments.analysis.findings import Rows
from iswarm_mj.experiments.runner import experiment
from iswarm_mj.experiments.runner.checkpoint import Journal
from iswarm_mj.experiments.runner.jobs import Job, Outcome, is_outcome
from iswarm_mj.experiments.runner.limits import Generations, Population, Repeats, Seed, Steps
from iswarm_mj.experiments.runner.optimisers import Method, optimiser
from iswarm_mj.experiments.runner.pool import Execution, progress
from iswarm_mj.experiments.runner.resumable import run_missing
from iswarm_mj.experiments.runner.search_table import Place, rows_of
from iswarm_mj.strategy.evolution import Individual, Operators
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.constraints import check, validate
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.files import atomic_write, remove, remove_parts
from iswarm_mj.utils.lock import locked
from iswarm_mj.utils.serialization import added_later, to_dict
from iswarm_mj.utils.tables import write_table

CHECKPOINT, TABLE, BEST, FIGURE = "checkpoint.jsonl", "evolution.parquet", "best.json", "fitness"


@dataclass(frozen=True)
class Search:
    """Everything that determines the outcome of a search, apart from the engine."""

    config: SwarmConfig = field(default_factory=SwarmConfig)
    operators: Operators = field(default_factory=Operators)
    method: Method = "paper"
    generations: Generations = 120
    population: Population = 10
    steps: Steps = 800
    """Largest number of control steps of a run."""
    seed: Seed = 0
    evaluations: Repeats = 1
    """Runs of each genome in each generation; its fitness is their mean."""
    replicates: Repeats = added_later(1)  # noqa: RUF009
    """Independent repetitions of the search, which advance together. Replicate 0 is the search with one; the others are
    those with the seeds of `replicate_seed`. In batches this is so up to rounding, see `batches.run_batches`."""

    def __post_init__(self):
        validate(self)
        elite = self.operators.elite
        check("operators.elite", elite, "below `population`", elite < self.population or self.method != "paper")

    @property
    def n_runs(self) -> int:
        """Runs of a generation, in all replicates."""
        return self.replicates * self.population * self.evaluations


def run_search(
    search: Search, out: Path, execution: Execution | None = None, resume: bool = False, again: bool = False
) -> Best:
    """Search, write the results into `out`, print a summary.

    Files: evolution.parquet, a row per run (see `search_table.rows_of`); best.json, a genome, and with replicates the
    best of each, best-0.json and so on; fitness.png and .svg; checkpoint.jsonl. The table is written after each
    generation, the others at the end. A generation of all replicates is one set of jobs. Neither the number of workers
    nor an interruption changes a byte of the files. Where a generation is one batch, one that the checkpoint contains
    in part is repeated as a whole; its bytes are then the same on CPUs, and on GPUs if these round reproducibly.

    Args:
        search: what to do.
        out: directory of the results.
        execution: how to run the jobs, by default on all cores; a search must be resumed with its own engine.
        resume: continue the search in `out`, if there is one.
        again: discard the search in `out`.

    Raises:
        UserError: `out` is not writable or in use, contains a search that is not to be resumed, or a different one.
        SimulationFault: a run could not go on.
    """
    execution = execution or Execution()
    settings = settings_of(search, execution)
    with locked(out), _journal(out, settings, resume, again) as journal:
        remove_parts(out, CHECKPOINT, TABLE, BEST, best_name("*"), f"{FIGURE}.png", f"{FIGURE}.svg")
        if execution.in_batches:
            _forget_partial_generations(search, journal)
        rows = _run_generations(search, execution, journal, out)
        journal.settle()
        write_table(out / TABLE, rows, settings)
        best = best_of(rows)
        _write_genome(out / BEST, best)
        if search.replicates > 1:
            for replicate, mine in enumerate(by_replicate(rows)):
                _write_genome(out / best_name(replicate), best_of(mine))
        draw_fitness(rows, search.config.arena.n_dust, out / FIGURE)
    print(summary(search, rows, best, out))
    return best


def settings_of(search: Search, execution: Execution) -> dict[str, Any]:
    """Settings that determine the outcome, as files contain them; these omit the default engine."""
    return {**to_dict(search), **execution.identity}


def replicate_seed(seed: int, replicate: int) -> int:
    """Seed of a replicate: the search's own for the first, which is the search with one replicate."""
    # Two numbers, since keys of one belong to generations (`optimisers`) and keys of three to runs.
    return seed if replicate == 0 else experiment.run_seed(seed, replicate, 0)


def run_seed(search: Search, place: Place) -> int:
    """Seed of one run, within 0 to 2^32 - 2."""
    return experiment.run_seed(replicate_seed(search.seed, place.replicate), *place[:3])


def best_name(replicate: int | str) -> str:
    """Name of the file of a replicate's best genome."""
    return f"best-{replicate}.json"


def summary(search: Search, rows: Rows, best: Best, out: Path) -> str:
    """Readable summary of a search."""
    n_dust, times = search.config.arena.n_dust, f"{search.replicates} times " if search.replicates > 1 else ""

    def measured(some: Rows) -> tuple[int, float]:
        last = [row["fitness"] for row in some if row["generation"] >= search.generations - 20]
        return sum(row["delivered"] == n_dust for row in some), float(np.mean(last))

    clean, last = measured(rows)
    lines = [
        (
            "search",
            f"{search.method}, {times}{search.generations} generations of {search.population}, seed {search.seed}",
        ),
        ("runs", f"{len(rows)}, of which {clean} delivered all {n_dust} balls"),
        ("fitness", f"{last:z.0f} on average over the last 20 generations"),
        ("best", f"{best.fitness:z.0f} on average over its {best.n_runs} run(s)"),
    ]
    if search.replicates > 1:
        for replicate, mine in enumerate(by_replicate(rows)):
            (clean, last), (_, top, n_runs) = measured(mine), best_of(mine)
            told = f"{clean} of {len(mine)} delivered all, fitness {last:z.0f}, best {top:z.0f} over {n_runs} run(s)"
            lines.append((f"replicate {replicate}", told))
    for name, value in asdict(best.genome).items():
        lines.append(("", f"{name} = {value:.3g}" if isinstance(value, float) else f"{name} = {value}"))
    lines.append(("results", f"{out}; try the best by: iswarm clean --genome {out / BEST}"))
    return "\n".join(f"{name:>12}  {text}" for name, text in lines)


def _write_genome(path: Path, best: Best) -> None:
    with atomic_write(path) as part:
        part.write_text(json.dumps(asdict(best.genome), indent=2) + "\n", encoding="utf-8")


def _run_generations(search: Search, execution: Execution, journal: Journal, out: Path) -> list[dict[str, Any]]:
    """Rows of all generations; runs in the journal are not repeated."""
    seeds = [replicate_seed(search.seed, replicate) for replicate in range(search.replicates)]
    methods = [optimiser(search.method, search.operators, search.population, seed) for seed in seeds]
    settings = settings_of(search, execution)
    rows: list[dict[str, Any]] = []
    with progress(search.generations * search.n_runs, done=len(journal.entries)) as bar:
        for generation in range(search.generations):
            populations = [method.ask() for method in methods]
            jobs = [_jobs(search, generation, *numbered) for numbered in enumerate(populations)]
            n_known = len(journal.entries)
            run_missing(
                {place.key: job for mine in jobs for place, job in mine.items()}, journal, execution, bar, _entry
            )
            best = -np.inf
            for method, individuals, mine in zip(methods, populations, jobs, strict=True):
                made = rows_of(individuals, mine, _outcomes(mine, journal))
                rows += made
                method.tell([row["genome_fitness"] for row in made[:: search.evaluations]])
                best = max(best, *(row["fitness"] for row in made))
            bar.say(f"generation {generation + 1}, best {best:z.0f}")
            if len(journal.entries) > n_known:
                write_table(out / TABLE, rows, settings)
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


def _entry(job: Job, outcome: Outcome) -> dict[str, Any]:
    """What the checkpoint keeps of a run."""
    return {"genome": astuple(job.genome), "outcome": outcome}


def _is_entry(entry: Any) -> bool:
    """Whether a value from the checkpoint is what `_entry` returns."""
    known = isinstance(entry, dict) and set(entry) == {"genome", "outcome"}
    return known and isinstance(entry["genome"], list) and is_outcome(entry["outcome"])


def _outcomes(jobs: Mapping[Place, Job], journal: Journal) -> list[Outcome]:
    """Outcomes of jobs from the journal."""
    for place, job in jobs.items():
        if list(journal.entries[place.key]["genome"]) != list(astuple(job.genome)):
            raise UserError(
                f"{CHECKPOINT} contains another genome in generation {place.generation} than this version of the "
                "program would try there; begin again in another `out`."
            )
    return [Outcome(*journal.entries[place.key]["outcome"]) for place in jobs]


def _forget_partial_generations(search: Search, journal: Journal) -> None:
    """Forget generations of which only some runs are known; of a run that is written twice, the later one counts."""
    n_known = Counter(key[0] for key in journal.entries)
    journal.entries = {key: entry for key, entry in journal.entries.items() if n_known[key[0]] == search.n_runs}


def _journal(out: Path, settings: Mapping[str, Any], resume: bool, again: bool) -> Journal:
    """The search's journal, after what is to be discarded was removed."""
    if again:
        for name in (BEST, TABLE, CHECKPOINT):
            remove(out / name)
    _check_out(out, resume)
    return Journal(out / CHECKPOINT, settings, _is_entry)


def _check_out(out: Path, resume: bool) -> None:
    """Raise a UserError if `out` contains results that would be overwritten."""
    if (out / CHECKPOINT).exists():
        if not resume:
            raise ConfigError("out", out, "a directory without a search", "continue the search with `resume`")
    elif (out / TABLE).exists():
        raise ConfigError("out", out, "a directory without a search", f"this one lacks its {CHECKPOINT}")
