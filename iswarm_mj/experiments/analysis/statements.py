"""What section 4.6 of the paper says of its simulations, as yes or no for one set of runs.

The sets are small, a run or a few of each setting, so that one answer says little; many sets together tell which
readings of the rules agree with the paper (`analysis.support`).
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from iswarm_mj.experiments.analysis.findings import Row, Rows
from iswarm_mj.experiments.analysis.measures import CARRIAGE, COLLISIONS, DUST, TIME, Measure, select, values
from iswarm_mj.experiments.analysis.paper import BEST, CLEAN, PAPER_FITNESS, PAPER_TIME, SPARSEST, STEPS
from iswarm_mj.experiments.analysis.verdicts import EQUAL

HOP_COUNT, DENSITY, TYPES = "hop-count", "density", "types"
"""What a run belongs to: Fig. 15, Fig. 17 or Table 2. A row's `setting` is true or false, a density or a type."""

PENALTIES = {name: 40 * 72 + 10 * (STEPS - PAPER_TIME[name]) - points for name, points in PAPER_FITNESS.items()}
"""Points that the paper's types lose by collisions, see `latest_finish`: 9 and 4."""
SAME_PENALTY = 2.0
"""A penalty agrees within this factor."""


class Statement(NamedTuple):
    """A statement of the paper on one set of runs."""

    name: str
    text: str
    source: str
    holds: Callable[[Rows], bool]


def _middle(rows: Rows, measure: Measure) -> float:
    """Median of a measure; infinite where no run has a value."""
    found = values(rows, measure)
    return float(np.median(found)) if len(found) else math.inf


def _reaches(rows: Rows) -> bool:
    return 2 * sum(row["finished_at"] is not None for row in rows) > len(rows)


def _with_and_without(rows: Rows) -> tuple[list[Row], list[Row]]:
    return select(rows, study=HOP_COUNT, setting="with"), select(rows, study=HOP_COUNT, setting="without")


def _by_density(rows: Rows) -> Mapping[float, Rows]:
    runs = select(rows, study=DENSITY)
    return {density: select(runs, density=density) for density in sorted({row["density"] for row in runs})}


def _hop_counts_are_better(measure: Measure) -> Callable[[Rows], bool]:
    def holds(rows: Rows) -> bool:
        there, absent = (_middle(runs, measure) for runs in _with_and_without(rows))
        return there > absent if measure.is_better_larger else there < absent

    return holds


def _optimum_is_inside(measure: Measure) -> Callable[[Rows], bool]:
    def holds(rows: Rows) -> bool:
        found = {density: _middle(runs, measure) for density, runs in _by_density(rows).items()}
        best = min(found, key=found.__getitem__)
        return BEST[0] <= best <= BEST[1]

    return holds


def _dense_are_slower(rows: Rows) -> bool:
    found = {density: _middle(runs, TIME) for density, runs in _by_density(rows).items()}
    best = min(time for density, time in found.items() if BEST[0] <= density <= BEST[1])
    return all(time > best for density, time in found.items() if density > CLEAN[1])


def _clean(is_meant: Callable[[float], bool], reaches: bool) -> Callable[[Rows], bool]:
    def holds(rows: Rows) -> bool:
        return all(_reaches(runs) == reaches for density, runs in _by_density(rows).items() if is_meant(density))

    return holds


def _time_agrees(name: str) -> Callable[[Rows], bool]:
    def holds(rows: Rows) -> bool:
        runs = select(rows, study=TYPES, setting=name)
        return _reaches(runs) and abs(_middle(runs, TIME) / PAPER_TIME[name] - 1) <= EQUAL

    return holds


def _penalty_agrees(name: str) -> Callable[[Rows], bool]:
    def holds(rows: Rows) -> bool:
        ratio = 0.05 * _middle(select(rows, study=TYPES, setting=name), COLLISIONS) / PENALTIES[name]
        return 1 / SAME_PENALTY <= ratio <= SAME_PENALTY

    return holds


def _types_take_the_same_time(rows: Rows) -> bool:
    runs = [select(rows, study=TYPES, setting=name) for name in PAPER_TIME]
    one, two = (_middle(each, TIME) for each in runs)
    return all(map(_reaches, runs)) and abs(one - two) <= EQUAL * (one + two) / 2


STATEMENTS = (
    Statement("hop_time", "Hop counts: faster", "Fig. 15(a)", _hop_counts_are_better(TIME)),
    Statement("hop_dust", "Hop counts: more dust", "Fig. 15(b)", _hop_counts_are_better(DUST)),
    Statement("hop_collisions", "Hop counts: fewer collisions", "Fig. 15(c)", _hop_counts_are_better(COLLISIONS)),
    Statement("hop_carriage", "Hop counts: shorter carriage", "Fig. 15(d)", _hop_counts_are_better(CARRIAGE)),
    Statement("best_time", "Fastest at 0.1 to 0.15", "Fig. 17(a)", _optimum_is_inside(TIME)),
    Statement("best_collisions", "Fewest collisions at 0.1 to 0.15", "Fig. 17(c)", _optimum_is_inside(COLLISIONS)),
    Statement("best_carriage", "Shortest carriage at 0.1 to 0.15", "Fig. 17(d)", _optimum_is_inside(CARRIAGE)),
    Statement("dense_slower", "Slower above 0.2", "Fig. 17(a)", _dense_are_slower),
    Statement("cleans", "0.1 to 0.2 cleans", "Fig. 17(b)", _clean(lambda d: CLEAN[0] <= d <= CLEAN[1], True)),
    Statement("sparse", "0.05 does not clean", "Fig. 17(b)", _clean(lambda d: d == SPARSEST, False)),
    Statement("dense", "Above 0.2 does not clean", "Fig. 17(b)", _clean(lambda d: d > CLEAN[1], False)),
    Statement("time1", "Type 1 takes 310 steps", "Table 2", _time_agrees("type1")),
    Statement("time2", "Type 2 takes 311 steps", "Table 2", _time_agrees("type2")),
    Statement("same_time", "Both types take the same time", "Table 2", _types_take_the_same_time),
    Statement("penalty1", "Type 1 loses 9 points by collisions", "Table 2", _penalty_agrees("type1")),
    Statement("penalty2", "Type 2 loses 4 points by collisions", "Table 2", _penalty_agrees("type2")),
)
"""All that section 4.6 says of runs of given swarms; times agree within `EQUAL`, penalties within `SAME_PENALTY`."""


def answers(rows: Rows) -> list[bool]:
    """Whether each of the `STATEMENTS` holds for one set of runs."""
    return [statement.holds(rows) for statement in STATEMENTS]


def time_error(rows: Rows) -> float:
    """Mean of |log(time / the paper's)| of both types; runs that did not finish count as the time limit."""
    found = [_middle(select(rows, study=TYPES, setting=name), TIME) / time for name, time in PAPER_TIME.items()]
    return float(np.mean(np.abs(np.log(found))))
