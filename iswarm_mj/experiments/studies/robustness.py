"""Robustness of the swarm to failed robots: dead ones that stand in the way, and ones that are not there at all."""

from pathlib import Path

import numpy as np

from iswarm_mj.experiments.analysis.findings import NOT_COMPARABLE, PREDICTED, Claim, Finding, Rows, number, span
from iswarm_mj.experiments.analysis.measures import CARRIAGE, COLLISIONS, TIME, finished, select, values
from iswarm_mj.experiments.analysis.plots import Quantity, draw_curves
from iswarm_mj.experiments.analysis.statistics import compare
from iswarm_mj.experiments.runner.experiment import TIME_LIMIT, Entry, Experiment, Plan, run_seed
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.simulation.initial import robots_for

REPEATS = 12
FRACTIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
DEAD, ABSENT = "dead", "absent"

# The paper calls its swarm robust without a run in which robots fail.
ROBUST = Claim(
    "The swarm is robust: it reaches the goal with up to half of its robots dead", "section 5", "robust", NOT_COMPARABLE
)
COST = Claim("Dead robots cost more time than absent ones", "not in the paper", "not studied", PREDICTED)


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
    parts, holds = [], True
    for fraction in fractions:
        runs = select(dead, fraction=fraction)
        middle = number(float(np.median(values(runs, TIME))))
        parts.append(f"{100 * fraction:.0f} %: {finished(runs)} of {len(runs)} runs, median {middle} steps")
        holds &= 2 * finished(runs) >= len(runs)
    goal, limit = dead[0]["goal"], dead[0]["max_steps"]
    rule = f"goal of {goal} balls within {limit} steps; holds if at least half of the runs at each share reach it"
    found = [ROBUST.found("; ".join(parts), rule, holds)]
    most = fractions[-1]
    with_bodies, without = (values(select(rows, kind=kind, fraction=most), TIME) for kind in (DEAD, ABSENT))
    if not len(without):
        return [*found, COST.not_run()]
    result = compare(with_bodies, without)
    ours = f"at {100 * most:.0f} %, difference of the medians {span(result.difference, 'steps')}"
    tested = f"Mann-Whitney U = {number(result.u)}, p = {number(result.p, 2)}, n = {result.n_first} + {result.n_second}"
    return [*found, COST.found(ours, tested, "")]


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
    source="not in the paper",
    entries=entries,
    findings=findings,
    draw=draw,
)
