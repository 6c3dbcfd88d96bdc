"""The search for fit swarms: its files, and several searches at once."""

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
from iswarm_mj.experiments.analysis.plots_of_searches import draw_fitness
from iswarm_mj.experiments.runner.batches import has_buffers
from iswarm_mj.experiments.runner.journal import Journal
from iswarm_mj.experiments.runner.pool import Execution, progress, run_missing
from iswarm_mj.experiments.runner.search_settings import Search
from iswarm_mj.experiments.runner.search_table import Replicates
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import atomic_write, check_resumable, remove_parts
from iswarm_mj.utils.lock import locked
from iswarm_mj.utils.progress import Progress
from iswarm_mj.utils.tables import write_table

AT_ONCE = 4096
"""Runs of a set of jobs at most, where a search does not learn and several generations can be a batch of planar."""
CHECKPOINT, TABLE, BEST, FIGURE = "checkpoint.sqlite", "evolution.parquet", "best.json", "fitness"


def run_search(search: Search, out: Path, execution: Execution | None = None, resume: bool = False) -> Best:
    """`run_searches` with one search in `out`; return its best genome."""
    return run_searches({out: search}, execution, resume)[0]


def run_searches(
    searches: Mapping[Path, Search],
    execution: Execution | None = None,
    resume: bool = False,
    again: bool = False,
    refused: dict[Path, UserError] | None = None,
) -> list[Best]:
    """Search, write the results into the directories, print a summary of each.

    Files: evolution.parquet, a row per run (see `search_table.rows_of`); best.json, a genome, and with replicates the
    best of each, best-0.json and so on; fitness.png and .svg; checkpoint.sqlite. The table is written after each
    set of jobs, the others at the end. A generation of all searches that learn, with all replicates, is one set of
    jobs, and in batches of planar so are several generations of one that does not. Neither the number of workers nor an
    interruption changes a byte of the files. Where a set of jobs is one batch, a generation that a checkpoint contains
    in part is repeated as a whole; its bytes are then the same on CPUs, and on GPUs if these round reproducibly and the
    searches in the batch are the same.

    Args:
        searches: what to do, by the directories of the results.
        execution: how to run the jobs, by default on all cores; a search must be resumed with its own engine.
        resume: continue the search in a directory, if there is one.
        again: discard the search in a directory.
        refused: takes, by directories, why searches cannot begin, which are then left out; without it, the first
            such error is raised.

    Raises:
        UserError: a directory is not writable or in use, contains a search that is not to be resumed, a different or
            a damaged one; or a file cannot be written later.
        SimulationFault: a run could not go on.
    """
    execution = execution or Execution()
    with ExitStack() as stack:
        begun: list[_Begun] = []
        for out, search in searches.items():
            try:
                begun.append(stack.enter_context(_begun(out, search, execution, resume, again)))
            except UserError as error:
                if refused is None:
                    raise
                refused[out] = error
        _run_generations(begun, execution)
        best = [search.end() for search in begun]
    for search, own in zip(begun, best, strict=True):
        print(summary(search.search, search.replicates.rows, own, search.out))
    return best


class _Begun:
    """A search, its directory, settings and journal, and how far it is."""

    def __init__(self, search: Search, out: Path, settings: dict[str, Any], journal: Journal):
        self.search, self.out, self.settings, self.journal = search, out, settings, journal
        self.replicates = Replicates(search)

    def save(self) -> None:
        """Write the table so far."""
        write_table(self.out / TABLE, self.replicates.rows, self.settings)

    def end(self) -> Best:
        """Write all files; return the best genome."""
        self.save()
        rows = self.replicates.rows
        best = best_of(rows)
        _write_genome(self.out / BEST, best)
        if self.search.replicates > 1:
            for replicate, mine in enumerate(by_replicate(rows)):
                _write_genome(self.out / best_name(replicate), best_of(mine))
        draw_fitness(rows, self.search.config.arena.n_dust, self.out / FIGURE)
        return best


@contextmanager
def _begun(out: Path, search: Search, execution: Execution, resume: bool, again: bool) -> Iterator[_Begun]:
    settings = settings_of(search, execution)
    with locked(out):
        check_resumable(out, "search", CHECKPOINT, (BEST, TABLE), resume, again)
        with Journal(out / CHECKPOINT, settings) as journal:
            remove_parts(out, TABLE, BEST, best_name("*"), f"{FIGURE}.png", f"{FIGURE}.svg")
            if execution.in_batches:  # a generation is run as a whole
                known = Counter(key[0] for key in journal.entries)
                journal.entries = {k: run for k, run in journal.entries.items() if known[k[0]] == search.n_runs}
            yield _Begun(search, out, settings, journal)


def _run_generations(begun: Sequence[_Begun], execution: Execution) -> None:
    """Run all generations; runs in the journals are not repeated."""
    total = sum(each.search.generations * each.search.n_runs for each in begun)
    is_large = execution.in_batches and not has_buffers(execution.settings)  # whose time hardly grows with its worlds
    with progress(total, done=sum(len(each.journal.entries) for each in begun)) as bar:
        for each in begun:
            if not each.replicates.learns:
                stride = max(1, AT_ONCE // each.search.n_runs) if is_large else 1
                last = each.search.generations
                for first in range(0, last, stride):
                    _advance([each], range(first, min(first + stride, last)), execution, bar)
        learning = [each for each in begun if each.replicates.learns]
        for generation in range(max((each.search.generations for each in learning), default=0)):
            going = [each for each in learning if generation < each.search.generations]
            _advance(going, [generation], execution, bar)


def _advance(going: Sequence[_Begun], generations: Sequence[int], execution: Execution, bar: Progress) -> None:
    """Run the next generations of some searches as one set of jobs."""
    known = [len(each.journal.entries) for each in going]
    wanted = [(each.replicates.ask(generations), each.journal) for each in going]
    outcomes = run_missing(wanted, execution, bar)
    rows = [row for each, own in zip(going, outcomes, strict=True) for row in each.replicates.tell(own)]
    bar.say(f"generation {generations[-1] + 1}, best {max(row['fitness'] for row in rows):z.0f}")
    for each, n_known in zip(going, known, strict=True):
        if len(each.journal.entries) > n_known:
            each.save()


def settings_of(search: Search, execution: Execution) -> dict[str, Any]:
    """Settings that determine the outcome, as files contain them."""
    return {**asdict(search), **execution.identity}


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
