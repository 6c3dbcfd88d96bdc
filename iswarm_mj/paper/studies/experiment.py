"""An experiment: labelled runs, and what follows from them. Finished runs are kept and not
repeated."""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.paper.analysis.findings import Finding, findings_on
from iswarm_mj.paper.analysis.measures import Measure
from iswarm_mj.paper.analysis.statements import STATEMENTS
from iswarm_mj.search.journal import RUNS, hashed, journal
from iswarm_mj.search.pool import Execution, Job, Outcome, progress, run_missing
from iswarm_mj.search.rows import Rows
from iswarm_mj.search.seeds import run_seed
from iswarm_mj.search.settings import Seed
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.constraints import validate
from iswarm_mj.utils.files import remove
from iswarm_mj.utils.tables import write_csv, write_table

FINDINGS = "findings.csv"
GOAL_SHARE = 66 / 72
"""A run of the paper's experiments ends when this share of the balls is delivered (section
4.6.1)."""
TIME_LIMIT = 1200
"""Control steps at most (section 4.6.1)."""


@dataclass(frozen=True)
class Plan:
    """Settings of an experiment."""

    config: SwarmConfig = field(default_factory=SwarmConfig)
    genome: Genome = field(default_factory=Genome)
    """Of the swarm; the paper uses type 1, the fittest."""
    seed: Seed = 0
    quick: bool = False
    """A version of about a minute, with fewer and shorter runs."""

    def __post_init__(self):
        validate(self)

    @property
    def goal(self) -> int:
        """Number of delivered balls at which a run ends; the paper's 66 of 72."""
        return round(GOAL_SHARE * self.config.arena.n_dust)


class Entry(NamedTuple):
    """A run, and the labels by which the experiment compares it with others."""

    labels: Mapping[str, Any]
    job: Job


Setting = tuple[Mapping[str, Any], tuple[int, ...], Mapping[str, Any]]
"""Labels, place of the seeds, and what differs from the plan or the experiment in these runs."""


@dataclass(frozen=True)
class Experiment:
    """An experiment: its runs, findings, figures and tables.

    Twelve runs of each setting are as many as the paper's of Fig. 15, and twice those of Fig. 17,
    whose intervals leave open which density is best.
    """

    name: str
    source: str
    """Figure of the paper, or that it is not in the paper."""
    title: str
    """What it does, in one line."""
    settings: Callable[[Plan], Iterator[Setting]]
    figure: Callable[[Rows, Path], None]
    """Draws figures as PNG and SVG files with this path, without suffix."""
    columns: tuple[str, ...] = ()
    """That tell its groups apart in tables of medians."""
    measures: tuple[Measure, ...] = ()
    """Whose medians these tables have."""
    extra: Callable[[Plan, Path, list[dict[str, Any]]], None] | None = None
    """Writes further files into its directory; may add columns to the rows."""
    judge: Callable[[Rows], list[Finding]] | None = None
    """Computes the findings from the rows of its table, by default by the statements on it."""
    repeats: int = 12
    """Runs of each setting."""
    few: int = 3
    """Runs of each setting in the quick version, of at most `steps` instead of `limit` control
    steps."""
    steps: int = 300
    limit: int = TIME_LIMIT

    def entries(self, plan: Plan) -> list[Entry]:
        """Return its runs; arguments of `Job` follow from the plan unless a setting says
        otherwise."""
        listed = []
        for labels, place, own in self.settings(plan):
            config, genome = own.get("config", plan.config), own.get("genome", plan.genome)
            density = own.get("density", genome.density_of_robots)
            n_robots = own.get("n_robots", robots_for(plan.config.arena, density))
            goal, failed = own.get("goal", plan.goal), own.get("failed", 0.0)
            steps = self.steps if plan.quick else own.get("limit", self.limit)
            for repeat in range(self.few if plan.quick else own.get("repeats", self.repeats)):
                job = Job(
                    config,
                    genome,
                    n_robots,
                    run_seed(plan.seed, *place, repeat),
                    steps,
                    goal,
                    failed,
                )
                listed.append(Entry({**labels, "repeat": repeat}, job))
        return listed

    def findings(self, rows: Rows) -> list[Finding]:
        """Findings from the rows of its table; without rows, they say that it was not run."""
        return self.judge(rows) if self.judge else findings_on(STATEMENTS, self.name, rows)

    @property
    def table(self) -> str:
        """Name of its table."""
        return f"{self.name.replace('-', '_')}.parquet"

    def draw(self, rows: Rows, out: Path) -> None:
        """Draw its figures into a directory."""
        self.figure(rows, (out / self.table).with_suffix(""))


Values = Mapping[str, Any]
"""Settings by names such as optics.mode."""


def varied(config: SwarmConfig, values: Values) -> SwarmConfig:
    """Configuration with these values; those of one part are changed at once, since they may depend
    on each other."""
    parts = {}
    for part, names in groupby(sorted(values), key=lambda name: name.partition(".")[0]):
        parts[part] = replace(
            getattr(config, part), **{name.partition(".")[2]: values[name] for name in names}
        )
    return replace(config, **parts)


def run_experiment(
    experiment: Experiment,
    plan: Plan,
    out: Path,
    execution: Execution | None = None,
    again: bool = False,
) -> list[Finding]:
    """Run an experiment, write its results into `out`, print the findings.

    Files: the table, a row per run (parquet and CSV); findings.csv; figures; runs.sqlite with the
        finished
    runs. A run that is in it is not repeated, whichever experiment of the same version of the
    package asks for it.

    Args:
        experiment: which one.
        plan: its settings.
        out: directory of the results.
        execution: how to run the jobs, by default on all cores.
        again: discard the finished runs in `out`.
    """
    execution = execution or Execution()
    entries = experiment.entries(plan)
    keys = [
        hashed(json.dumps([execution.identity, asdict(e.job)], sort_keys=True)) for e in entries
    ]
    jobs = dict(zip(keys, (entry.job for entry in entries), strict=True))
    with journal(out / RUNS, {"kind": "runs of experiments"}, again) as finished:
        with progress(
            len(jobs), experiment.name, len(jobs.keys() & finished.entries.keys())
        ) as bar:
            outcomes = dict(zip(jobs, run_missing(jobs, finished, execution, bar), strict=True))
        rows = [row_of(entry, outcomes[key]) for key, entry in zip(keys, entries, strict=True)]
        if experiment.extra is not None:
            experiment.extra(plan, out, rows)
        remove(out / FINDINGS)  # of an earlier table
        write_table(
            out / experiment.table, rows, settings_of(experiment, plan, execution), csv=True
        )
        findings = experiment.findings(rows)
        write_csv(out / FINDINGS, [finding._asdict() for finding in findings])
        experiment.draw(rows, out)
        print(summary(findings, len(rows), out))
    return findings


def settings_of(experiment: Experiment, plan: Plan, execution: Execution) -> dict[str, Any]:
    """Settings that determine the outcome, as tables contain them."""
    return {"experiment": experiment.name, **asdict(plan), **execution.identity}


def row_of(entry: Entry, outcome: Outcome) -> dict[str, Any]:
    """Row of the table: labels, what was run, measures."""
    job = entry.job
    return {
        **entry.labels,
        "seed": job.seed,
        "n_robots": job.n_robots,
        "failed_fraction": job.failed_fraction,
        "max_steps": job.steps,
        "goal": job.stop_at or job.config.arena.n_dust,
        **outcome,
        "collisions_per_robot": outcome["collisions"] / job.n_robots,
    }


def summary(findings: Sequence[Finding], n_runs: int, out: Path) -> str:
    """Readable summary of the findings."""
    lines = [f"{n_runs} runs"]
    for finding in findings:
        lines += [
            "",
            f"{finding.claim}: {finding.verdict or '-'}",
            f"    {finding.ours}",
            f"    {finding.statistics}",
        ]
    return "\n".join([*lines, "", f"results in {out}"])
