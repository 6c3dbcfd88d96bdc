"""An experiment: labelled runs, and the findings, figures and tables that follow from them.

Finished runs are kept and not repeated.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple, TypedDict

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.paper.analysis.findings import Finding, findings_on
from iswarm_mj.paper.analysis.measures import Measure
from iswarm_mj.paper.analysis.swarm_statements import STATEMENTS
from iswarm_mj.search.journal import RUNS, Key, hashed, journal
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
"""Name of the file of findings."""
GOAL_SHARE = 66 / 72
"""Share of the balls whose delivery ends a run of the paper's experiments (section 4.6.1)."""
TIME_LIMIT = 1200
"""Maximum number of control steps (section 4.6.1)."""


@dataclass(frozen=True)
class Plan:
    """Settings of an experiment."""

    config: SwarmConfig = field(default_factory=SwarmConfig)
    """Configuration of the swarm."""
    genome: Genome = field(default_factory=Genome)
    """Genome of the swarm; the paper uses type 1, the fittest."""
    seed: Seed = 0
    """Seed from which those of all runs follow."""
    quick: bool = False
    """A version of about a minute, with fewer and shorter runs."""

    def __post_init__(self):
        validate(self)

    @property
    def goal(self) -> int:
        """Number of delivered balls at which a run ends; the paper's 66 of 72."""
        return round(GOAL_SHARE * self.config.arena.n_dust)


class Overrides(TypedDict, total=False):
    """Differences of the runs of a setting from the plan and from the experiment."""

    config: SwarmConfig
    """Configuration, instead of the plan's."""
    genome: Genome
    """Genome, instead of the plan's."""
    n_robots: int
    """Number of robots, instead of that which follows from the genome's density."""
    goal: int | None
    """Number of delivered balls at which a run ends, instead of the plan's; None for all."""
    failed_fraction: float
    """Fraction of the robots that are dead from the start, instead of none."""
    limit: int
    """Maximum number of control steps, instead of the experiment's; not in the quick version."""
    repeats: int
    """Number of runs, instead of the experiment's; not in the quick version."""


class Setting(NamedTuple):
    """A setting of an experiment, which is run several times."""

    labels: Mapping[str, Any]
    """Labels of its runs, columns of the table."""
    seed_path: tuple[int, ...]
    """Numbers from which, with the plan's seed, the seeds of its runs follow."""
    overrides: Overrides
    """Differences from the plan and from the experiment."""


class Entry(NamedTuple):
    """A run, and the labels by which the experiment compares it with others."""

    labels: Mapping[str, Any]
    """Labels of the run, columns of the table."""
    job: Job
    """The run."""


@dataclass(frozen=True)
class Experiment:
    """An experiment: its runs, findings, figures and tables.

    Twelve runs of each setting are as many as the paper's of Fig. 15, and twice those of Fig. 17,
    whose intervals leave open which density is best.
    """

    name: str
    """Name on the command line."""
    source: str
    """Figure of the paper, or that it is not in the paper."""
    title: str
    """What it does, in one line."""
    settings: Callable[[Plan], Iterator[Setting]]
    """Yields its settings."""
    figure: Callable[[Rows, Path], None]
    """Draws figures as PNG and SVG files with this path, without suffix."""
    columns: tuple[str, ...] = ()
    """Columns that tell its groups apart in tables of medians."""
    measures: tuple[Measure, ...] = ()
    """Measures whose medians these tables have."""
    observe: Callable[[Plan, Path, list[dict[str, Any]]], None] | None = None
    """Writes further files into its directory; may add columns to the rows."""
    judge: Callable[[Rows], list[Finding]] | None = None
    """Returns the findings on the rows of its table; by default the statements on it do."""
    repeats: int = 12
    """Runs of each setting."""
    quick_repeats: int = 3
    """Runs of each setting in the quick version."""
    limit: int = TIME_LIMIT
    """Maximum number of control steps."""
    quick_limit: int = 300
    """Maximum number of control steps in the quick version."""

    def entries(self, plan: Plan) -> list[Entry]:
        """Return its runs; what a setting does not override follows from the plan."""
        entries = []
        for setting in self.settings(plan):
            for repeat in range(self._repeats_of(setting, plan)):
                labels = {**setting.labels, "repeat": repeat}
                entries.append(Entry(labels, self._job_of(setting, plan, repeat)))
        return entries

    def _repeats_of(self, setting: Setting, plan: Plan) -> int:
        """Return the number of runs of a setting."""
        if plan.quick:
            return self.quick_repeats
        return setting.overrides.get("repeats", self.repeats)

    def _job_of(self, setting: Setting, plan: Plan, repeat: int) -> Job:
        """Return one of the runs of a setting."""
        overrides = setting.overrides
        genome = overrides.get("genome", plan.genome)
        n_robots = robots_for(plan.config.arena, genome.density_of_robots)
        limit = self.quick_limit if plan.quick else overrides.get("limit", self.limit)
        return Job(
            config=overrides.get("config", plan.config),
            genome=genome,
            n_robots=overrides.get("n_robots", n_robots),
            seed=run_seed(plan.seed, *setting.seed_path, repeat),
            steps=limit,
            stop_at=overrides.get("goal", plan.goal),
            failed_fraction=overrides.get("failed_fraction", 0.0),
        )

    def findings(self, rows: Rows) -> list[Finding]:
        """Return the findings on the rows of its table; without rows, that it was not run."""
        if self.judge is not None:
            return self.judge(rows)
        return findings_on(STATEMENTS, self.name, rows)

    @property
    def table(self) -> str:
        """Name of the file of its table."""
        return f"{self.name.replace('-', '_')}.parquet"

    def draw(self, rows: Rows, out: Path) -> None:
        """Draw its figures into a directory."""
        self.figure(rows, (out / self.table).with_suffix(""))


Values = Mapping[str, Any]
"""Values of settings by names such as optics.mode."""


def varied(config: SwarmConfig, values: Values) -> SwarmConfig:
    """Return a configuration with these values.

    Those of one part are changed at once, since they may depend on each other.
    """
    parts = {}
    for part, names in groupby(sorted(values), key=lambda name: name.partition(".")[0]):
        part_values = {name.partition(".")[2]: values[name] for name in names}
        parts[part] = replace(getattr(config, part), **part_values)
    return replace(config, **parts)


def run_experiment(
    experiment: Experiment,
    plan: Plan,
    out: Path,
    execution: Execution | None = None,
    *,
    again: bool = False,
) -> list[Finding]:
    """Run an experiment, write its results, print the findings.

    Its files are the table, a row per run (parquet and CSV); findings.csv; figures; and runs.sqlite
    with the finished runs. A run that is in it is not repeated, whichever experiment of the same
    version of the package asks for it.

    Args:
        experiment: the experiment.
        plan: its settings.
        out: directory of the results.
        execution: how to run the jobs, by default on all cores.
        again: discard the finished runs in `out`.
    """
    execution = execution or Execution()
    entries = experiment.entries(plan)
    keys = [_key_of(entry.job, execution) for entry in entries]
    jobs = {key: entry.job for key, entry in zip(keys, entries, strict=True)}

    with journal(out / RUNS, {"kind": "runs of experiments"}, again) as finished:
        n_finished = len(jobs.keys() & finished.entries.keys())
        with progress(len(jobs), experiment.name, n_finished) as bar:
            outcomes = dict(zip(jobs, run_missing(jobs, finished, execution, bar), strict=True))

        rows = [row_of(entry, outcomes[key]) for key, entry in zip(keys, entries, strict=True)]
        if experiment.observe is not None:
            experiment.observe(plan, out, rows)

        # Findings of an earlier table must not stand beside a new one.
        remove(out / FINDINGS)
        settings = settings_of(experiment, plan, execution)
        write_table(out / experiment.table, rows, settings, csv=True)
        findings = experiment.findings(rows)
        write_csv(out / FINDINGS, [finding._asdict() for finding in findings])
        experiment.draw(rows, out)
        print(summary(findings, len(rows), out))
    return findings


def _key_of(job: Job, execution: Execution) -> Key:
    """Return the key of a run in the journal."""
    return hashed(json.dumps([execution.identity, asdict(job)], sort_keys=True))


def settings_of(experiment: Experiment, plan: Plan, execution: Execution) -> dict[str, Any]:
    """Return the settings that determine the outcome, as tables contain them."""
    return {"experiment": experiment.name, **asdict(plan), **execution.identity}


def row_of(entry: Entry, outcome: Outcome) -> dict[str, Any]:
    """Return a row of the table: labels, what was run, measures."""
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
    """Return a readable summary of the findings."""
    lines = [f"{n_runs} runs"]
    for finding in findings:
        lines += [
            "",
            f"{finding.claim}: {finding.verdict or '-'}",
            f"    {finding.ours}",
            f"    {finding.statistics}",
        ]
    lines += ["", f"results in {out}"]
    return "\n".join(lines)
