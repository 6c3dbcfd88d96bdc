"""Robustness of the swarm to failed robots: dead ones that stand in the way, and ones that are not there at all."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from iswarm_mj.experiments.analysis.findings import (
    NOT_COMPARABLE,
    NOT_IN_PAPER,
    PREDICTED,
    Claim,
    Finding,
    Rows,
    number,
    span,
    verdict_of,
)
from iswarm_mj.experiments.analysis.measures import CARRIAGE, COLLISIONS, TIME, finished, select, values
from iswarm_mj.experiments.analysis.plots import Quantity, draw_curves
from iswarm_mj.experiments.analysis.statistics import compare, holm
from iswarm_mj.experiments.analysis.verdicts import all_of, mostly
from iswarm_mj.experiments.runner.experiment import TIME_LIMIT, Entry, Experiment, Plan, run_seed
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.tasks.layout import robots_for

REPEATS = 12
FRACTIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
DEAD, ABSENT = "dead", "absent"

# The paper calls its swarm robust without a run in which robots fail.
ROBUST = Claim(
    "The swarm is robust: it reaches the goal with up to half of its robots dead", "section 5", "robust", NOT_COMPARABLE
)
COST = Claim("Dead robots cost more time than absent ones", NOT_IN_PAPER, "not studied", PREDICTED)


def entries(plan: Plan) -> list[Entry]:
    """Runs with shares of the robots dead, and with the same shares left out."""
    n_robots = robots_for(plan.config.arena, plan.genome.density_of_robots)
    fractions, repeats, steps = ((0.0, 0.3, 0.5), 3, 300) if plan.quick else (FRACTIONS, REPEATS, TIME_LIMIT)
    listed = []
    for kind in (DEAD, ABSENT):
        for fraction in fractions if kind == DEAD else fractions[1:]:
            there = n_robots if kind == DEAD else n_robots - round(fraction * n_robots)
            for repeat in range(repeats):
                seed = run_seed(plan.seed, int(kind == DEAD), round(1000 * fraction), repeat)
                failed = fraction if kind == DEAD else 0.0
                job = Job(plan.config, plan.genome, there, seed, steps, plan.goal, failed)
                listed.append(Entry({"kind": kind, "fraction": fraction, "repeat": repeat}, job))
    return listed


def findings(rows: Rows) -> list[Finding]:
    """How far the swarm gets with dead robots, and whether it is their bodies that cost the time."""
    dead = select(rows, kind=DEAD)
    fractions = sorted({row["fraction"] for row in dead})
    if len(fractions) < 2:
        return [ROBUST.not_run(), COST.not_run()]
    parts, verdicts = [], []
    for fraction in fractions:
        runs = select(dead, fraction=fraction)
        middle = number(float(np.median(values(runs, TIME))))
        parts.append(f"{100 * fraction:.0f} %: {finished(runs)} of {len(runs)} runs, median {middle} steps")
        verdicts.append(mostly(finished(runs), len(runs)))
    rule = (
        f"goal of {dead[0]['goal']} balls within {dead[0]['max_steps']} steps; holds if the exact 95 % interval of the "
        "share of runs that reach it lies above one half at each share of dead robots, does not if one lies below"
    )
    return [ROBUST.found("; ".join(parts), rule, all_of(verdicts)), _cost(rows, fractions[1:])]


def _cost(rows: Rows, fractions: Sequence[float]) -> Finding:
    """The time that dead robots cost beyond that of absent ones, at each share."""
    pairs = {f: [values(select(rows, kind=kind, fraction=f), TIME) for kind in (DEAD, ABSENT)] for f in fractions}
    found = {fraction: compare(*pair) for fraction, pair in pairs.items() if all(map(len, pair))}
    if not found:
        return COST.not_run()
    adjusted = holm([result.p for result in found.values()])
    ours = "; ".join(
        f"{100 * fraction:.0f} %: {span(result.difference, 'steps')}" for fraction, result in found.items()
    )
    raw = ", ".join(
        f"{number(result.p, 2)} ({number(p, 2)})" for result, p in zip(found.values(), adjusted, strict=True)
    )
    first = next(iter(found.values()))
    tested = (
        f"differences of the medians; Mann-Whitney p = {raw}, in brackets adjusted by Holm for {len(found)} shares, "
        f"n = {first.n_first} + {first.n_second} each; holds if all intervals lie above zero, does not if nothing of "
        "one does"
    )
    return COST.found(ours, tested, all_of(verdict_of(result, True) for result in found.values()))


def draw(rows: Rows, out: Path) -> list[Path]:
    """Draw time, collisions and carriage along the share of failed robots."""
    lines = {
        "dead, standing in the way": select(rows, kind=DEAD),
        "absent": [row for row in rows if row["kind"] == ABSENT or row["fraction"] == 0.0],
    }
    failed = Quantity("share of failed robots", lambda row: row["fraction"])
    return [draw_curves(lines, failed, (TIME, COLLISIONS, CARRIAGE), out / "robustness")]


EXPERIMENT = Experiment(
    name="robustness",
    title="0 to 50 % of the robots dead, or left out, 12 runs each, until 66 of 72 balls or 1200 steps",
    source=NOT_IN_PAPER,
    entries=entries,
    findings=findings,
    draw=draw,
)
