"""The statements of section 4.6.1 on evolutions (Fig. 14, Table 2), and on searches that the paper lacks.

One evolution is one sample, see `evolution`. Each statement is on the median over evolutions of a quantity of one, or
on how many of them have a property; intervals are over evolutions.

All are predicted but four. What a dependent mutation does to a Boolean was chosen by the paper's number of swarms
without hop counts (`runner.evolution.Operators.boolean_mutation`), and most of these fail: so many swarms fail, and
most of those that fail lost hop counts by chance, whatever their other parameters are, so that these are nearly equal
in swarms that clean the arena and in others.

Drift moves the traits of an evolution, but has no direction: mutations and limits are symmetric about the middle of
each range, so that without selection the median over evolutions is that of random search. A median that differs from it
over replicates of both was moved by selection.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from iswarm_mj.experiments.analysis.evolution import (
    BEST,
    FIRST,
    GROUP,
    LAST,
    RISE,
    SOME,
    Evolution,
    Evolutions,
    mean_of,
)
from iswarm_mj.experiments.analysis.findings import (
    FAILS,
    HOLDS,
    NOT_IN_PAPER,
    PREDICTED,
    TOO_FEW,
    UNDECIDED,
    Judged,
    Statement,
    Test,
    number,
    span,
    stated,
)
from iswarm_mj.experiments.analysis.judge import RARE, Estimate, judged, shares
from iswarm_mj.experiments.analysis.measures import PAPER_FITNESS
from iswarm_mj.experiments.analysis.statements import NEARLY
from iswarm_mj.experiments.analysis.statistics import Interval, compare, holm, interval
from iswarm_mj.strategy.genome import Genome

EVOLUTIONS = 6
"""Least evolutions over which anything is judged: of five or fewer, not even the range from the least to the greatest
is an interval of the median at 95 %, as 2 / 2^5 = 6 %."""
NEAR = 0.05
"""Margin of the equivalence tests on parameters of swarms: the largest step of the paper's dependent mutation. Means
that differ by less are within one mutation of each other, so that no evolution of this kind tells them apart. Of shares
of the elites, one in twenty."""
SURE = 0.05
"""Level of the p-values adjusted for the number of traits: without, one of 20 that are not moved would seem so."""
FITNESS = max(PAPER_FITNESS.values())
"""Points of the paper's fittest swarm."""
_ONE = "one evolution is one sample: "

Samples = Mapping[str, Evolutions]
"""Searches by method: "paper", "random" and "cmaes" as far as they are there."""
Told = Callable[[Evolutions], str]
"""What is told of all evolutions together beside the number that decides."""


def _median(
    value: Callable[[Evolution], float | None],
    told: Told,
    low: float = -math.inf,
    high: float = math.inf,
    unit: str = "",
) -> Test:
    """A statement on the median over evolutions."""

    def test(samples: Samples) -> Judged | None:
        if "paper" not in samples:
            return None
        every = samples["paper"]
        found = [v for v in map(value, every) if v is not None]
        lacking = f"{len(every) - len(found)} evolutions have no value: too short, or less than {GROUP} runs of a group"
        if not found:
            return Judged(f"of {len(every)} evolutions", lacking, TOO_FEW)
        over, factor = interval(found, np.median), 100 if unit == "%" else 1
        said = f"{told(every)}; from {number(factor * min(found))} to {number(factor * max(found))}"
        enough = len(found) >= EVOLUTIONS
        shown = over if enough else Interval(over.estimate, math.nan, math.nan)
        one = Estimate(shown, (len(found),), low, high, said=said, least=EVOLUTIONS)
        notes = [] if enough else [f"{_ONE}no interval from {len(found)}, needs {EVOLUTIONS} (--replicates)"]
        return judged([one], "median over evolutions", unit, "; ".join(notes + [lacking] * (len(found) < len(every))))

    return test


def _property(has: Callable[[Genome], bool], *names: str) -> Test:
    """A statement that most of the evolutions have a property of their best genome."""

    def test(samples: Samples) -> Judged | None:
        if "paper" not in samples:
            return None
        every = samples["paper"]
        counts = {"": (sum(has(one.best) for one in every), len(every))}
        said = {"": f" by their best genomes, {_best(*names)(every)}"}
        return shares(counts, 0.5, said=said, least=EVOLUTIONS, of="evolutions")

    return test


def _against(method: str, is_judged: bool) -> Test:
    """The best runs of the evolutions against those of another method's searches.

    Not the last generations, which are told beside them: those of random search are as its first.
    """

    def test(samples: Samples) -> Judged | None:
        if not {"paper", method} <= samples.keys():
            return None
        groups = [samples[name] for name in ("paper", method)]
        best = [[one.best_runs for one in found] for found in groups]
        final = [np.median([one.final for one in found]) for found in groups]
        said = (
            f"mean fitness of the {BEST} best runs {np.median(best[0]):z.0f} against {np.median(best[1]):z.0f} points, "
            f"of the last {LAST} generations {final[0]:z.0f} against {final[1]:z.0f}"
        )
        n, tested = (len(best[0]), len(best[1])), compare(*best)
        found = judged(
            [Estimate(tested.difference, n, 0.0, said=said, tested=tested)], "difference of the medians", "points"
        )
        verdict = found.verdict if found and min(n) >= EVOLUTIONS else TOO_FEW
        return found._replace(verdict=verdict * is_judged) if found else None

    return test


def _of(group: str, count: Callable[[Evolution], int]) -> Told:
    """How many runs of a group do something."""
    return lambda every: (
        f"{sum(map(count, every))} of {sum(len(getattr(one, group)) for one in every)} runs in all evolutions"
    )


def _spread(every: Evolutions, group: str, name: str) -> str:
    """Mean and standard deviation of a parameter in a group of runs, the paper's form."""
    found = np.array([row[name] for one in every for row in getattr(one, group)])
    return f"{found.mean():.2f} ± {found.std(ddof=1):.2f}"


def _both(name: str) -> Told:
    """The spread in both groups, and the difference with hop counts: those without fail, whatever a parameter is."""

    def told(every: Evolutions) -> str:
        found = [value for one in every if (value := one.apart(name, counted=True)) is not None]
        alone = span(interval(found, np.median)) if len(found) >= EVOLUTIONS else "not known"
        return (
            f"runs that clean {_spread(every, 'good', name)}, others {_spread(every, 'poor', name)}; difference of "
            f"the means with hop counts alone {alone}, median of the {len(found)} evolutions with {SOME} such runs of "
            "both groups"
        )

    return told


def _best(*names: str) -> Told:
    """Medians of parameters of the best genomes, of a Boolean the number of genomes in which it is true."""

    def told(every: Evolutions) -> str:
        found = [(name.replace("_", "-"), [getattr(one.best, name) for one in every]) for name in names]
        return "best genomes " + ", ".join(
            f"{name} in {sum(v)} of {len(v)}" if isinstance(v[0], bool) else f"{name} {number(float(np.median(v)))}"
            for name, v in found
        )

    return told


def _medians(text: str, *points: Callable[[Evolution], float]) -> Told:
    """A text with the medians over evolutions of these values in its places."""
    return lambda every: text.format(*(f"{np.median([value(one) for one in every]):z.0f}" for value in points))


def _level(name: str, paper: float) -> Test:
    """A parameter is the paper's in runs that clean the arena."""
    return _median(
        lambda one: mean_of(one.good, lambda row: row[name]),
        lambda every: f"mean {_spread(every, 'good', name)}",
        paper - NEAR,
        paper + NEAR,
    )


def _equal(name: str) -> Test:
    """A parameter is equal in runs that clean the arena and in others."""
    return _median(lambda one: one.apart(name), _both(name), -NEAR, NEAR)


class Trait(NamedTuple):
    """What selection may act on."""

    what: str
    label: str
    """For axes."""
    value: Callable[[Evolution], float | None]
    limits: tuple[float, float | None] = (0.0, 1.0)
    """Of axes."""


def _weights(one: Evolution) -> float | None:
    dump, dust = one.late("weight_find_dump"), one.late("weight_find_dust")
    return None if dump is None or dust is None else dump - dust


TRAITS = (
    Trait("the density of robots", "density", lambda one: one.late("density_of_robots"), (0.0, None)),
    Trait("the fraction of scouts", "fraction of scouts", lambda one: one.late("fraction_scouts")),
    Trait("p(vector-forget)", "p(vector-forget)", lambda one: one.late("p_vector_forget")),
    Trait("the use of hop counts", "with hop counts", lambda one: one.late("use_hop_count")),
    Trait("the priority signal of loaded robots", "loaded signal", lambda one: one.late("priority_signal_loaded")),
    Trait("the priority signal of scouts", "scouts signal", lambda one: one.late("priority_signal_scouts")),
    Trait("weight-find-dump against weight-find-dust", "weights, dump minus dust", _weights, (-1.0, 1.0)),
    Trait(
        "the correlation of p(vector-forget) with scouts among the 250 fittest of generations 35 to 100",
        "r of forgetting and scouts",
        lambda one: one.trade,
        (-1.0, 1.0),
    ),
)
"""Means of the last generations, of Booleans those of the elites; but for the correlation."""


def trait_values(trait: Trait, sample: Evolutions) -> list[float]:
    """Values of a trait in the searches that have one."""
    return [value for value in map(trait.value, sample) if value is not None]


def _moved(trait: Trait) -> Statement:
    def test(samples: Samples) -> Judged | None:
        if not {"paper", "random"} <= samples.keys():
            return None
        pairs = {t.what: [trait_values(t, samples[name]) for name in ("paper", "random")] for t in TRAITS}
        mine = pairs[trait.what]
        ours = " against ".join(number(float(np.median(v))) if v else "no value" for v in mine) + " in random search"
        ours += f"; medians of {len(mine[0])} and {len(mine[1])} searches"
        tested = {what: compare(*pair) for what, pair in pairs.items() if min(map(len, pair)) >= EVOLUTIONS}
        if trait.what not in tested:
            return Judged(ours, f"{_ONE}needs {EVOLUTIONS} of both searches (--replicates)", TOO_FEW)
        result = tested[trait.what]
        adjusted = dict(zip(tested, holm([one.p for one in tested.values()]), strict=True))[trait.what]
        told = (
            f"of means of the last {LAST} generations, of shares of their elites, or of correlations; difference "
            f"{span(result.difference)}, Mann-Whitney p = {number(result.p, 2)}, {number(adjusted, 2)} by Holm for "
            f"{len(tested)} traits; holds if that is below {SURE} and the interval leaves out zero, else does not if "
            f"it lies within {NEAR}"
        )
        low, high = result.difference[1:]
        is_moved, is_near = adjusted < SURE and (low > 0 or high < 0), low >= -NEAR and high <= NEAR
        return Judged(ours, told, HOLDS if is_moved else FAILS if is_near else UNDECIDED)

    return Statement("evolution", f"Selection moves {trait.what}", NOT_IN_PAPER, "not studied", PREDICTED, test)


TESTS = {
    "rises": _median(
        lambda one: one.rise,
        _medians(
            f"best of a generation {{}} in the first, {{}} in the {RISE}th, {{}} at most; correlation with the "
            "generation",
            lambda one: one.bests[0],
            lambda one: one.bests[:RISE][-1],
            lambda one: one.bests.max(),
        ),
        low=0.5,
    ),
    "learns": _median(
        lambda one: one.gain,
        _medians(
            "mean fitness {} against {} points; difference",
            lambda one: one.final,
            lambda one: one.means[:FIRST].mean(),
        ),
        low=0.0,
        unit="points",
    ),
    "beats random": _against("random", True),
    "against CMA-ES": _against("cmaes", False),
    "as fit": _median(
        lambda one: float(one.bests.max()),
        lambda every: (
            f"{100 * np.median([one.bests.max() for one in every]) / FITNESS - 100:+.1f} % against the paper's"
        ),
        (1 - NEARLY) * FITNESS,
        (1 + NEARLY) * FITNESS,
        "points",
    ),
    "slow": _median(
        lambda one: one.early,
        lambda every: f"the earliest at step {min(row['finished_at'] for one in every for row in one.good)}",
        high=RARE,
        unit="%",
    ),
    "many fail": _median(
        lambda one: len(one.poor) / len(one.rows) if len(one.rows) >= GROUP else None,
        _of("rows", lambda one: len(one.poor)),
        low=0.2,
        unit="%",
    ),
    "counted": _median(
        lambda one: mean_of(one.good, lambda row: row["use_hop_count"]),
        _of("good", lambda one: sum(row["use_hop_count"] for row in one.good)),
        low=0.9,
        unit="%",
    ),
    "uncounted": _median(
        lambda one: mean_of(one.poor, lambda row: not row["use_hop_count"]),
        _of("poor", lambda one: sum(not row["use_hop_count"] for row in one.poor)),
        low=0.5,
        unit="%",
    ),
    # Half and twice the paper's 4 %.
    "exceptions": _median(
        lambda one: one.exceptions,
        _of("without", lambda one: sum(not row["use_hop_count"] for row in one.good)),
        0.02,
        0.08,
        "%",
    ),
    "scouts level": _level("fraction_scouts", 0.16),
    "forget level": _level("p_vector_forget", 0.28),
    "scouts equal": _equal("fraction_scouts"),
    "forget equal": _equal("p_vector_forget"),
    "trade": _median(lambda one: one.trade, lambda every: f"{sum(len(one.top) for one in every)} runs; r", high=0.0),
    # The range that section 4.6.2 calls optimal as a whole.
    "density level": _median(
        lambda one: one.density,
        lambda every: f"{_best('density_of_robots')(every)}; median of the last {LAST} generations",
        0.1,
        0.15,
        "%",
    ),
    "signals": _property(
        lambda best: best.priority_signal_loaded and not best.priority_signal_scouts,
        "priority_signal_loaded",
        "priority_signal_scouts",
    ),
    "weights": _median(
        lambda one: one.best.weight_find_dump - one.best.weight_find_dust,
        lambda every: f"{_best('weight_find_dump', 'weight_find_dust')(every)}; difference",
        low=0.0,
    ),
    "distances": _property(
        lambda best: best.empty_coll_avoid_dist > best.priority_coll_avoid_dist > best.loaded_coll_avoid_dist,
        "empty_coll_avoid_dist",
        "priority_coll_avoid_dist",
        "loaded_coll_avoid_dist",
    ),
}
STATEMENTS = [*stated(TESTS), *map(_moved, TRAITS)]
