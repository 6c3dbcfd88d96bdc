"""The statements of section 4.6.1 on evolutions (Fig. 14, Table 2), and on searches that the paper
lacks.

One evolution is one sample, see `evolution`. Each statement is on the median over evolutions of a
quantity of one, or on how many of them have a property; intervals are over evolutions.

All are predicted but four. What a dependent mutation does to a Boolean was chosen by the paper's
number of swarms without hop counts (`runner.evolution.Operators.boolean_mutation`), and most of
these fail: so many swarms fail, and most of those that fail lost hop counts by chance, whatever
their other parameters are, so that these are nearly equal in swarms that clean the arena and in
others.

Drift moves the traits of an evolution, but has no direction: mutations and limits are symmetric
about the middle of each range, so that without selection the median over evolutions is that of
random search. A median that differs from it over replicates of both was moved by selection.
"""

import math
from collections.abc import Callable, Mapping
from functools import partial
from operator import attrgetter

import numpy as np

from iswarm_mj.paper.analysis import findings as f
from iswarm_mj.paper.analysis.evolution import Evolution, Evolutions, mean_of
from iswarm_mj.paper.analysis.findings import Judged, Statement, added, number
from iswarm_mj.paper.analysis.judge import RARE, Estimate, judged, shares
from iswarm_mj.paper.analysis.measures import PAPER_FITNESS
from iswarm_mj.paper.analysis.statements import NEARLY
from iswarm_mj.paper.analysis.statistics import Interval, compare, holm, interval
from iswarm_mj.strategy.genome import Genome

EVOLUTIONS = 6
"""Least evolutions over which anything is judged: of five or fewer, not even the range from the
least to the greatest is an interval of the median at 95 %, as 2 / 2^5 = 6 %."""
NEAR = 0.05
"""Margin of the equivalence tests on parameters of swarms: the largest step of the paper's
dependent mutation. Means that differ by less are within one mutation of each other, so that no
evolution of this kind tells them apart. Of shares of the elites, one in twenty."""
SURE = 0.05
"""Level of the p-values adjusted for the number of traits: without, one of 20 that are not moved
would seem so."""
FITNESS = max(PAPER_FITNESS.values())
"""Points of the paper's fittest swarm."""
Samples = Mapping[str, Evolutions]
"""Searches by method: "paper", "random" and "cmaes" as far as they are there."""
Value = Callable[[Evolution], float | None]
"""A quantity of one evolution; None if it is too short, or has too few runs of a group."""


def _median(
    value: Value, samples: Samples, low: float = -math.inf, high: float = math.inf, unit: str = ""
) -> Judged | None:
    """A statement on the median over evolutions; below `EVOLUTIONS` without an interval."""
    if "paper" not in samples:
        return None
    found = [v for v in map(value, samples["paper"]) if v is not None]
    if not found:
        return Judged("no value", "evolutions are too short, or lack runs", f.TOO_FEW)
    over, factor = interval(found, np.median), 100 if unit == "%" else 1
    if len(found) < EVOLUTIONS:
        over = Interval(over.estimate, math.nan, math.nan)
    said = f"{number(factor * min(found))} to {number(factor * max(found))}, median "
    one = Estimate(over, (len(found),), low, high, said=said, least=EVOLUTIONS)
    return judged([one], f"medians over {len(samples['paper'])} evolutions", unit)


def _property(has: Callable[[Genome], bool], samples: Samples) -> Judged | None:
    """A statement that most of the evolutions have a property of their best genome."""
    if "paper" not in samples:
        return None
    every = samples["paper"]
    return shares(
        {"": (sum(has(one.best) for one in every), len(every))}, (0.5, math.inf), EVOLUTIONS
    )


def _against(method: str, is_judged: bool, samples: Samples) -> Judged | None:
    """The best runs of the evolutions against those of another method's searches."""
    if not {"paper", method} <= samples.keys():
        return None
    best = [[one.best_runs for one in samples[name]] for name in ("paper", method)]
    n, tested = (len(best[0]), len(best[1])), compare(*best)
    said = f"{np.median(best[0]):z.0f} against {np.median(best[1]):z.0f}, difference "
    found = judged(
        [Estimate(tested.difference, n, 0.0, said=said, tested=tested)], "medians", "points"
    )
    verdict = found.verdict if found and min(n) >= EVOLUTIONS else f.TOO_FEW
    return found._replace(verdict=verdict * is_judged) if found else None


def _level(name: str, paper: float, samples: Samples) -> Judged | None:
    """A parameter is the paper's in runs that clean the arena."""
    return _median(
        lambda one: mean_of(one.good, lambda row: row[name]), samples, paper - NEAR, paper + NEAR
    )


def _equal(name: str, samples: Samples) -> Judged | None:
    """A parameter is equal in runs that clean the arena and in others; beside it, in those with hop
    counts alone."""
    found, counted = (
        _median(lambda one, c=c: one.apart(name, c), samples, -NEAR, NEAR) for c in (False, True)
    )
    return (
        found._replace(ours=f"{found.ours}; with hop counts alone {counted.ours}")
        if found and counted
        else None
    )


def _weights(one: Evolution) -> float | None:
    dump, dust = one.late("weight_find_dump"), one.late("weight_find_dust")
    return None if dump is None or dust is None else dump - dust


_trade: Value = attrgetter("trade")
TRAITS: Mapping[str, Value] = {
    "the density of robots": lambda one: one.late("density_of_robots"),
    "the fraction of scouts": lambda one: one.late("fraction_scouts"),
    "p(vector-forget)": lambda one: one.late("p_vector_forget"),
    "the use of hop counts": lambda one: one.late("use_hop_count"),
    "the priority signal of loaded robots": lambda one: one.late("priority_signal_loaded"),
    "the priority signal of scouts": lambda one: one.late("priority_signal_scouts"),
    "weight-find-dump against weight-find-dust": _weights,
    "the correlation of p(vector-forget) with scouts among the 250 fittest of generations 35 to 100": attrgetter(
        "trade"
    ),
}
"""What selection may act on: means of the last generations, of Booleans those of the elites; and a
correlation."""


def _moved(trait: str, samples: Samples) -> Judged | None:
    """A trait differs from that of random search, by a test that is corrected for the number of
    traits."""
    if not {"paper", "random"} <= samples.keys():
        return None
    pairs = {
        name: [
            [v for v in map(value, samples[method]) if v is not None]
            for method in ("paper", "random")
        ]
        for name, value in TRAITS.items()
    }
    ours = " against ".join(number(float(np.median(v))) if v else "no value" for v in pairs[trait])
    tested = {
        name: compare(*pair) for name, pair in pairs.items() if min(map(len, pair)) >= EVOLUTIONS
    }
    if trait not in tested:
        return Judged(ours, f"needs {EVOLUTIONS} of both searches (--replicates)", f.TOO_FEW)
    adjusted = dict(zip(tested, holm([one.p for one in tested.values()]), strict=True))[trait]
    apart, (n, m) = tested[trait].difference, map(len, pairs[trait])
    rule = (
        f"medians, n = {n} + {m}; Mann-Whitney, by Holm p = {number(adjusted, 2)}; holds if that is below {SURE} and "
        f"the interval leaves out zero, else does not if it lies within {NEAR}"
    )
    is_moved = adjusted < SURE and (apart.low > 0 or apart.high < 0)
    is_near = apart.low >= -NEAR and apart.high <= NEAR
    verdict = f.HOLDS if is_moved else f.FAILS if is_near else f.UNDECIDED
    return Judged(f"{ours} in random search, difference {f.short(apart)}", rule, verdict)


def _share(of: str, counted: bool) -> Value:
    """Share of the runs of a group, `good` or `poor`, with hop counts, or without."""
    return lambda one: mean_of(getattr(one, of), lambda row: row["use_hop_count"] == counted)


TESTS = {
    "rises": partial(_median, attrgetter("rise"), low=0.5),
    "learns": partial(_median, attrgetter("gain"), low=0.0, unit="points"),
    "beats random": partial(_against, "random", True),
    "against CMA-ES": partial(_against, "cmaes", False),
    "as fit": partial(
        *(_median, lambda one: float(one.bests.max())),
        **{"low": (1 - NEARLY) * FITNESS, "high": (1 + NEARLY) * FITNESS, "unit": "points"},
    ),
    "slow": partial(_median, attrgetter("early"), high=RARE, unit="%"),
    "many fail": partial(_median, attrgetter("failing"), low=0.2, unit="%"),
    "counted": partial(_median, _share("good", True), low=0.9, unit="%"),
    "uncounted": partial(_median, _share("poor", False), low=0.5, unit="%"),
    "exceptions": partial(_median, attrgetter("exceptions"), low=0.02, high=0.08, unit="%"),
    "scouts level": partial(_level, "fraction_scouts", 0.16),
    "forget level": partial(_level, "p_vector_forget", 0.28),
    "scouts equal": partial(_equal, "fraction_scouts"),
    "forget equal": partial(_equal, "p_vector_forget"),
    "trade": partial(_median, _trade, high=0.0),
    "density level": partial(_median, attrgetter("density"), low=0.1, high=0.15, unit="%"),
    "signals": partial(
        _property, lambda best: best.priority_signal_loaded and not best.priority_signal_scouts
    ),
    "weights": partial(
        _median, lambda one: one.best.weight_find_dump - one.best.weight_find_dust, low=0.0
    ),
    "distances": partial(
        _property,
        lambda best: (
            best.empty_coll_avoid_dist > best.priority_coll_avoid_dist > best.loaded_coll_avoid_dist
        ),
    ),
}
STATEMENTS: list[Statement] = [
    *f.stated(TESTS),
    *(added("evolution", f"Selection moves {trait}", partial(_moved, trait)) for trait in TRAITS),
]
