"""The search for fit swarms: its settings, its table with a row per run, its files, and several searches at once."""

import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.experiments.analysis.evolution import Best, best_of, by_replicate
from iswarm_mj.experiments.analysis.findings import Rows
from iswarm_mj.experiments.analysis.measures import by
from iswarm_mj.experiments.analysis.plots_of_searches import draw_fitness
from iswarm_mj.experiments.runner.batches import has_buffers
from iswarm_mj.experiments.runner.experiment import run_seed
from iswarm_mj.experiments.runner.jobs import Job, Outcome
from iswarm_mj.experiments.runner.journal import Journal, Key
from iswarm_mj.experiments.runner.optimisers import Individual, proposals
from iswarm_mj.experiments.runner.pool import Execution, progress, run_missing
from iswarm_mj.experiments.runner.search_settings import Search
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.files import atomic_write, check_resumable, remove_parts
from iswarm_mj.utils.lock import locked
from iswarm_mj.utils.tables import write_table

AT_ONCE = 4096
"""Runs of a set of jobs at most, where a search does not learn and several generations can be a batch of planar."""
CHECKPOINT, TABLE, BEST, FIGURE = "checkpoint.sqlite", "evolution.parquet", "best.json", "fitness"


def replicate_seed(seed: int, replicate: int) -> int:
    """Seed of a replicate: the search's own for the first, which is the search with one replicate."""
    # Two numbers, since keys of one belong to generations (`optimisers`) and keys of three to runs.
    return seed if replicate == 0 else run_seed(seed, replicate, 0)


def settings_of(search: Search, execution: Execution) -> dict[str, Any]:
    """Settings that determine the outcome, as files contain them."""
    return {**asdict(search), **execution.identity}


def run_search(search: Search, out: Path, execution: Execution | None = None, resume: bool = False) -> Best:
    """`run_searches` with one search in `out`; return its best genome."""
    return run_searches({out: search}, execution, resume)[0]


def run_searches(
    searches: Mapping[Path, Search], execution: Execution | None = None, resume: bool = False, again: bool = False
) -> list[Best]:
    """Search, write the results into the directories, print a summary of each.

    Files: evolution.parquet, a row per run: its place, the genome and where that comes from, seed, measures, `fitness`,
    and `genome_fitness`, the mean over the runs of the genome in this generation, by which genomes are selected;
    best.json, a genome, and with replicates the best of each, best-0.json and so on; fitness.png and .svg;
    checkpoint.sqlite. The table is written after each set of jobs, the others at the end. A generation of all searches
    that learn, with all replicates, is one set of jobs, and in batches of planar so are several generations of one that
    does not. Neither the number of workers nor an interruption changes a byte of the files. Where a set of jobs is one
    batch, a generation that a checkpoint contains in part is repeated as a whole; its bytes are then the same on CPUs,
    and on GPUs if these round reproducibly and the searches in the batch are the same.

    Args:
        searches: what to do, by the directories of the results.
        execution: how to run the jobs, by default on all cores; a search must be resumed with its own engine.
        resume: continue the search in a directory, if there is one.
        again: discard the search in a directory.

    Raises:
        UserError: a directory is not writable or in use, contains a search that is not to be resumed, a different or
            a damaged one; or a file cannot be written later.
        SimulationFault: a run could not go on.
    """
    execution = execution or Execution()
    with ExitStack() as stack:
        begun = [stack.enter_context(begin(out, one, execution, resume, again)) for out, one in searches.items()]
        total = sum(one.search.generations * one.search.n_runs for one in begun)
        with progress(total, done=sum(len(one.journal.entries) for one in begun)) as bar:
            for going, generations in _sets_of_jobs(begun, execution):
                known = [len(one.journal.entries) for one in going]
                wanted = [(one.ask(generations), one.journal) for one in going]
                rows = []
                for one, outcomes in zip(going, run_missing(wanted, execution, bar), strict=True):
                    rows += one.tell(outcomes)
                bar.say(f"generation {generations[-1] + 1}, best {max(row['fitness'] for row in rows):z.0f}")
                for one, n_known in zip(going, known, strict=True):
                    if len(one.journal.entries) > n_known:
                        one.save()
        best = [one.end() for one in begun]
    for one, own in zip(begun, best, strict=True):
        print(summary(one.search, one.rows, own, one.out))
    return best


@contextmanager
def begin(out: Path, search: Search, execution: Execution, resume: bool, again: bool) -> Iterator["_Running"]:
    """Begin a search in a directory, or go on with it; arguments and errors are those of `run_searches`."""
    settings = settings_of(search, execution)
    with locked(out):
        check_resumable(out, "search", CHECKPOINT, (BEST, TABLE), resume, again)
        with Journal(out / CHECKPOINT, settings) as journal:
            remove_parts(out, TABLE, BEST, "best-*.json", f"{FIGURE}.png", f"{FIGURE}.svg")
            if execution.in_batches:  # a generation is run as a whole
                known = Counter(key[0] for key in journal.entries)
                journal.entries = {k: run for k, run in journal.entries.items() if known[k[0]] == search.n_runs}
            yield _Running(search, out, settings, journal)


class _Running:
    """A search with its replicates, directory, settings, journal and rows so far."""

    def __init__(self, search: Search, out: Path, settings: dict[str, Any], journal: Journal):
        self.search, self.out, self.settings, self.journal = search, out, settings, journal
        self._seeds = [replicate_seed(search.seed, replicate) for replicate in range(search.replicates)]
        self._methods = [proposals(search.method, search.operators, search.population, seed) for seed in self._seeds]
        self._fitness: list[Any] = [None] * search.replicates
        self._asked: dict[Key, tuple[Individual, Job]] = {}
        self.rows: list[dict[str, Any]] = []

    def ask(self, generations: Sequence[int]) -> dict[Key, Job]:
        """Jobs of the next generations of all replicates, one generation if it learns, by places in the search."""
        search, self._asked = self.search, {}
        for generation in generations:
            for replicate, (method, seed) in enumerate(zip(self._methods, self._seeds, strict=True)):
                for index, individual in enumerate(method.send(self._fitness[replicate])):
                    density = individual.genome.density_of_robots
                    n_robots = robots_for(search.config.arena, density, "density_of_robots")
                    for evaluation in range(search.evaluations):
                        place = (generation, index, evaluation)
                        job = Job(search.config, individual.genome, n_robots, run_seed(seed, *place), search.steps)
                        self._asked[(*place, replicate)] = individual, job
        return {key: job for key, (_, job) in self._asked.items()}

    def tell(self, outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
        """Take in the outcomes of these jobs; return their rows."""
        rows = []
        for (key, (individual, job)), outcome in zip(self._asked.items(), outcomes, strict=True):
            parents = dict(zip(("parent", "second_parent"), (*individual.parents, None, None), strict=False))
            rows.append(
                {
                    "replicate": key[3],
                    **dict(zip(("generation", "individual", "evaluation"), key, strict=False)),
                    "origin": individual.origin,
                    **parents,
                    **asdict(job.genome),
                    "n_robots": job.n_robots,
                    "seed": job.seed,
                    **outcome.columns,
                }
            )
        for (replicate, _), mine in by(rows, "replicate", "generation").items():
            runs = by(mine, "individual").values()
            means = [float(np.mean([row["fitness"] for row in own])) for own in runs]
            self._fitness[replicate] = means
            for row in mine:
                row["genome_fitness"] = means[row["individual"]]
        self.rows += rows
        return rows

    def save(self) -> None:
        """Write the table so far."""
        write_table(self.out / TABLE, self.rows, self.settings)

    def end(self) -> Best:
        """Write all files; return the best genome."""
        self.save()
        best = {BEST: best_of(self.rows)}
        if self.search.replicates > 1:
            best |= {f"best-{number}.json": best_of(mine) for number, mine in enumerate(by_replicate(self.rows))}
        for name, own in best.items():
            with atomic_write(self.out / name) as part:
                part.write_text(json.dumps(asdict(own.genome), indent=2) + "\n", encoding="utf-8")
        draw_fitness(self.rows, self.search.config.arena.n_dust, self.out / FIGURE)
        return best[BEST]


def _sets_of_jobs(begun: Sequence[_Running], execution: Execution) -> Iterator[tuple[list[_Running], Sequence[int]]]:
    """Yield which searches advance together, and by which generations."""
    is_large = execution.in_batches and not has_buffers(execution.settings)  # whose time hardly grows with its worlds
    learning = [one for one in begun if one.search.method != "random"]
    for one in begun:
        if one not in learning:
            stride = max(1, AT_ONCE // one.search.n_runs) if is_large else 1
            every = range(one.search.generations)
            yield from (([one], every[first : first + stride]) for first in every[::stride])
    for generation in range(max((one.search.generations for one in learning), default=0)):
        yield [one for one in learning if generation < one.search.generations], [generation]


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
