"""Whether the cleaning depends on the physics time step: both types at 2 to 100 physics steps a second."""

import time
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.config import DriveConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.experiments.analysis.findings import (
    CONSTRUCTED,
    FAILS,
    FITTED,
    HOLDS,
    NOT_COMPARABLE,
    NOT_IN_PAPER,
    PREDICTED,
    Claim,
    Finding,
    Rows,
    number,
)
from iswarm_mj.experiments.analysis.measures import (
    CARRIAGE,
    COLLISIONS,
    DUST,
    TIME,
    Measure,
    finished,
    select,
    values,
)
from iswarm_mj.experiments.analysis.plots import Quantity, draw_curves
from iswarm_mj.experiments.analysis.statistics import Comparison, Interval, compare, holm, interval, median
from iswarm_mj.experiments.analysis.verdicts import EQUAL, all_of, enough, within
from iswarm_mj.experiments.runner.experiment import TIME_LIMIT, Entry, Experiment, Plan, run_seed
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import RunSettings
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.errors import ConfigError

REPEATS = 24
SUBSTEPS = {2: (1, 1), 5: (2, 3), 10: (4, 6), 20: (8, 12), 50: (20, 30), 100: (40, 60)}
"""Physics steps of the turn and of the walk, by their number in a control step of 1 s; the drive refuses some."""
TYPES = ("type1", "type2")
OBSERVED = 6
"""Runs of each kind whose overlaps and times are observed, with the planar engine at the drive's own time step."""
WARM_UP = 10
"""Control steps that are not timed."""
NEGLIGIBLE = 0.1
"""Overlap that does not matter: a twentieth of a robot [mm]."""

SAME = {
    measure: Claim(f"The {name} does not depend on the physics time step", NOT_IN_PAPER, "not studied", kind)
    for measure, name, kind in (
        (TIME, "time to the goal", PREDICTED),
        (DUST, "number of delivered balls", CONSTRUCTED),  # runs stop at the goal
        (COLLISIONS, "number of collisions", PREDICTED),
        (CARRIAGE, "mean carriage", PREDICTED),
    )
}
REFUSED = Claim("Numbers of physics steps a second that are refused", NOT_IN_PAPER, "not studied", CONSTRUCTED)
# The planar engine's default refinement was set by this.
OVERLAP = Claim("At 100 physics steps a second robots overlap by at most 0.1 mm", NOT_IN_PAPER, "not studied", FITTED)
COST = Claim("Time of a control step in the planar engine", NOT_IN_PAPER, "not studied", NOT_COMPARABLE)


def drive_of(drive: DriveConfig, rate: int) -> DriveConfig:
    """Drive with so many physics steps in a control step.

    Raises:
        ConfigError: the drive refuses them.
    """
    turn_substeps, walk_substeps = SUBSTEPS[rate]
    return replace(drive, turn_substeps=turn_substeps, walk_substeps=walk_substeps)


def refusals(config: SwarmConfig) -> dict[int, str]:
    """What the drive says to the numbers of physics steps that it refuses."""
    said = {}
    for rate in SUBSTEPS:
        try:
            drive_of(config.drive, rate)
        except ConfigError as error:
            said[rate] = str(error)
    return said


def entries(plan: Plan) -> list[Entry]:
    """Runs of both types with all numbers of physics steps that the drive allows."""
    refused = refusals(plan.config)
    rates, repeats, steps = ((10, 50), 3, 300) if plan.quick else (SUBSTEPS, REPEATS, TIME_LIMIT)
    listed = []
    for place, name in enumerate(TYPES):
        n_robots = robots_for(plan.config.arena, PRESETS[name].density_of_robots)
        for rate in rates:
            if rate in refused:
                continue
            config = replace(plan.config, drive=drive_of(plan.config.drive, rate))
            for repeat in range(repeats):
                job = Job(config, PRESETS[name], n_robots, run_seed(plan.seed, place, rate, repeat), steps, plan.goal)
                listed.append(Entry({"type": name, "rate": rate, "repeat": repeat}, job))
    return listed


def observe(plan: Plan, out: Path, rows: list[dict[str, Any]]) -> None:
    """Add the deepest overlap [mm] and the median time of a control step [ms] to the rows of the observed runs.

    The runs of one type and repeat advance in turn, so that they share what else the machine does.
    """
    for row in rows:
        row["overlap"] = row["ms_per_step"] = None
    observed = [row for row in rows if row["repeat"] < (1 if plan.quick else OBSERVED)]
    for name, repeat in dict.fromkeys((row["type"], row["repeat"]) for row in observed):
        _advance_in_turn(plan.config, select(observed, type=name, repeat=repeat))


def _advance_in_turn(config: SwarmConfig, rows: Iterable[Any]) -> None:
    """Run the runs of these rows, a control step of each at a time, and complete the rows."""
    going = []
    for row in rows:
        settings = RunSettings(row["n_robots"], row["max_steps"], row["seed"], stop_at=row["goal"], record_worlds=())
        own = replace(config, drive=drive_of(config.drive, row["rate"]))
        run = Run(own, PRESETS[row["type"]], settings, PlanarSettings(threads=1, refinement=1))
        going.append((row, run, [], []))
    while any(not run.is_over for _, run, *_ in going):
        for _, run, seconds, overlaps in going:
            if not run.is_over:
                began = time.perf_counter()
                run.advance()
                seconds.append(time.perf_counter() - began)
                overlaps.append(float(run.arrays()[1].bodies.overlap[0]))
    for row, run, seconds, overlaps in going:
        run.raise_faults()
        row["overlap"], row["ms_per_step"] = max(overlaps), 1e3 * float(np.median(seconds[WARM_UP:]))


def findings(rows: Rows) -> list[Finding]:
    """Whether any measure changes with the time step, how deep robots overlap, what a step costs, what is refused."""
    if not rows:
        return [claim.not_run() for claim in (*SAME.values(), OVERLAP, COST, REFUSED)]
    refused = {rate: text for rate, text in refusals(SwarmConfig()).items() if not select(rows, rate=rate)}
    said = "; ".join(f"{rate}: {text}" for rate, text in refused.items())
    return [
        *(_same(rows, measure, claim) for measure, claim in SAME.items()),
        _overlap(rows),
        COST.found(_by_rate(rows, "ms_per_step", np.median, "ms"), _observed(rows, "median of the medians"), ""),
        REFUSED.found(said or "none", "turning and walking steps as 2 : 3, but 1 : 1 of 2", ""),
    ]


def draw(rows: Rows, out: Path) -> list[Path]:
    """Draw time, collisions and carriage along the number of physics steps."""
    lines = {name: select(rows, type=name) for name in TYPES}
    rate = Quantity("physics steps a second", lambda row: row["rate"])
    return [draw_curves(lines, rate, (TIME, COLLISIONS, CARRIAGE), out / "time_step")]


class _Pair(NamedTuple):
    """A number of physics steps compared with the finest, in one type."""

    name: str
    rate: int
    comparison: Comparison
    margin: float
    """Difference of the medians that counts as none."""


def _same(rows: Rows, measure: Measure, claim: Claim) -> Finding:
    """Whether a measure is equivalent at each time step and the finest, in both types."""
    pairs, parts = [], []
    for name in TYPES:
        mine = select(rows, type=name)
        samples = {rate: values(select(mine, rate=rate), measure) for rate in _rates(mine)}
        samples = {rate: sample for rate, sample in samples.items() if len(sample)}
        if len(samples) < 2:
            continue
        middles = {rate: interval(sample, median) for rate, sample in samples.items()}
        texts = [f"{rate}: {_with_ends(middle)}" for rate, middle in middles.items()]
        reached = f"{finished(mine)} of {len(mine)} runs reached the goal"
        parts.append(f"{name} ({reached}), " + ", ".join(texts))
        *coarser, finest = samples
        margin = EQUAL * middles[finest].estimate
        pairs += [_Pair(name, rate, compare(samples[rate], samples[finest]), margin) for rate in coarser]
    if not pairs:
        return claim.not_run()
    adjusted = holm([pair.comparison.p for pair in pairs])
    told = ", ".join(
        f"{pair.name} at {pair.rate}: {_with_ends(pair.comparison.difference)}, p = {number(pair.comparison.p, 2)} "
        f"({number(p, 2)})"
        for pair, p in zip(pairs, adjusted, strict=True)
    )
    first = pairs[0].comparison
    tested = (
        f"medians by physics steps a second with 95 % intervals; difference from the finest, Mann-Whitney p and, in "
        f"brackets, adjusted by Holm for {len(pairs)} comparisons, n = {first.n_first} + {first.n_second}: {told}; "
        f"equivalence test: holds if all intervals lie within {100 * EQUAL:.0f} % of the finest's median, does not if "
        "one lies outside"
    )
    verdicts = [
        enough(within(c.difference, -pair.margin, pair.margin), c.n_first, c.n_second)
        for pair in pairs
        for c in [pair.comparison]
    ]
    return claim.found(f"{'; '.join(parts)} {measure.unit}", tested, all_of(verdicts))


def _overlap(rows: Rows) -> Finding:
    """Deepest overlap by time step."""
    finest = [row["overlap"] for row in select(rows, rate=100) if row["overlap"] is not None]
    if not finest:
        return OVERLAP.not_run()
    rule = f"{_observed(rows, 'largest')}; holds if at most {NEGLIGIBLE:g} mm"
    verdict = HOLDS if max(finest) <= NEGLIGIBLE else FAILS
    return OVERLAP.found(_by_rate(rows, "overlap", max, "mm"), rule, enough(verdict, len(finest)))


def _by_rate(rows: Rows, column: str, statistic: Any, unit: str) -> str:
    """Statistic of a column of the observed runs, by type and number of physics steps."""
    parts = []
    for name in TYPES:
        mine = [row for row in select(rows, type=name) if row[column] is not None]
        found = {rate: statistic([row[column] for row in select(mine, rate=rate)]) for rate in _rates(mine)}
        parts.append(f"{name}, " + ", ".join(f"{rate}: {number(float(value))}" for rate, value in found.items()))
    return f"{'; '.join(parts)} {unit}"


def _with_ends(value: Interval) -> str:
    return f"{number(value.estimate)} ({number(value.low)} to {number(value.high)})"


def _rates(rows: Rows) -> list[int]:
    return sorted({row["rate"] for row in rows})


def _observed(rows: Rows, what: str) -> str:
    repeats = len({row["repeat"] for row in rows if row["overlap"] is not None})
    return f"{what} of {repeats} runs of each kind in the planar engine, without refinement, on one thread"


EXPERIMENT = Experiment(
    name="time-step",
    title="both types at 2 to 100 physics steps a second, 24 runs each, until 66 of 72 balls or 1200 steps",
    source=NOT_IN_PAPER,
    entries=entries,
    findings=findings,
    draw=draw,
    extra=observe,
)
