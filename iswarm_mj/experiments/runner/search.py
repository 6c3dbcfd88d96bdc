"""The search for fit swarms: generations of runs, their table, the best genome, and a checkpoint to go on from."""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import asdict, astuple, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from iswarm_mj.config import SwarmConfig
from iswarm_mj.experiments.analysis.evolution_figure import draw
from iswarm_mj.experiments.runner.checkpoint import Journal
from iswarm_mj.experiments.runner.jobs import Job, Outcome
from iswarm_mj.experiments.runner.optimisers import optimiser
from iswarm_mj.experiments.runner.pool import Finished, check_engine, each, identity, progress
from iswarm_mj.simulation.initial import robots_for
from iswarm_mj.strategy.evolution import Individual, Operators
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, make_output_directory
from iswarm_mj.utils.serialization import to_dict
from iswarm_mj.utils.tables import write_table

CHECKPOINT, TABLE, BEST, FIGURE = "checkpoint.jsonl", "evolution.parquet", "best.json", "fitness"
RUNS_OF_THE_BEST = 3
"""The best genome is looked for among those of at least so many runs, if there are any."""

Runner = Callable[[Sequence[Job]], Finished]


@dataclass(frozen=True)
class Search:
    """All that decides the outcome of a search."""

    config: SwarmConfig = field(default_factory=SwarmConfig)
    operators: Operators = field(default_factory=Operators)
    method: str = "paper"
    """One of `optimisers.METHODS`."""
    generations: int = 120
    population: int = 10
    steps: int = 800
    """Control steps of a run at most."""
    seed: int = 0
    evaluations: int = 1
    """Runs of each genome in each generation; its fitness is their mean."""


class Best(NamedTuple):
    """The fittest genome of a search."""

    genome: Genome
    fitness: float
    """Mean over its runs."""
    n_runs: int


def evolve(
    search: Search, out: Path, resume: bool = False, workers: int = 0, backend: str = "processes",
    engine: str = "mujoco",
) -> Best:  # fmt: skip
    """Search, write the results into `out`, print a summary.

    Files: evolution.parquet, a row a run (see `rows_of`); best.json, a genome; fitness.png and .svg; checkpoint.jsonl.
    The table is written after each generation, the others in the end. Neither the number of workers nor an
    interruption changes a byte of them. With mjx, where a generation is one batch, a generation that is in the
    checkpoint in part is run again as a whole; that holds on CPUs, and on GPUs as far as a batch rounds alike twice.

    Args:
        search: what to do.
        out: directory of the results.
        resume: go on with the search that was begun in `out`, if there is one.
        workers: see `pool.each`.
        backend: see `pool.each`.
        engine: see `pool.each`; a search goes on with that it was begun with.

    Raises:
        UserError: `out` cannot be written to, holds a search that is not to be resumed, or another one.
        SimulationFault: a run could not go on.
    """
    check_engine(engine, backend)
    _check_out(out, resume)
    make_output_directory(out)
    settings = settings_of(search, engine)
    with Journal(out / CHECKPOINT, settings) as journal:
        _sweep(out)
        if engine == "mjx":
            _forget_parts(search, journal)
        total = search.generations * search.population * search.evaluations
        with progress(total, done=len(journal.entries)) as bar:
            run = partial(each, workers=workers, engine=engine, backend=backend)
            rows = _all_generations(search, settings, out, journal, bar, run)
        journal.settle()
        write_table(out / TABLE, rows, settings)
        best = best_of(rows)
        with atomic_write(out / BEST) as part:
            part.write_text(json.dumps(asdict(best.genome), indent=2) + "\n", encoding="utf-8")
        draw(rows, search.config.arena.n_dust, out / FIGURE)
    print(summary(search, rows, best, out))
    return best


def settings_of(search: Search, engine: str) -> dict[str, Any]:
    """All that decides the outcome of a search on an engine, as its files have it; they do not name the default one."""
    return {**to_dict(search), **identity(engine)}


def run_seed(search: Search, generation: int, individual: int, evaluation: int) -> int:
    """Seed of one run, within 0 to 2^32 - 2."""
    sequence = np.random.SeedSequence(search.seed, spawn_key=(generation, individual, evaluation))
    return int(sequence.generate_state(1, np.uint64)[0] % (2**32 - 1))


def rows_of(
    generation: int, individuals: Sequence[Individual], jobs: Sequence[Job], outcomes: Sequence[Outcome]
) -> list[dict[str, Any]]:
    """Rows of a generation's table: place, origin and parents, genome, robots and seed, measures, both fitnesses.

    `jobs` and `outcomes` hold all runs of the first individual, then all of the second, and so on. `fitness` is that
    of the run, `genome_fitness` the mean over the genome's runs in this generation, by which it is selected.
    """
    n_runs = len(jobs) // len(individuals)
    rows = []
    for number, (job, outcome) in enumerate(zip(jobs, outcomes, strict=True)):
        place, evaluation = divmod(number, n_runs)
        individual = individuals[place]
        one, other = (*individual.parents, None, None)[:2]
        rows.append(
            {"generation": generation, "individual": place, "evaluation": evaluation, "origin": individual.origin,
             "parent": one, "second_parent": other, **asdict(job.genome), "n_robots": job.n_robots, "seed": job.seed,
             **outcome._asdict(), "genome_fitness": _mean_fitness(outcomes[place * n_runs : (place + 1) * n_runs])}
        )  # fmt: skip
    return rows


def best_of(rows: Sequence[dict[str, Any]]) -> Best:
    """Genome with the highest mean fitness over all its runs, of those with `RUNS_OF_THE_BEST` runs or more.

    One run says little of a genome, and the luckiest of many says less. Where no genome has so many runs, all count.
    """
    runs: dict[Genome, list[float]] = {}
    for row in rows:
        runs.setdefault(genome_of(row), []).append(row["fitness"])
    known = {genome: values for genome, values in runs.items() if len(values) >= RUNS_OF_THE_BEST} or runs
    genome = max(known, key=lambda g: float(np.mean(known[g])))
    return Best(genome, float(np.mean(known[genome])), len(known[genome]))


def genome_of(row: dict[str, Any]) -> Genome:
    """Genome in a row of the table."""
    return Genome(**{name: row[name] for name in asdict(Genome())})


def summary(search: Search, rows: Sequence[dict[str, Any]], best: Best, out: Path) -> str:
    """Readable summary of a search."""
    n_dust = search.config.arena.n_dust
    last = [row for row in rows if row["generation"] >= search.generations - 20]
    clean = sum(row["delivered"] == n_dust for row in rows)
    lines = [
        ("search", f"{search.method}, {search.generations} generations of {search.population}, seed {search.seed}"),
        ("runs", f"{len(rows)}, of which {clean} delivered all {n_dust} balls"),
        ("fitness", f"{np.mean([row['fitness'] for row in last]):z.0f} on average over the last 20 generations"),
        ("best", f"{best.fitness:z.0f} on average over its {best.n_runs} run(s)"),
        *(("", f"{name} = {value:.3g}" if isinstance(value, float) else f"{name} = {value}")
          for name, value in asdict(best.genome).items()),
        ("results", f"{out}; try the best by: iswarm clean --genome {out / BEST}"),
    ]  # fmt: skip
    return "\n".join(f"{name:>12}  {text}" for name, text in lines)


def _all_generations(
    search: Search, settings: Mapping[str, Any], out: Path, journal: Journal, bar: tqdm, run: Runner
) -> list[dict[str, Any]]:
    """Rows of all generations; runs that the journal has are not done again."""
    method = optimiser(search.method, search.operators, search.population, search.seed)
    rows: list[dict[str, Any]] = []
    for generation in range(search.generations):
        individuals = method.ask()
        jobs = _jobs(search, generation, individuals)
        known = len(journal.entries)
        outcomes = _outcomes(search, generation, jobs, journal, bar, run)
        rows += rows_of(generation, individuals, jobs, outcomes)
        n_runs = search.evaluations
        method.tell([_mean_fitness(outcomes[i : i + n_runs]) for i in range(0, len(jobs), n_runs)])
        bar.set_postfix_str(f"generation {generation + 1}, best {max(o.fitness for o in outcomes):z.0f}", refresh=False)
        if len(journal.entries) > known:
            write_table(out / TABLE, rows, settings)
    return rows


def _jobs(search: Search, generation: int, individuals: Sequence[Individual]) -> list[Job]:
    jobs = []
    for place, individual in enumerate(individuals):
        n_robots = robots_for(search.config.arena, individual.genome.density_of_robots, "density_of_robots")
        job = Job(search.config, individual.genome, n_robots, seed=0, steps=search.steps)
        jobs += [replace(job, seed=run_seed(search, generation, place, k)) for k in range(search.evaluations)]
    return jobs


def _outcomes(
    search: Search, generation: int, jobs: Sequence[Job], journal: Journal, bar: tqdm, run: Runner
) -> list[Outcome]:
    """Outcomes of a generation's jobs: those of the journal, and the others from the pool into the journal."""
    keys = [(generation, *divmod(number, search.evaluations)) for number in range(len(jobs))]
    missing = [number for number, key in enumerate(keys) if key not in journal.entries]
    with closing(run([jobs[number] for number in missing])) as finished:
        for index, outcome in finished:
            number = missing[index]
            journal.add(keys[number], {"genome": astuple(jobs[number].genome), "outcome": outcome})
            bar.update()
    for key, job in zip(keys, jobs, strict=True):
        if list(journal.entries[key]["genome"]) != list(astuple(job.genome)):
            raise UserError(
                f"{CHECKPOINT} has another genome in generation {key[0]} than this program would try there; "
                "it is of another version: begin again in another --out."
            )
    return [Outcome(*journal.entries[key]["outcome"]) for key in keys]


def _forget_parts(search: Search, journal: Journal) -> None:
    """Forget generations of which only some runs are known; of a run that is written twice, the later one counts."""
    known = Counter(key[0] for key in journal.entries)
    journal.entries = {
        key: entry for key, entry in journal.entries.items() if known[key[0]] == search.population * search.evaluations
    }


def _mean_fitness(outcomes: Sequence[Outcome]) -> float:
    return float(np.mean([outcome.fitness for outcome in outcomes]))


def _check_out(out: Path, resume: bool) -> None:
    """Raise a UserError if `out` holds results that are in the way."""
    if (out / CHECKPOINT).exists():
        if not resume:
            raise UserError(f"--out was {out}, which holds a search already; go on with --resume, or choose another.")
    elif (out / TABLE).exists():
        raise UserError(f"--out was {out}, which holds a search without its {CHECKPOINT}; choose another.")


def _sweep(out: Path) -> None:
    """Remove what a killed process left half written."""
    for name in (CHECKPOINT, TABLE, BEST, f"{FIGURE}.png", f"{FIGURE}.svg"):
        for part in out.glob(f".*-{name}"):
            part.unlink()
