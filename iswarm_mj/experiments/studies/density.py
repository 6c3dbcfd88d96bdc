"""The optimal density of the swarm (Fig. 17)."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float

from iswarm_mj.experiments.analysis.findings import (
    FAILS,
    HOLDS,
    PREDICTED,
    UNDECIDED,
    Claim,
    Finding,
    Rows,
    number,
    span,
)
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
from iswarm_mj.experiments.analysis.paper import BEST, CLEAN, SPARSEST
from iswarm_mj.experiments.analysis.plots import Quantity, draw_bars
from iswarm_mj.experiments.analysis.statistics import RESAMPLES, difference, lowest
from iswarm_mj.experiments.analysis.verdicts import all_of, enough, mostly, within
from iswarm_mj.experiments.runner.experiment import TIME_LIMIT, Entry, Experiment, Plan, run_seed
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.arrays import Array

REPEATS = 12
"""Runs of each density; twice the paper's (Fig. 17), of which the intervals leave open which density is best."""
DENSITIES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4)
"""Robots per cell; the paper gives the ends."""
SURE = 0.95
"""Share of the bootstrap resamples, of which one less this is as sure of the opposite."""

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
SLOWER = Claim(
    "Swarms of density above 0.2 finish later than those of 0.1 to 0.15",
    "section 4.6.2, Fig. 17(a)",
    "shortest from 0.1 to 0.15",
    PREDICTED,
)
DENSE = Claim(
    "Swarms of density above 0.2 do not clean the whole arena",
    "by implication of section 4.6.2, Fig. 17(b)",
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
        _slower(rows),
        _cleaned(rows, CLEANS, _is_clean, True),
        _cleaned(rows, SPARSE, lambda density: density == SPARSEST, False),
        _cleaned(rows, DENSE, lambda density: density > CLEAN[1], False),
    ]


def draw(rows: Rows, out: Path) -> list[Path]:
    """Draw Fig. 17."""
    labels = {density: f"{density:g}" for density in sorted({row["density"] for row in rows})}
    density = Quantity("density of robots", lambda row: row["density"])
    return [draw_bars(rows, density, labels, out / "density")]


def _is_best(density: float) -> bool:
    return BEST[0] <= density <= BEST[1]


def _is_clean(density: float) -> bool:
    return CLEAN[0] <= density <= CLEAN[1]


def _samples(rows: Rows, measure: Measure) -> dict[float, Float[Array, "R"]]:
    """Values of a measure by density, of the densities that have any."""
    found = {
        density: values(select(rows, density=density), measure) for density in sorted({r["density"] for r in rows})
    }
    return {density: sample for density, sample in found.items() if len(sample)}


def _lowest(rows: Rows, measure: Measure, claim: Claim) -> Finding:
    """Whether the density with the lowest median lies where the paper says, by bootstrap over the runs of all."""
    samples = _samples(rows, measure)
    if len({_is_best(density) for density in samples}) < 2:
        return claim.not_run()
    shares = dict(zip(samples, lowest(list(samples.values())), strict=True))
    inside = sum(share for density, share in shares.items() if _is_best(density))
    medians = {density: float(np.median(sample)) for density, sample in samples.items()}
    ours = f"lowest median at {min(medians, key=medians.__getitem__):g}; " + ", ".join(
        f"{density:g}: {number(median)}" for density, median in medians.items()
    )
    named = ", ".join(f"{density:g} in {100 * share:.0f} %" for density, share in shares.items() if share >= 0.005)
    tested = (
        f"n = {', '.join(str(len(s)) for s in samples.values())}; the lowest median is at {named} of {RESAMPLES} "
        f"bootstrap resamples of the runs; holds if it lies inside in {100 * SURE:.0f} %, does not if in "
        f"{100 * (1 - SURE):.0f} % at most"
    )
    verdict = HOLDS if inside >= SURE else FAILS if inside <= 1 - SURE else UNDECIDED
    return claim.found(f"{ours} {measure.unit}", tested, enough(verdict, *map(len, samples.values())))


def _slower(rows: Rows) -> Finding:
    """Whether each density above 0.2 takes longer than those that the paper found best, taken together."""
    samples = _samples(rows, TIME)
    best = [value for density, sample in samples.items() if _is_best(density) for value in sample]
    dense = {density: sample for density, sample in samples.items() if density > CLEAN[1]}
    if not best or not dense:
        return SLOWER.not_run()
    apart = {density: difference(sample, best) for density, sample in dense.items()}
    ours = "; ".join(f"{density:g}: later by {span(found, 'steps')}" for density, found in apart.items())
    tested = (
        f"differences of the medians from the {len(best)} runs of 0.1 to 0.15, n = {len(next(iter(dense.values())))} "
        f"each, late runs counted as {rows[0]['max_steps']} steps; holds if all intervals lie above zero, does not if "
        "one lies below"
    )
    verdicts = [enough(within(found, low=0.0), len(dense[density]), len(best)) for density, found in apart.items()]
    return SLOWER.found(ours, tested, all_of(verdicts))


def _cleaned(rows: Rows, claim: Claim, belongs: Callable[[float], bool], cleans: bool) -> Finding:
    """Whether more than half of the swarms of each of these densities reach the goal, or do not."""
    densities = sorted({row["density"] for row in rows if belongs(row["density"])})
    if not densities:
        return claim.not_run()
    ours, verdicts = [], []
    for density in densities:
        runs = select(rows, density=density)
        ours.append(f"{density:g}: {finished(runs)} of {len(runs)} runs, {quartiles(values(runs, DUST), 'balls')}")
        verdicts.append(mostly(finished(runs), len(runs), cleans))
    side, other = ("above", "below") if cleans else ("below", "above")
    tested = (
        f"runs that delivered {rows[0]['goal']} balls in {rows[0]['max_steps']} steps, and the median of what all did; "
        f"holds if the exact 95 % interval of each density's share of such runs lies {side} one half, does not if one "
        f"lies {other}"
    )
    return claim.found("; ".join(ours), tested, all_of(verdicts))


EXPERIMENT = Experiment(
    name="density",
    title="densities from 0.05 to 0.4, 12 runs each, until 66 of 72 balls or 1200 steps",
    source="Fig. 17",
    entries=entries,
    findings=findings,
    draw=draw,
)
