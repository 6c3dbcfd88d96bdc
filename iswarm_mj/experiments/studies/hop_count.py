"""The importance of hop counts (Fig. 15): the same swarm with and without them."""

from dataclasses import replace
from pathlib import Path

from iswarm_mj.experiments.analysis.findings import PREDICTED, Claim, Finding, Rows, in_words, rule_of, verdict_of
from iswarm_mj.experiments.analysis.measures import (
    CARRIAGE,
    COLLISIONS,
    DUST,
    TIME,
    finished,
    quartiles,
    select,
    values,
)
from iswarm_mj.experiments.analysis.plots import Quantity, draw_bars
from iswarm_mj.experiments.analysis.statistics import compare
from iswarm_mj.experiments.runner.experiment import TIME_LIMIT, Entry, Experiment, Plan, run_seed
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.tasks.layout import robots_for

REPEATS = 12
"""Runs of each setting (Fig. 15)."""

CLAIMS = {
    TIME: Claim("With hop counts the goal is achieved more quickly", "Fig. 15(a)", "much more quickly", PREDICTED),
    DUST: Claim("With hop counts more dust is removed", "Fig. 15(b)", "more", PREDICTED),
    COLLISIONS: Claim("With hop counts fewer collisions happen", "Fig. 15(c)", "fewer", PREDICTED),
    CARRIAGE: Claim("With hop counts dust is carried on a shorter way", "Fig. 15(d)", "shorter", PREDICTED),
}


def entries(plan: Plan) -> list[Entry]:
    """Runs with and without hop counts."""
    n_robots = robots_for(plan.config.arena, plan.genome.density_of_robots)
    repeats, steps = (3, 300) if plan.quick else (REPEATS, TIME_LIMIT)
    listed = []
    for use_hop_count in (True, False):
        genome = replace(plan.genome, use_hop_count=use_hop_count)
        for repeat in range(repeats):
            seed = run_seed(plan.seed, int(use_hop_count), repeat)
            job = Job(plan.config, genome, n_robots, seed, steps, plan.goal)
            listed.append(Entry({"use_hop_count": use_hop_count, "repeat": repeat}, job))
    return listed


def findings(rows: Rows) -> list[Finding]:
    """The four statements of Fig. 15, each by a Mann-Whitney test."""
    groups = [select(rows, use_hop_count=flag) for flag in (True, False)]
    found = []
    for measure, claim in CLAIMS.items():
        there, absent = (values(group, measure) for group in groups)
        if not len(there) or not len(absent):
            found.append(claim.not_run())
            continue
        ours = f"median {quartiles(there, measure.unit)} with, {quartiles(absent, measure.unit)} without"
        if measure is TIME:
            counts = [f"{finished(group)} of {len(group)}" for group in groups]
            ours += f"; {counts[0]} runs reached {rows[0]['goal']} balls with, {counts[1]} without"
        result = in_words(comparison := compare(there, absent), measure.unit)
        found.append(
            claim.found(
                ours, f"{result}; {rule_of(measure.is_better_larger)}", verdict_of(comparison, measure.is_better_larger)
            )
        )
    return found


def draw(rows: Rows, out: Path) -> list[Path]:
    """Draw Fig. 15."""
    labels = {True: "with", False: "without"}
    hop_counts = Quantity("hop counts", lambda row: row["use_hop_count"])
    return [draw_bars(rows, hop_counts, labels, out / "hop_count")]


EXPERIMENT = Experiment(
    name="hop-count",
    title="with and without hop counts, 12 runs each, until 66 of 72 balls or 1200 steps",
    source="Fig. 15",
    entries=entries,
    findings=findings,
    draw=draw,
)
