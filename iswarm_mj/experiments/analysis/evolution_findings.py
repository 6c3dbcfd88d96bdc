"""What searches for fit swarms say on the statements of section 4.6.1 (Fig. 14, Table 2).

All are predicted but one: that many swarms fail, since the operators draw a Boolean anew by tossing a coin
(`strategy.evolution`), and half of what they change so lacks hop counts.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np
from jaxtyping import Float

from iswarm_mj.experiments.analysis.evolution_figures import PLATEAU, fittest
from iswarm_mj.experiments.analysis.findings import (
    CONSTRUCTED,
    PREDICTED,
    UNDECIDED,
    Claim,
    Finding,
    Row,
    Rows,
    in_words,
    number,
    percent,
    span,
    verdict_of,
)
from iswarm_mj.experiments.analysis.statistics import compare, correlation, difference, mean, rank_correlation, share
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.arrays import Array

FIRST, LAST = 5, 20
"""Generations at the beginning and at the end that are compared."""
RISE = 35
"""Up to this generation the paper's best swarms got steadily better."""
BEST = 100
"""Best runs that are compared, since random search does not gather about its best as the others do."""
GROUP = 30
"""Least runs of a group whose parameters are compared, or of which a share is judged."""
SMALL = 0.2
"""Differences of less than this share of a standard deviation count as none (Cohen's small effect)."""

_WHERE = "section 4.6.1"
RISES = Claim(
    "The best fitness rises steadily from generation 1 to 35", f"{_WHERE}, Fig. 14(a)", "steady increase", PREDICTED
)
LEARNS = Claim(
    "The last 20 generations are fitter than the first 5", f"{_WHERE}, Fig. 14(a)", "yes, by the figure", PREDICTED
)
BEATS = Claim("The evolution beats random search at the same budget", "not in the paper", "not studied", PREDICTED)
RIVAL = Claim("The evolution against CMA-ES at the same budget", "not in the paper", "not studied", PREDICTED)
MANY_FAIL = Claim(
    "A high fraction of the swarms does not clean the whole arena", _WHERE, "525 of 1200, 43.8 %", CONSTRUCTED
)
COUNTED = Claim(
    "Swarms that clean the whole arena use hop counts, at least 90 % of them", _WHERE, "655 of 675, 97.0 %", PREDICTED
)
UNCOUNTED = Claim("Most swarms that do not clean it do not use them", _WHERE, "464 of 525, 88.4 %", PREDICTED)
SCOUTS = Claim(
    "The fraction of scouts is equal in swarms that clean the arena and in others",
    _WHERE,
    "0.16 ± 0.12 and 0.16 ± 0.13",
    PREDICTED,
)
FORGET = Claim(
    "p(vector-forget) is equal in swarms that clean the arena and in others",
    _WHERE,
    "0.28 ± 0.13 and 0.29 ± 0.16",
    PREDICTED,
)
TRADE = Claim(
    "p(vector-forget) and the fraction of scouts are negatively correlated among the 250 fittest swarms of generations "
    "35 to 100",
    f"{_WHERE}, Fig. 14(b)",
    "strong negative correlation, no number given",
    PREDICTED,
)
DENSITY = Claim(
    "The density converges to 11.8 to 13.2 %", _WHERE, "11.8 % (280 robots) to 13.2 % (314 robots)", PREDICTED
)
SIGNALS = Claim(
    "Priority is signalled by loaded robots and not by scouts in the fittest swarms",
    f"{_WHERE}, Table 2",
    "both types",
    PREDICTED,
)
WEIGHTS = Claim(
    "weight-find-dump exceeds weight-find-dust in the fittest swarms", f"{_WHERE}, Table 2", "both types", PREDICTED
)
DISTANCES = Claim(
    "The fittest keep more distance between empty robots than from priority, and least when loaded",
    f"{_WHERE}, Table 2",
    "0.65/0.77, 0.40/0.41 and 0.25/0.27 sr",
    PREDICTED,
)
CLAIMS = (
    RISES,
    LEARNS,
    BEATS,
    RIVAL,
    MANY_FAIL,
    COUNTED,
    UNCOUNTED,
    SCOUTS,
    FORGET,
    TRADE,
    DENSITY,
    SIGNALS,
    WEIGHTS,
    DISTANCES,
)


def findings(searches: Mapping[str, tuple[Rows, Mapping[str, Any]]]) -> list[Finding]:
    """All statements on searches.

    Args:
        searches: by method, "paper", "random" and "cmaes" as far as they are there: rows and settings of the table.
    """
    if "paper" not in searches:
        return [claim.not_run() for claim in CLAIMS]
    rows, settings = searches["paper"]
    n_dust = settings["config"]["arena"]["n_dust"]
    clean = [row["delivered"] == n_dust for row in rows]
    good = [row for row, ok in zip(rows, clean, strict=True) if ok]
    poor = [row for row, ok in zip(rows, clean, strict=True) if not ok]
    top = fittest(rows, *PLATEAU)
    return [
        _rise(rows),
        _learning(rows),
        _against(rows, searches.get("random"), BEATS),
        _against(rows, searches.get("cmaes"), RIVAL, judged=False),
        _share(MANY_FAIL, len(poor), len(rows), 0.2),
        _counting(COUNTED, good, True, 0.9),
        _counting(UNCOUNTED, poor, False, 0.5),
        _equal(SCOUTS, "fraction_scouts", good, poor),
        _equal(FORGET, "p_vector_forget", good, poor),
        _trade(top),
        _density(rows),
        _common(SIGNALS, top, lambda row: row["priority_signal_loaded"] and not row["priority_signal_scouts"]),
        _common(WEIGHTS, top, lambda row: row["weight_find_dump"] > row["weight_find_dust"]),
        _common(DISTANCES, top, _keeps_least_distance_when_loaded),
    ]


def generation_means(rows: Rows) -> Float[Array, "G"]:
    """Mean fitness of each generation's runs, in their order."""
    fitness: dict[int, list[float]] = {}
    for row in rows:
        fitness.setdefault(row["generation"], []).append(row["fitness"])
    return np.array([np.mean(fitness[generation]) for generation in sorted(fitness)])


def _rise(rows: Rows) -> Finding:
    best = [max(r["fitness"] for r in rows if r["generation"] == g) for g in sorted({r["generation"] for r in rows})]
    if len(best) < RISE:
        return RISES.found(f"the search has {len(best)} generations", "needs 35", UNDECIDED)
    rho, p = rank_correlation(range(RISE), best[:RISE])
    ours = (
        f"best of a generation {best[0]:z.0f} in the first, {best[RISE - 1]:z.0f} in the 35th, {max(best):z.0f} at most"
    )
    tested = (
        f"Spearman's correlation with the generation {number(rho)}, p = {number(p, 2)}; holds if > 0.5 and p < 0.01"
    )
    return RISES.found(ours, tested, bool(rho > 0.5 and p < 0.01))


def _learning(rows: Rows) -> Finding:
    means = generation_means(rows)
    if len(means) < FIRST + LAST:
        return LEARNS.found(f"the search has {len(means)} generations", f"needs {FIRST + LAST}", UNDECIDED)
    result = compare(means[-LAST:], means[:FIRST])
    ours = f"mean fitness {means[-LAST:].mean():z.0f} against {means[:FIRST].mean():z.0f} points"
    tested = f"of the generations' means: {in_words(result, 'points')}; holds if p < 0.01"
    return LEARNS.found(ours, tested, verdict_of(result, True))


def _against(rows: Rows, other: tuple[Rows, Mapping[str, Any]] | None, claim: Claim, judged: bool = True) -> Finding:
    """The last generations of the evolution against those of another search."""
    if other is None:
        return claim.not_run()
    mine, theirs = generation_means(rows)[-LAST:], generation_means(other[0])[-LAST:]
    result = compare(mine, theirs)
    fitness = [sorted((row["fitness"] for row in found), reverse=True) for found in (rows, other[0])]
    top = [np.mean(values[:BEST]) for values in fitness]
    ours = (
        f"mean fitness of the last {len(mine)} generations {mine.mean():z.0f} against {theirs.mean():z.0f} points, "
        f"of the {BEST} best runs {top[0]:z.0f} against {top[1]:z.0f}, best run {fitness[0][0]:z.0f} against "
        f"{fitness[1][0]:z.0f}; {len(rows)} and {len(other[0])} runs"
    )
    rule = "; holds if p < 0.01" if judged else ""
    return claim.found(
        ours,
        f"of the generations' means: {in_words(result, 'points')}{rule}",
        verdict_of(result, True) if judged else "",
    )


def _share(claim: Claim, count: int, total: int, least: float) -> Finding:
    """Whether a share of the runs is more than `least`; undecided where its interval holds that."""
    if not total:
        return claim.found("no such run", "", UNDECIDED)
    found, limit = share(count, total), f"{100 * least:.0f} %"
    rule = f"Wilson's interval; holds if it lies above {limit}, does not if it lies below; needs {GROUP} runs"
    is_open = total < GROUP or found.low <= least <= found.high
    return claim.found(f"{count} of {total}, {percent(found)}", rule, UNDECIDED if is_open else found.low > least)


def _counting(claim: Claim, rows: Rows, flag: bool, least: float) -> Finding:
    """Share of the runs whose use_hop_count is `flag`."""
    return _share(claim, sum(row["use_hop_count"] is flag for row in rows), len(rows), least)


def _equal(claim: Claim, name: str, good: Rows, poor: Rows) -> Finding:
    """Whether a parameter differs by less than a small effect between two groups; undecided if that is open."""
    if min(len(good), len(poor)) < GROUP:
        return claim.found(f"{len(good)} and {len(poor)} runs", f"needs {GROUP} of both", UNDECIDED)
    first, second = (np.array([row[name] for row in rows]) for rows in (good, poor))
    apart = difference(first, second, mean)
    pooled = float(np.sqrt((first.var(ddof=1) + second.var(ddof=1)) / 2))
    effect, low, high = (v / pooled if pooled else 0.0 for v in (apart.estimate, apart.low, apart.high))
    ours = f"{first.mean():.2f} ± {first.std(ddof=1):.2f} and {second.mean():.2f} ± {second.std(ddof=1):.2f}"
    tested = (
        f"difference of the means {span(apart)}, {number(abs(effect), 2)} standard deviations, n = {len(first)} + "
        f"{len(second)} runs, of which many share their genomes' ancestors; holds if the interval lies within {SMALL} "
        f"standard deviations, does not if it lies outside"
    )
    is_open = low < SMALL < high or low < -SMALL < high
    return claim.found(ours, tested, UNDECIDED if is_open else abs(effect) < SMALL)


def _trade(top: Rows) -> Finding:
    if not top:
        return TRADE.found("the search is too short", "needs 100 generations", UNDECIDED)
    x, y = ([row[column] for row in top] for column in ("p_vector_forget", "fraction_scouts"))
    found, (rho, p) = correlation(x, y), rank_correlation(x, y)
    genomes = len({tuple(row[f.name] for f in fields(Genome)) for row in top})
    tested = (
        f"Pearson's r with Fisher's interval, Spearman's {number(rho, 2)} (p = {number(p, 2)}), n = {len(top)} runs of "
        f"{genomes} genomes, which share ancestors, so that the interval is too narrow; holds if it is below zero"
    )
    return TRADE.found(f"r = {span(found, digits=2)}", tested, bool(found.high < 0))


def _density(rows: Rows) -> Finding:
    last = max(row["generation"] for row in rows) - LAST
    if last < FIRST:
        return DENSITY.found(f"the search has {last + LAST + 1} generations", f"needs {FIRST + LAST + 1}", UNDECIDED)
    found = np.array([row["density_of_robots"] for row in rows if row["generation"] > last])
    low, middle, high = np.quantile(found, [0.25, 0.5, 0.75])
    ours = (
        f"median {100 * middle:.1f} %, quartiles {100 * low:.1f} and {100 * high:.1f} %, in the last {LAST} generations"
    )
    most = max(row["n_robots"] for row in rows)
    rule = f"n = {len(found)} runs; the biggest had {most} robots (the paper's 785); holds if the median is within"
    return DENSITY.found(ours, rule, bool(0.118 <= middle <= 0.132))


def _keeps_least_distance_when_loaded(row: Row) -> bool:
    return row["empty_coll_avoid_dist"] > row["priority_coll_avoid_dist"] > row["loaded_coll_avoid_dist"]


def _common(claim: Claim, top: Rows, has: Any) -> Finding:
    """Whether most of the fittest have a property."""
    if not top:
        return claim.found("the search is too short", "needs 100 generations", UNDECIDED)
    count = sum(bool(has(row)) for row in top)
    rule = f"Wilson's interval, of the {len(top)} fittest of generations 35 to 100; holds if more than half"
    return claim.found(f"{count} of {len(top)}, {percent(share(count, len(top)))}", rule, 2 * count > len(top))
