"""What searches for fit swarms say on the statements of section 4.6.1 (Fig. 14, Table 2).

One evolution is one sample, see `evolution_sample`. Each statement is on the median over evolutions of a quantity of
one, or on how many of them have a property; intervals are over evolutions.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy import stats

from iswarm_mj.experiments.analysis import evolution_claims as claims
from iswarm_mj.experiments.analysis import evolution_selection
from iswarm_mj.experiments.analysis.evolution_sample import BEST, EVOLUTIONS, LAST, evolutions
from iswarm_mj.experiments.analysis.evolution_statements import NEAR, STATEMENTS, Property, Quantity
from iswarm_mj.experiments.analysis.evolution_told import Evolutions, of
from iswarm_mj.experiments.analysis.findings import (
    TOO_FEW,
    Claim,
    Finding,
    Rows,
    in_words,
    number,
    percent,
    rule_of,
    span,
    verdict_of,
)
from iswarm_mj.experiments.analysis.statistics import Interval, compare, interval, median, share
from iswarm_mj.experiments.analysis.verdicts import mostly, within

CLAIMS = (*claims.CLAIMS, *(trait.claim for trait in evolution_selection.TRAITS))


def findings(searches: Mapping[str, tuple[Rows, Mapping[str, Any]]]) -> list[Finding]:
    """All statements on searches.

    Args:
        searches: by method, "paper", "random" and "cmaes" as far as they are there: rows and settings of the table. A
            table without the column `replicate` is of one search.
    """
    if "paper" not in searches:
        return [claim.not_run() for claim in CLAIMS]
    found = {
        method: evolutions(rows, settings["config"]["arena"]["n_dust"]) for method, (rows, settings) in searches.items()
    }
    paper = found["paper"]
    compared = [
        _against(paper, found.get("random"), claims.BEATS),
        _against(paper, found.get("cmaes"), claims.RIVAL, judged=False),
    ]
    of_one = [_judged(item, paper) if isinstance(item, Quantity) else _counted(item, paper) for item in STATEMENTS]
    by_claim = {finding.claim: finding for finding in of_one + compared}
    in_order = [by_claim[claim.text] for claim in claims.CLAIMS]
    return in_order + evolution_selection.findings(paper, found.get("random"), NEAR)


def _judged(item: Quantity, sample: Evolutions) -> Finding:
    """Finding on a quantity, by the interval of its median over evolutions."""
    values = [value for value in map(item.value, sample) if value is not None]
    if not values:
        return item.claim.found(_times(len(sample)), f"no value: needs {item.needs}", TOO_FEW)
    told, over, lacking = item.told(sample), interval(values, median), len(sample) - len(values)
    without = f"; {_times(lacking)} without {item.needs}" if lacking else ""
    shown = Interval(*(item.scale * value for value in over))
    if len(values) < EVOLUTIONS:
        ours = f"{told}; {number(shown.estimate)} {item.unit}".rstrip()
        return item.claim.found(f"{ours}{of(len(values))}{without}", _too_few(len(values)), TOO_FEW)
    ends = " to ".join(number(item.scale * value) for value in (min(values), max(values)))
    ours = f"{told}; median over {_times(len(values))} {span(shown, item.unit)}, from {ends}{without}"
    return item.claim.found(ours, f"{_signs(item, values)}; {_rule(item)}", within(over, item.low, item.high))


def _counted(item: Property, sample: Evolutions) -> Finding:
    """Finding on a property, by the exact interval of the share of the evolutions that have it."""
    count, told = sum(item.has(one.best) for one in sample), item.told(sample)
    ours = f"{count} of {len(sample)} evolutions by their best genomes"
    if len(sample) < EVOLUTIONS:
        return item.claim.found(f"{ours}; {told}", _too_few(len(sample)), TOO_FEW)
    rule = "exact interval over evolutions; holds if it lies above one half, does not if it lies below"
    ours += f", {percent(share(count, len(sample), 'exact'))}; {told}"
    return item.claim.found(ours, rule, mostly(count, len(sample)))


def _against(mine: Evolutions, theirs: Evolutions | None, claim: Claim, judged: bool = True) -> Finding:
    """The best runs of the evolutions against those of another method's searches.

    Not the last generations, which are told beside them: those of random search are as its first.
    """
    if theirs is None:
        return claim.not_run()
    best = [[one.best_runs for one in found] for found in (mine, theirs)]
    final = [np.median([one.final for one in found]) for found in (mine, theirs)]
    ours = (
        f"mean fitness of the {BEST} best runs {np.median(best[0]):z.0f} against {np.median(best[1]):z.0f} points, of "
        f"the last {LAST} generations {final[0]:z.0f} against {final[1]:z.0f}; medians of {len(mine)} and "
        f"{len(theirs)} searches"
    )
    if (least := min(map(len, best))) < EVOLUTIONS:
        return claim.found(ours, _too_few(least), TOO_FEW if judged else "")
    result = compare(*best)
    rule = f"; {rule_of(True)}" if judged else ""
    told = f"of the searches, by their {BEST} best runs: {in_words(result, 'points')}{rule}"
    return claim.found(ours, told, verdict_of(result, True) if judged else "")


def _signs(item: Quantity, values: Sequence[float]) -> str:
    """How the interval was made, and the sign test if there is one limit."""
    told = f"interval by order statistics over {_times(len(values))}"
    limit = item.low if math.isfinite(item.low) else item.high
    if math.isfinite(item.low) and math.isfinite(item.high):
        return told
    above, apart = sum(v > limit for v in values), sum(v != limit for v in values)
    p = float(stats.binomtest(above, apart).pvalue) if apart else 1.0
    return f"{told}; {above} of {len(values)} above {number(item.scale * limit)}, sign test p = {number(p, 2)}"


def _rule(item: Quantity) -> str:
    low, high = (f"{number(item.scale * v)} {item.unit}".rstrip() for v in (item.low, item.high))
    if math.isfinite(item.low) and math.isfinite(item.high):
        return f"equivalence test: holds if the interval lies within {low} to {high}, does not if it lies outside"
    sides = ("above", low, "below") if math.isfinite(item.low) else ("below", high, "above")
    return "holds if the interval lies {} {}, does not if it lies {}".format(*sides)


def _times(n: int) -> str:
    return "one evolution" if n == 1 else f"{n} evolutions"


def _too_few(n: int) -> str:
    return f"one evolution is one sample: no interval over evolutions from {n}, needs {EVOLUTIONS} (--replicates)"
