"""The optimal density of the swarm (Fig. 17)."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from iswarm_mj.experiments.analysis.findings import PREDICTED, Claim, Finding, Rows, number
from iswarm_mj.experiments.analysis.measures import (
    CARRIAGE,
    COLLISIONS,
    DUST,
    TIME,
    Measure,
    finished,
    quartiles,
    select,
    values,
)
from iswarm_mj.experiments.analysis.plots import Quantity, draw_bars
from iswarm_mj.experiments.analysis.statistics import compare
from iswarm_mj.experiments.runner.experiment import TIME_LIMIT, Entry, Experiment, Plan, run_seed
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.simulation.initial import robots_for

REPEATS = 6
"""Runs of each density (Fig. 17)."""
DENSITIES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4)
"""Robots per cell; the paper gives the ends."""
BEST = (0.1, 0.15)
"""Between these densities the paper found the best swarms."""
CLEAN = (0.1, 0.2)
"""Between these densities they cleaned the arena."""

LOWEST = {
    TIME: Claim(
        "Swarms of density 0.1 to 0.15 finish in the shortest time",
        "section 4.6.2, Fig. 17(a)",
        "0.1 to 0.15",
        PREDICTED,
    ),
    COLLISIONS: Claim(
        "Swarms of density 0.1 to 0.15 have the fewest collisions per robot",
        "section 4.6.2, Fig. 17(c)",
        "0.1 to 0.15",
        PREDICTED,
    ),
    CARRIAGE: Claim(
        "Swarms of density 0.1 to 0.15 have the shortest mean carriage",
        "section 4.6.2, Fig. 17(d)",
        "0.1 to 0.15",
        PREDICTED,
    ),
}
CLEANS = Claim(
    "Swarms of density 0.1 to 0.2 clean the whole arena", "section 4.6.2, Fig. 17(b)", "0.1 to 0.2", PREDICTED
)
SPARSE = Claim(
    "Swarms of density 0.05 do not clean the whole arena",
    "section 4.6.2, Fig. 17(b)",
    "0.05 is outside of 0.1 to 0.2",
    PREDICTED,
)
DENSE = Claim(
    "Swarms of density above 0.2 do not clean the whole arena",
    "section 4.6.2, Fig. 17(b)",
    "0.25 to 0.4 are outside of 0.1 to 0.2",
    PREDICTED,
)


def entries(plan: Plan) -> list[Entry]:
    """Runs of all densities."""
    densities, repeats, steps = ((0.05, 0.1, 0.2, 0.4), 2, 300) if plan.quick else (DENSITIES, REPEATS, TIME_LIMIT)
    listed = []
    for density in densities:
        n_robots = robots_for(plan.config.arena, density)
        for repeat in range(repeats):
            seed = run_seed(plan.seed, round(1000 * density), repeat)
            job = Job(plan.config, plan.genome, n_robots, seed, steps, plan.goal)
            listed.append(Entry({"density": density, "repeat": repeat}, job))
    return listed


def findings(rows: Rows) -> list[Finding]:
    """The statements of section 4.6.2."""
    return [
        *(_lowest(rows, measure, claim) for measure, claim in LOWEST.items()),
        _cleaned(rows, CLEANS, lambda density: CLEAN[0] <= density <= CLEAN[1], True),
        _cleaned(rows, SPARSE, lambda density: density == 0.05, False),
        _cleaned(rows, DENSE, lambda density: density > CLEAN[1], False),
    ]


def draw(rows: Rows, out: Path) -> list[Path]:
    """Draw Fig. 17."""
    labels = {density: f"{density:g}" for density in sorted({row["density"] for row in rows})}
    density = Quantity("density of robots", lambda row: row["density"])
    return [draw_bars(rows, density, labels, out / "density")]


def _lowest(rows: Rows, measure: Measure, claim: Claim) -> Finding:
    """Whether the density with the lowest median lies where the paper says; a test against the best outside."""
    samples = {density: values(select(rows, density=density), measure) for density in {r["density"] for r in rows}}
    samples = {density: samples[density] for density in sorted(samples) if len(samples[density])}
    inside = [density for density in samples if BEST[0] <= density <= BEST[1]]
    outside = [density for density in samples if density not in inside]
    if not inside or not outside:
        return claim.not_run()
    here, there = (min(group, key=lambda d: np.median(samples[d])) for group in (inside, outside))
    comparison = compare(samples[here], samples[there])
    best = here if np.median(samples[here]) <= np.median(samples[there]) else there
    ours = f"lowest median at {best:g}; " + ", ".join(
        f"{density:g}: {number(float(np.median(sample)))}" for density, sample in samples.items()
    )
    tested = (
        f"medians, n = {', '.join(str(len(s)) for s in samples.values())}; best inside ({here:g}) against best outside "
        f"({there:g}): Mann-Whitney U = {number(comparison.u)}, p = {number(comparison.p, 2)}; "
        "holds if the lowest median lies inside"
    )
    return claim.found(f"{ours} {measure.unit}", tested, best == here)


def _cleaned(rows: Rows, claim: Claim, belongs: Callable[[float], bool], cleans: bool) -> Finding:
    """Whether the swarms of these densities reach the goal, or do not, by their median run."""
    densities = sorted({row["density"] for row in rows if belongs(row["density"])})
    if not densities:
        return claim.not_run()
    ours, holds = [], True
    for density in densities:
        runs = select(rows, density=density)
        ours.append(f"{density:g}: {finished(runs)} of {len(runs)} runs, {quartiles(values(runs, DUST), 'balls')}")
        holds &= (np.median(values(runs, DUST)) >= runs[0]["goal"]) == cleans
    rule = "reaches the goal" if cleans else "does not reach the goal"
    goal, limit = rows[0]["goal"], rows[0]["max_steps"]
    tested = (
        f"runs that delivered {goal} balls in {limit} steps, and their median; holds if each density's median {rule}"
    )
    return claim.found("; ".join(ours), tested, holds)


EXPERIMENT = Experiment(
    name="density",
    title="densities from 0.05 to 0.4, 6 runs each, until 66 of 72 balls or 1200 steps",
    source="Fig. 17",
    entries=entries,
    findings=findings,
    draw=draw,
)
