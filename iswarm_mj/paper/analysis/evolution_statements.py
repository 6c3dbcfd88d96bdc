"""Statements of section 4.6.1 on evolutions (Fig. 14, Table 2), and on searches beyond the paper.

One evolution is one sample, see `evolution`. Each statement is on the median over evolutions of a
quantity of one, or on how many of them have a property; intervals are over evolutions.

All are predicted but four. What a dependent mutation does to a Boolean was chosen by the paper's
number of swarms without hop counts (`search.methods.Operators.boolean_mutation`), and most of these
fail: so many swarms fail, and most of those that fail lost hop counts by chance, whatever their
other parameters are, so that these are nearly equal in swarms that clean the arena and in others.

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
from iswarm_mj.paper.analysis.findings import (
    Judgement,
    Statement,
    Test,
    added_statement,
    interval_text,
    number_text,
    paper_statements,
)
from iswarm_mj.paper.analysis.judge import (
    FITNESS_MARGIN,
    RARE_SHARE,
    Estimate,
    judge_estimates,
    judge_shares,
)
from iswarm_mj.paper.analysis.measures import PAPER_FITNESS
from iswarm_mj.paper.analysis.statistics import compare, holm
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.intervals import Interval, interval

MIN_EVOLUTIONS = 6
"""Minimum number of evolutions over which anything is judged: of five or fewer, not even the range
from the least to the greatest is an interval of the median at 95 %, as 2 / 2^5 = 6 %."""
PARAMETER_MARGIN = 0.05
"""Margin of the equivalence tests on parameters of swarms: the largest step of the paper's
dependent mutation. Means that differ by less are within one mutation of each other, so that no
evolution of this kind tells them apart. Of shares of the elites, one in twenty."""
TRAIT_LEVEL = 0.05
"""Level of the p-values adjusted for the number of traits: without the adjustment, one of 20 traits
that are not moved would seem so."""
BEST_FITNESS = max(PAPER_FITNESS.values())
"""Fitness of the paper's fittest swarm [points]."""
Samples = Mapping[str, Evolutions]
"""Searches by method: "paper", "random" and "cmaes" as far as they are there."""
Value = Callable[[Evolution], float | None]
"""A quantity of one evolution; None if it is too short, or a group has too few runs."""


def _judge_median(
    value: Value, samples: Samples, low: float = -math.inf, high: float = math.inf, unit: str = ""
) -> Judgement | None:
    """Judge whether the median of a quantity over evolutions lies within limits.

    The median of fewer than `MIN_EVOLUTIONS` has no interval.
    """
    if "paper" not in samples:
        return None
    numbers = _known_values(value, samples["paper"])
    if not numbers:
        return Judgement("no value", "evolutions are too short, or lack runs", f.TOO_FEW)

    median = interval(numbers, np.median)
    if len(numbers) < MIN_EVOLUTIONS:
        median = Interval(median.estimate, math.nan, math.nan)

    # Shares are written in per cent.
    factor = 100 if unit == "%" else 1
    smallest = number_text(factor * min(numbers))
    largest = number_text(factor * max(numbers))
    estimate = Estimate(
        median,
        sizes=(len(numbers),),
        low=low,
        high=high,
        prefix=f"{smallest} to {largest}, median ",
        min_runs=MIN_EVOLUTIONS,
    )
    return judge_estimates([estimate], f"medians over {len(samples['paper'])} evolutions", unit)


def _known_values(value: Value, evolutions: Evolutions) -> list[float]:
    """Return a quantity of those evolutions that have it."""
    numbers = map(value, evolutions)
    return [number for number in numbers if number is not None]


def _judge_property(has_property: Callable[[Genome], bool], samples: Samples) -> Judgement | None:
    """Judge whether the best genomes of most evolutions have a property."""
    if "paper" not in samples:
        return None
    evolutions = samples["paper"]
    count = sum(has_property(evolution.best) for evolution in evolutions)
    return judge_shares({"": (count, len(evolutions))}, (0.5, math.inf), MIN_EVOLUTIONS)


def _judge_against(method: str, samples: Samples, *, gives_verdict: bool) -> Judgement | None:
    """Judge whether the best runs of the evolutions are fitter than those of another method.

    Args:
        method: the other method.
        samples: searches by method.
        gives_verdict: give a verdict; otherwise the difference is reported without one.
    """
    if "paper" not in samples or method not in samples:
        return None
    ours = [evolution.best_runs_fitness for evolution in samples["paper"]]
    theirs = [evolution.best_runs_fitness for evolution in samples[method]]

    comparison = compare(ours, theirs)
    estimate = Estimate(
        comparison.difference,
        sizes=(len(ours), len(theirs)),
        low=0.0,
        prefix=f"{np.median(ours):z.0f} against {np.median(theirs):z.0f}, difference ",
        comparison=comparison,
    )
    judgement = judge_estimates([estimate], "medians", "points")
    if judgement is None:
        return None
    if not gives_verdict:
        return judgement._replace(verdict="")
    if min(estimate.sizes) < MIN_EVOLUTIONS:
        return judgement._replace(verdict=f.TOO_FEW)
    return judgement


def _judge_level(name: str, paper: float, samples: Samples) -> Judgement | None:
    """Judge whether a parameter is the paper's in runs that clean the arena."""

    def level(evolution: Evolution) -> float | None:
        return mean_of(evolution.cleaning_runs, lambda row: row[name])

    return _judge_median(level, samples, paper - PARAMETER_MARGIN, paper + PARAMETER_MARGIN)


def _judge_equal(name: str, samples: Samples) -> Judgement | None:
    """Judge whether a parameter is equal in runs that clean the arena and in others.

    The difference in runs with hop counts alone is reported beside it.
    """

    def judge(*, with_hop_counts: bool) -> Judgement | None:
        def difference(evolution: Evolution) -> float | None:
            return evolution.cleaning_difference(name, with_hop_counts=with_hop_counts)

        return _judge_median(difference, samples, -PARAMETER_MARGIN, PARAMETER_MARGIN)

    all_runs = judge(with_hop_counts=False)
    counting_runs = judge(with_hop_counts=True)
    if all_runs is None or counting_runs is None:
        return None
    return all_runs._replace(ours=f"{all_runs.ours}; with hop counts alone {counting_runs.ours}")


def _late(name: str) -> Value:
    """Return the mean of a parameter in the last generations, as a quantity of an evolution."""
    return lambda evolution: evolution.late_mean(name)


def _weight_difference(evolution: Evolution) -> float | None:
    """Return how much heavier finding the dump weighs than finding dust, at the end."""
    dump = evolution.late_mean("weight_find_dump")
    dust = evolution.late_mean("weight_find_dust")
    if dump is None or dust is None:
        return None
    return dump - dust


_forgetting_against_scouts: Value = attrgetter("forgetting_against_scouts")
TRAITS: Mapping[str, Value] = {
    "the density of robots": _late("density_of_robots"),
    "the fraction of scouts": _late("fraction_scouts"),
    "p(vector-forget)": _late("p_vector_forget"),
    "the use of hop counts": _late("use_hop_count"),
    "the priority signal of loaded robots": _late("priority_signal_loaded"),
    "the priority signal of scouts": _late("priority_signal_scouts"),
    "weight-find-dump against weight-find-dust": _weight_difference,
    "the correlation of p(vector-forget) with scouts among the 250 fittest of generations 35 to "
    "100": _forgetting_against_scouts,
}
"""Traits that selection may move: means of the last generations, of Booleans those of the elites;
and a correlation."""


def _judge_moved(trait: str, samples: Samples) -> Judgement | None:
    """Judge whether selection moved a trait: whether it differs from that of random search.

    The test is corrected for the number of traits.
    """
    if "paper" not in samples or "random" not in samples:
        return None
    pairs = {
        name: (_known_values(value, samples["paper"]), _known_values(value, samples["random"]))
        for name, value in TRAITS.items()
    }
    evolved, random = pairs[trait]
    medians = f"{_median_text(evolved)} against {_median_text(random)}"

    # Compare all traits that enough searches have, for the correction.
    comparisons = {
        name: compare(*pair)
        for name, pair in pairs.items()
        if min(map(len, pair)) >= MIN_EVOLUTIONS
    }
    if trait not in comparisons:
        needed = f"needs {MIN_EVOLUTIONS} of both searches (--replicates)"
        return Judgement(medians, needed, f.TOO_FEW)
    p_values = holm([comparison.p for comparison in comparisons.values()])
    p = dict(zip(comparisons, p_values, strict=True))[trait]

    rule = (
        f"medians, n = {len(evolved)} + {len(random)}; Mann-Whitney, by Holm p = "
        f"{number_text(p, 2)}; holds if that is below {TRAIT_LEVEL} and the interval leaves out "
        f"zero, else does not if it lies within {PARAMETER_MARGIN}"
    )
    difference = comparisons[trait].difference
    ours = f"{medians} in random search, difference {interval_text(difference)}"
    return Judgement(ours, rule, _verdict_on_move(p, difference))


def _verdict_on_move(p: float, difference: Interval) -> str:
    """Return the verdict on whether a trait was moved.

    It was not if its interval is narrow enough to show that.
    """
    if p < TRAIT_LEVEL and (difference.low > 0 or difference.high < 0):
        return f.HOLDS
    if difference.low >= -PARAMETER_MARGIN and difference.high <= PARAMETER_MARGIN:
        return f.FAILS
    return f.UNDECIDED


def _median_text(numbers: list[float]) -> str:
    """Return the median as text; "no value" without numbers."""
    return number_text(float(np.median(numbers))) if numbers else "no value"


def _share_of_cleaning(evolution: Evolution) -> float | None:
    """Return the share of the runs that clean the arena which have hop counts."""
    return mean_of(evolution.cleaning_runs, lambda row: row["use_hop_count"])


def _share_of_others(evolution: Evolution) -> float | None:
    """Return the share of the runs that do not clean the arena which have no hop counts."""
    return mean_of(evolution.other_runs, lambda row: not row["use_hop_count"])


def _best_fitness(evolution: Evolution) -> float:
    """Return the fitness of the fittest run."""
    return float(evolution.bests.max())


def _best_weight_difference(evolution: Evolution) -> float:
    """Return how much heavier finding the dump weighs than finding dust, in the best genome."""
    return evolution.best.weight_find_dump - evolution.best.weight_find_dust


def _signals_as_the_paper(best: Genome) -> bool:
    """Return whether loaded robots signal priority and scouts do not."""
    return best.priority_signal_loaded and not best.priority_signal_scouts


def _avoids_as_the_paper(best: Genome) -> bool:
    """Return whether empty robots avoid others from farthest, and loaded ones from nearest."""
    return best.empty_coll_avoid_dist > best.priority_coll_avoid_dist > best.loaded_coll_avoid_dist


TESTS: Mapping[str, Test] = {
    "rises": partial(_judge_median, attrgetter("rise"), low=0.5),
    "learns": partial(_judge_median, attrgetter("gain"), low=0.0, unit="points"),
    "beats random": partial(_judge_against, "random", gives_verdict=True),
    "against CMA-ES": partial(_judge_against, "cmaes", gives_verdict=False),
    "as fit": partial(
        _judge_median,
        _best_fitness,
        low=(1 - FITNESS_MARGIN) * BEST_FITNESS,
        high=(1 + FITNESS_MARGIN) * BEST_FITNESS,
        unit="points",
    ),
    "slow": partial(_judge_median, attrgetter("early_share"), high=RARE_SHARE, unit="%"),
    "many fail": partial(_judge_median, attrgetter("failing_share"), low=0.2, unit="%"),
    "counted": partial(_judge_median, _share_of_cleaning, low=0.9, unit="%"),
    "uncounted": partial(_judge_median, _share_of_others, low=0.5, unit="%"),
    "exceptions": partial(
        _judge_median, attrgetter("exception_share"), low=0.02, high=0.08, unit="%"
    ),
    "scouts level": partial(_judge_level, "fraction_scouts", 0.16),
    "forget level": partial(_judge_level, "p_vector_forget", 0.28),
    "scouts equal": partial(_judge_equal, "fraction_scouts"),
    "forget equal": partial(_judge_equal, "p_vector_forget"),
    "trade": partial(_judge_median, _forgetting_against_scouts, high=0.0),
    "density level": partial(_judge_median, attrgetter("density"), low=0.1, high=0.15, unit="%"),
    "signals": partial(_judge_property, _signals_as_the_paper),
    "weights": partial(_judge_median, _best_weight_difference, low=0.0),
    "distances": partial(_judge_property, _avoids_as_the_paper),
}
"""Tests of the paper's statements, by their names in statements.csv."""
STATEMENTS: list[Statement] = [
    *paper_statements(TESTS),
    *(
        added_statement("evolution", f"Selection moves {trait}", partial(_judge_moved, trait))
        for trait in TRAITS
    ),
]
