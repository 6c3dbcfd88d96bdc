"""The statements of section 4.6 of the paper on swarms (Figs. 15 to 17, Table 2), each with its test.

Most rules were fixed before the runs that they judge; margins that were widened when first results had been seen are
named in docs/comparison.md. `ASKED` has what the study `infer` asks of single sets of runs.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.experiments.analysis.findings import Judged, Rows, Test, stated
from iswarm_mj.experiments.analysis.judge import EQUAL, RARE, averages, differences, optimum, reaching, shares
from iswarm_mj.experiments.analysis.measures import (
    AGGREGATION,
    BEST,
    CARRIAGE,
    CLEAN,
    COLLISIONS,
    DUST,
    FITNESS,
    PAPER_FITNESS,
    PAPER_TIME,
    PENALTIES,
    SHORTEST,
    SPARSEST,
    STEPS,
    TIME,
    Measure,
    by,
    finished,
    select,
    values,
)

NEARLY = 0.05
"""Fitness within this share of the paper's is the same: 39 steps of the finishing time."""
SAME_PENALTY = 2.0
"""A penalty agrees within this factor."""
NEAR = 3.5
"""A robot is at a dust area if it is in it or within this distance of it, the sensory radius [rd]."""


# --- One set of runs, a run or a few of each setting: yes or no ---


def _middle(rows: Rows, measure: Measure) -> float:
    """Median of a measure; infinite where no run has a value."""
    found = values(rows, measure)
    return float(np.median(found)) if len(found) else math.inf


def _reaches(rows: Rows) -> bool:
    return 2 * finished(rows) > len(rows)


def _medians(rows: Rows, measure: Measure) -> dict[float, float]:
    return {density: _middle(runs, measure) for density, runs in sorted(by(rows, "density").items())}


def _with_is_better(measure: Measure, rows: Rows) -> bool:
    there, absent = (_middle(select(rows, use_hop_count=flag), measure) for flag in (True, False))
    return there > absent if measure.is_better_larger else there < absent


def _is_best(measure: Measure, rows: Rows) -> bool:
    found = _medians(rows, measure)
    return BEST[0] <= min(found, key=found.__getitem__) <= BEST[1]


def _dense_are_slower(rows: Rows) -> bool:
    found = _medians(rows, TIME)
    best = min(time for density, time in found.items() if BEST[0] <= density <= BEST[1])
    return all(time > best for density, time in found.items() if density > CLEAN[1])


def _time_agrees(name: str, rows: Rows) -> bool:
    runs = select(rows, type=name)
    return _reaches(runs) and abs(_middle(runs, TIME) / PAPER_TIME[name] - 1) <= EQUAL


def _penalty_agrees(name: str, rows: Rows) -> bool:
    ratio = 0.05 * _middle(select(rows, type=name), COLLISIONS) / PENALTIES[name]
    return 1 / SAME_PENALTY <= ratio <= SAME_PENALTY


def _same_time(rows: Rows) -> bool:
    runs = [select(rows, type=name) for name in PAPER_TIME]
    one, two = (_middle(each, TIME) for each in runs)
    return all(map(_reaches, runs)) and abs(one - two) <= EQUAL * (one + two) / 2


def penalty_error(rows: Rows) -> float:
    """Mean of |log(penalty / the paper's)| of both types by collisions; without any, as if they were one a robot."""
    found = [max(0.05, 0.05 * _middle(select(rows, type=name), COLLISIONS)) / p for name, p in PENALTIES.items()]
    return float(np.mean(np.abs(np.log(found))))


# --- Many runs of each setting ---


def hop_counts(measure: Measure, rows: Rows) -> Judged | None:
    """Judge whether a measure of runs is better with hop counts than without."""
    groups = select(rows, use_hop_count=True), select(rows, use_hop_count=False)
    return differences({"": groups}, measure, measure.is_better_larger)


def _lowest(measure: Measure, rows: Rows) -> Judged | None:
    return optimum(by(rows, "density"), measure, BEST)


def _densities(rows: Rows, low: float, high: float) -> dict[str, Rows]:
    """Runs of the densities from `low` to `high`, by these."""
    return {f"{d:g}": runs for d, runs in sorted(by(rows, "density").items()) if low <= d <= high}


def _later(rows: Rows) -> Judged | None:
    best = [row for row in rows if BEST[0] <= row["density"] <= BEST[1]]
    return differences({density: (runs, best) for density, runs in _densities(rows, *DENSE).items()})


DENSE = float(np.nextafter(CLEAN[1], 1)), math.inf
CLEANED = {"cleans": (CLEAN, True), "sparse": ((SPARSEST, SPARSEST), False), "dense": (DENSE, False)}
"""Densities, and whether more than half of the swarms of each reach the goal there."""


def _cleaned(ends: tuple[float, float], cleans: bool, rows: Rows) -> Judged | None:
    return reaching(_densities(rows, *ends), cleans)


def _all_clean(ends: tuple[float, float], cleans: bool, rows: Rows) -> bool:
    return all(_reaches(runs) == cleans for runs in _densities(rows, *ends).values())


def _types(rows: Rows) -> dict[str, Rows]:
    """Runs of both of the paper's types; none if one is not there, as nothing follows from the other."""
    types: dict[str, Rows] = {name: select(rows, type=name) for name in PAPER_FITNESS}
    return types if all(types.values()) else {}


def _as_the_papers(
    measure: Measure, paper: Mapping[str, float], margin: float, statistic: Callable, rows: Rows
) -> Judged | None:
    limits = {name: ((1 - margin) * value, (1 + margin) * value) for name, value in paper.items()}
    samples = {name: values(runs, measure) for name, runs in _types(rows).items()}
    return averages(samples, limits, measure.unit, statistic)


def _early(rows: Rows) -> Judged | None:
    early = {
        name: (sum((row["finished_at"] or STEPS) < SHORTEST for row in runs), len(runs))
        for name, runs in _types(rows).items()
    }
    return shares(early, (-math.inf, RARE))


def _compared(first: str, second: str, measure: Measure, rows: Rows, **how: Any) -> Judged | None:
    """Runs of one type against those of another."""
    return differences({"": (select(rows, type=first), select(rows, type=second))}, measure, **how)


TESTS: Mapping[str, Test] = {
    "hop time": partial(hop_counts, TIME),
    "hop dust": partial(hop_counts, DUST),
    "hop collisions": partial(hop_counts, COLLISIONS),
    "hop carriage": partial(hop_counts, CARRIAGE),
    "best time": partial(_lowest, TIME),
    "best collisions": partial(_lowest, COLLISIONS),
    "best carriage": partial(_lowest, CARRIAGE),
    "dense slower": _later,
    **{name: partial(_cleaned, *ends) for name, ends in CLEANED.items()},
    "types clean": lambda rows: reaching(_types(rows)),
    "types time": partial(_as_the_papers, TIME, PAPER_TIME, EQUAL, np.median),
    "same time": partial(
        _compared, "type1", "type2", TIME, margin=lambda a, b: EQUAL * float(np.median(a) + np.median(b)) / 2
    ),
    "early": _early,
    "types fitness": partial(_as_the_papers, FITNESS, PAPER_FITNESS, NEARLY, np.mean),
    "equally fit": partial(
        _compared, "type1", "type2", FITNESS, margin=lambda a, b: NEARLY * PAPER_FITNESS["type1"], statistic=np.mean
    ),
    "gathering": partial(_compared, "type2", "type1", AGGREGATION),
    # Fitted: an evolution selected it by this fitness, in this simulator, if not with these seeds.
    "evolved type1": partial(_compared, "evolved", "type1", FITNESS),
    "evolved type2": partial(_compared, "evolved", "type2", FITNESS),
}
STATEMENTS = stated(TESTS)


class Asked(NamedTuple):
    """What section 4.6 says of runs of given swarms, as yes or no on a single set of runs."""

    study: str
    """On whose rows it is."""
    holds: Callable[[Rows], bool]
    selects: bool
    """It selects readings; the others are held out, and nothing is chosen by them."""


ASKED: Mapping[str, Asked] = {
    "Hop counts: faster": Asked("hop-count", partial(_with_is_better, TIME), False),
    "Hop counts: more dust": Asked("hop-count", partial(_with_is_better, DUST), False),
    "Hop counts: fewer collisions": Asked("hop-count", partial(_with_is_better, COLLISIONS), False),
    "Hop counts: shorter carriage": Asked("hop-count", partial(_with_is_better, CARRIAGE), False),
    "Fastest at 0.1 to 0.15": Asked("density", partial(_is_best, TIME), True),
    "Fewest collisions at 0.1 to 0.15": Asked("density", partial(_is_best, COLLISIONS), True),
    "Shortest carriage at 0.1 to 0.15": Asked("density", partial(_is_best, CARRIAGE), True),
    "Slower above 0.2": Asked("density", _dense_are_slower, True),
    "0.1 to 0.2 cleans": Asked("density", partial(_all_clean, *CLEANED["cleans"]), True),
    "0.05 does not clean": Asked("density", partial(_all_clean, *CLEANED["sparse"]), True),
    "Above 0.2 does not clean": Asked("density", partial(_all_clean, *CLEANED["dense"]), True),
    "Type 1 takes 310 steps": Asked("types", partial(_time_agrees, "type1"), False),
    "Type 2 takes 311 steps": Asked("types", partial(_time_agrees, "type2"), False),
    "Both types take the same time": Asked("types", _same_time, False),
    "Type 1 loses 9 points by collisions": Asked("types", partial(_penalty_agrees, "type1"), True),
    "Type 2 loses 4 points by collisions": Asked("types", partial(_penalty_agrees, "type2"), True),
}
"""Of `infer`: Fig. 17 and the penalties in Table 2 select, Fig. 15 and the times of both types are held out."""
