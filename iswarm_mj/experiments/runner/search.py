"""The search for fit swarms: generations of runs, their table, the best genome, and a checkpoint to resume from."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.experiments.analysis.evolution_figures import draw_fitness
from iswarm_mj.experiments.runner.checkpoint import Journal, Key
from iswarm_mj.experiments.runner.jobs import Job, Outcome
from iswarm_mj.experiments.runner.optimisers import Method, optimiser
from iswarm_mj.experiments.runner.pool import Execution, progress
from iswarm_mj.experiments.runner.resumable import run_missing
from iswarm_mj.experiments.runner.search_table import Best, best_of, rows_of
from iswarm_mj.simulation.initial import robots_for
from iswarm_mj.strategy.evolution import Individual, Operators
from iswarm_mj.utils.constraints import Within, check, validate
from iswarm_mj.utils.errors import ConfigError, UserError
from iswarm_mj.utils.files import atomic_write, make_output_directory
from iswarm_mj.utils.serialization import to_dict
from iswarm_mj.utils.tables import write_table

CHECKPOINT, TABLE, BEST, FIGURE = "checkpoint.jsonl", "evolution.parquet", "best.json", "fitness"


@dataclass(frozen=True)
class Search:
    """Everything that determines the outcome of a search, apart from the engine."""

    config: SwarmConfig = field(default_factory=SwarmConfig)
    operators: Operators = field(default_factory=Operators)
    method: Method = "paper"
    generations: Annotated[int, Within(1, 100_000)] = 120
    population: Annotated[int, Within(2, 10_000)] = 10
    steps: Annotated[int, Within(1, 1_000_000)] = 800
    """Largest number of control steps of a run."""
    seed: Annotated[int, Within(0, 2**32 - 2)] = 0
    evaluations: Annotated[int, Within(1, 1000)] = 1
    """Runs of each genome in each generation; its fitness is their mean."""

    def __post_init__(self):
        validate(self)
        elite = self.operators.elite
        check("operators.elite", elite, "below `population`", elite < self.population or self.method != "paper")

    @property
    def n_runs(self) -> int:
        """Runs of a generation."""
        return self.population * self.evaluations


def run_search(search: Search, out: Path, execution: Execution | None = None, resume: bool = False) -> Best:
    """Search, write the results into `out`, print a summary.

    Files: evolution.parquet, a row per run (see `search_table.rows_of`); best.json, a genome; fitness.png and .svg;
    checkpoint.jsonl. The table is written after each generation, the others at the end. Neither the number of workers
    nor an interruption changes a byte of them. With mjx, where a generation is one batch, a generation that the
    checkpoint contains in part is repeated as a whole; its bytes are then the same on CPUs, and on GPUs if these
    round reproducibly.

    Args:
        search: what to do.
        out: directory of the results.
        execution: how to run the jobs, by default on all cores; a search must be resumed with its own engine.
        resume: continue the search in `out`, if there is one.

    Raises:
        UserError: `out` is not writable, contains a search that is not to be resumed, or a different one.
        SimulationFault: a run could not go on.
    """
    execution = execution or Execution()
    _check_out(out, resume)
    make_output_directory(out)
    settings = settings_of(search, execution)
    with Journal(out / CHECKPOINT, settings) as journal:
        _remove_partial_files(out)
        if execution.engine == "mjx":
            _forget_partial_generations(search, journal)
        rows = _run_generations(search, execution, journal, out)
        journal.settle()
        write_table(out / TABLE, rows, settings)
        best = best_of(rows)
        with atomic_write(out / BEST) as part:
            part.write_text(json.dumps(asdict(best.genome), indent=2) + "\n", encoding="utf-8")
        draw_fitness(rows, search.config.arena.n_dust, out / FIGURE)
    print(summary(search, rows, best, out))
    return best


def settings_of(search: Search, execution: Execution) -> dict[str, Any]:
    """Settings that determine the outcome, as files contain them; these omit the default engine."""
    return {**to_dict(search), **execution.identity}


def run_seed(search: Search, generation: int, individual: int, evaluation: int) -> int:
    """Seed of one run, within 0 to 2^32 - 2."""
    sequence = np.random.SeedSequence(search.seed, spawn_key=(generation, individual, evaluation))
    return int(sequence.generate_state(1, np.uint64)[0] % (2**32 - 1))


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
    ]
    for name, value in asdict(best.genome).items():
        lines.append(("", f"{name} = {value:.3g}" if isinstance(value, float) else f"{name} = {value}"))
    lines.append(("results", f"{out}; try the best by: iswarm clean --genome {out / BEST}"))
    return "\n".join(f"{name:>12}  {text}" for name, text in lines)


def _run_generations(search: Search, execution: Execution, journal: Journal, out: Path) -> list[dict[str, Any]]:
    """Rows of all generations; runs in the journal are not repeated."""
    method = optimiser(search.method, search.operators, search.population, search.seed)
    settings = settings_of(search, execution)
    rows: list[dict[str, Any]] = []
    with progress(search.generations * search.n_runs, done=len(journal.entries)) as bar:
        for generation in range(search.generations):
            individuals = method.ask()
            jobs = _jobs(search, generation, individuals)
            n_known = len(journal.entries)
            run_missing(jobs, journal, execution, bar, _entry)
            outcomes = _outcomes(jobs, journal)
            made = rows_of(individuals, jobs, outcomes)
            rows += made
            method.tell([row["genome_fitness"] for row in made[:: search.evaluations]])
            best = max(outcome.fitness for outcome in outcomes)
            bar.set_postfix_str(f"generation {generation + 1}, best {best:z.0f}", refresh=False)
            if len(journal.entries) > n_known:
                write_table(out / TABLE, rows, settings)
    return rows


def _jobs(search: Search, generation: int, individuals: Sequence[Individual]) -> dict[Key, Job]:
    """Jobs of a generation by generation, individual and evaluation."""
    jobs = {}
    for place, individual in enumerate(individuals):
        n_robots = robots_for(search.config.arena, individual.genome.density_of_robots, "density_of_robots")
        for k in range(search.evaluations):
            seed = run_seed(search, generation, place, k)
            jobs[generation, place, k] = Job(search.config, individual.genome, n_robots, seed, search.steps)
    return jobs


def _entry(job: Job, outcome: Outcome) -> dict[str, Any]:
    """What the checkpoint keeps of a run."""
    return {"genome": astuple(job.genome), "outcome": outcome}


def _outcomes(jobs: Mapping[Key, Job], journal: Journal) -> list[Outcome]:
    """Outcomes of a generation's jobs from the journal."""
    for key, job in jobs.items():
        if list(journal.entries[key]["genome"]) != list(astuple(job.genome)):
            raise UserError(
                f"{CHECKPOINT} contains another genome in generation {key[0]} than this version of the program would "
                "try there; begin again in another `out`."
            )
    return [Outcome(*journal.entries[key]["outcome"]) for key in jobs]


def _forget_partial_generations(search: Search, journal: Journal) -> None:
    """Forget generations of which only some runs are known; of a run that is written twice, the later one counts."""
    n_known = Counter(key[0] for key in journal.entries)
    journal.entries = {key: entry for key, entry in journal.entries.items() if n_known[key[0]] == search.n_runs}


def _check_out(out: Path, resume: bool) -> None:
    """Raise a UserError if `out` contains results that would be overwritten."""
    if (out / CHECKPOINT).exists():
        if not resume:
            raise ConfigError("out", out, "a directory without a search", "continue the search with `resume`")
    elif (out / TABLE).exists():
        raise ConfigError("out", out, "a directory without a search", f"this one lacks its {CHECKPOINT}")


def _remove_partial_files(out: Path) -> None:
    """Remove what a killed process left half written."""
    for name in (CHECKPOINT, TABLE, BEST, f"{FIGURE}.png", f"{FIGURE}.svg"):
        for part in out.glob(f".*-{name}"):
            part.unlink()
