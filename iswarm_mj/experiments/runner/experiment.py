"""An experiment: runs with labels, and what is made of them. Finished runs are kept and not done again."""

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.config import SwarmConfig
from iswarm_mj.experiments.analysis.findings import Finding, Rows
from iswarm_mj.experiments.runner.checkpoint import Journal, Key
from iswarm_mj.experiments.runner.jobs import Job, Outcome
from iswarm_mj.experiments.runner.pool import check_engine, each, identity, progress
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.files import make_output_directory, remove
from iswarm_mj.utils.serialization import to_dict
from iswarm_mj.utils.tables import write_table

RUNS, FINDINGS = "runs.jsonl", "findings.parquet"
GOAL_SHARE = 66 / 72
"""A run of the paper's experiments ends when this share of the balls is delivered (section 4.6.1)."""
TIME_LIMIT = 1200
"""Control steps at most (section 4.6.1)."""


@dataclass(frozen=True)
class Plan:
    """What an experiment is given."""

    config: SwarmConfig = field(default_factory=SwarmConfig)
    genome: Genome = field(default_factory=Genome)
    """The swarm in question; the paper takes type 1, the fittest."""
    seed: int = 0
    quick: bool = False
    """A version of about a minute, with fewer and shorter runs."""

    @property
    def goal(self) -> int:
        """Balls after which a run ends; the paper's 66 of 72."""
        return round(GOAL_SHARE * self.config.arena.n_dust)


class Entry(NamedTuple):
    """A run with its labels: what is compared in the experiment."""

    labels: Mapping[str, Any]
    job: Job


@dataclass(frozen=True)
class Experiment:
    """An experiment by its name."""

    name: str
    title: str
    """One line on what it does."""
    source: str
    """Figure of the paper, or that it is not in the paper."""
    entries: Callable[[Plan], list[Entry]]
    findings: Callable[[Rows], list[Finding]]
    """From the rows of its table; of no rows, that it was not run."""
    draw: Callable[[Rows, Path], list[Path]]
    """Draw figures of the rows into a directory; paths of the PNG files, an SVG file lies beside each."""
    extra: Callable[[Plan, Path, list[dict[str, Any]]], None] | None = None
    """What else it makes in its directory; it may add columns to the rows."""

    @property
    def table(self) -> str:
        """Name of its table."""
        return f"{self.name.replace('-', '_')}.parquet"


def run_seed(seed: int, *place: int) -> int:
    """Seed of one run of an experiment, within 0 to 2^32 - 2; other places give independent ones."""
    state = np.random.SeedSequence(seed, spawn_key=place).generate_state(1, np.uint64)
    return int(state[0] % (2**32 - 1))


def run_experiment(
    experiment: Experiment, plan: Plan, out: Path, workers: int = 0, engine: str = "mujoco",
    backend: str = "processes", again: bool = False,
) -> list[Finding]:  # fmt: skip
    """Run an experiment, write its results into `out`, print what was found.

    Files: the table, a row a run (parquet and CSV), findings.parquet and .csv, figures, runs.jsonl with the finished
    runs. Runs that are in it are not done again, whatever experiment of the same package's version asks for them.

    Args:
        experiment: which one.
        plan: its settings.
        out: directory of the results.
        workers: see `pool.each`.
        engine: see `pool.each`.
        backend: see `pool.each`.
        again: forget the runs that were kept.

    Raises:
        UserError: `out` cannot be written to, or its runs are of another version.
        SimulationFault: a run could not go on.
    """
    check_engine(engine, backend)
    make_output_directory(out)
    if again:
        remove(out / RUNS)
    entries = experiment.entries(plan)
    jobs = [entry.job for entry in entries]
    outcomes = _outcomes(experiment.name, jobs, out, workers, engine, backend)
    rows = [row_of(*pair) for pair in zip(entries, outcomes, strict=True)]
    settings = {"experiment": experiment.name, "engine": engine, **to_dict(plan), **identity(engine)}
    if experiment.extra is not None:
        experiment.extra(plan, out, rows)
    write_table(out / experiment.table, rows, settings, csv=True)
    findings = experiment.findings(rows)
    if findings:
        write_table(out / FINDINGS, [finding._asdict() for finding in findings], settings, csv=True)
    experiment.draw(rows, out)
    print(summary(findings, len(rows), out))
    return findings


def row_of(entry: Entry, outcome: Outcome) -> dict[str, Any]:
    """Row of the table: labels, what was run, measures."""
    job = entry.job
    return {
        **entry.labels, "seed": job.seed, "n_robots": job.n_robots, "failed_fraction": job.failed_fraction,
        "max_steps": job.steps, "goal": job.stop_at or job.config.arena.n_dust, **outcome._asdict(),
        "collisions_per_robot": outcome.collisions / job.n_robots,
    }  # fmt: skip


def summary(findings: Sequence[Finding], n_runs: int, out: Path) -> str:
    """Readable summary of what was found."""
    lines = [f"{n_runs} runs"]
    for finding in findings:
        lines += ["", f"{finding.claim}: {finding.verdict or '-'}", f"    {finding.ours}", f"    {finding.statistics}"]
    return "\n".join([*lines, "", f"results in {out}"])


def _outcomes(name: str, jobs: Sequence[Job], out: Path, workers: int, engine: str, backend: str) -> list[Outcome]:
    """Outcomes of the jobs: those of the journal, and the others from the pool into the journal."""
    run_by = " ".join(identity(engine).values()) or engine
    keys = [_key(job, run_by) for job in jobs]
    with Journal(out / RUNS, {"kind": "runs of experiments"}) as journal:
        missing = [number for number, key in enumerate(keys) if key not in journal.entries]
        todo = [jobs[number] for number in missing]
        with (
            progress(len(jobs), name, len(jobs) - len(todo)) as bar,
            closing(each(todo, workers, engine, backend)) as finished,
        ):
            for index, outcome in finished:
                journal.add(keys[missing[index]], outcome)
                bar.update()
        return [Outcome(*journal.entries[key]) for key in keys]


def _key(job: Job, run_by: str) -> Key:
    """Name of a run by all that decides its outcome: the job, the engine and, where there are several, its kind."""
    text = json.dumps([run_by, to_dict(job)], sort_keys=True).encode()
    return (int(hashlib.sha256(text).hexdigest()[:13], 16),)
