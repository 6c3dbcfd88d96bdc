"""The judge of statements: intervals decide, by lying inside of limits, outside of them, or neither."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from iswarm_mj.experiments.analysis.findings import (
    ALPHA,
    FAILS,
    HOLDS,
    TOO_FEW,
    UNDECIDED,
    Judged,
    Rows,
    number,
    percent,
    span,
)
from iswarm_mj.experiments.analysis.measures import DUST, TIME, Measure, finished, quartiles, values
from iswarm_mj.experiments.analysis.statistics import (
    RESAMPLES,
    Comparison,
    Interval,
    Statistic,
    Values,
    compare,
    difference,
    holm,
    interval,
    lowest,
    share,
    smallest_p,
)

LEAST = 5
"""Runs of a group below which nothing is judged: a Mann-Whitney test of 4 and 4 runs cannot reach a level of 0.01, and
no exact interval of a share of 5 runs or fewer lies above one half."""
RARE = 0.05
"""Share of the runs up to which something counts as an exception."""
EQUAL = 0.1
"""Medians that differ by less than this share of them count as equal. Of the paper's 310 steps that is 31, which is 4 %
of its fitness; finishing times of types 1 and 2 scatter by 24 and 18 % (standard deviation of 96 runs each,
results/types), so that of single runs, as the paper compares them, less would not show."""
SURE = 0.95
"""Share of the bootstrap resamples, of which one less this is as sure of the opposite."""


class Estimate(NamedTuple):
    """What one group of runs, or one pair of groups, says on a statement that holds between two limits."""

    value: Interval
    n: tuple[int, ...]
    """Sizes of the groups."""
    low: float = -math.inf
    high: float = math.inf
    label: str = ""
    said: str = ""
    """What is told before the value."""
    tested: Comparison | None = None
    """Of two groups."""
    least: int = LEAST
    """Runs of a group that are needed."""

    @property
    def verdict(self) -> str:
        """HOLDS if the interval lies within the limits, FAILS if it lies outside of them, else UNDECIDED.

        Within limits on both sides of zero this is an equivalence test, as two one-sided tests at 2.5 % each. Ends that
        equal a limit but for rounding lie within it; of two groups of which one is to be larger an end at zero does
        not, so that no difference at all counts as none.
        """
        is_order = self.tested is not None and math.isinf(self.high - self.low)
        if (is_order and smallest_p(*self.n) >= ALPHA) or (not is_order and min(self.n) < self.least):
            return TOO_FEW
        ends = (self.low, self.high, self.value.low, self.value.high)
        low, high, least, most = (float(f"{end:.12g}") for end in ends)
        if is_order:
            low, high = float(np.nextafter(low, math.inf)), float(np.nextafter(high, -math.inf))
        if low <= least and most <= high:
            return HOLDS
        return FAILS if most < low or least > high else UNDECIDED


def all_of(verdicts: Iterable[str]) -> str:
    """Verdict on several statements together: FAILS if one does, HOLDS if all do; TOO_FEW before UNDECIDED."""
    found = set(verdicts)
    return next((verdict for verdict in (FAILS, TOO_FEW, UNDECIDED) if verdict in found), HOLDS)


def judged(
    estimates: Sequence[Estimate], what: str, unit: str = "", note: str = "", brief: bool = False
) -> Judged | None:
    """Judge a statement by the intervals of all its groups.

    Args:
        estimates: of the groups; of none nothing follows.
        what: the intervals are of.
        unit: of the values; shares are told in %.
        note: told beside the rule.
        brief: tell of the groups only that do not hold.
    """
    if not estimates:
        return None
    verdicts = [estimate.verdict for estimate in estimates]
    told = []
    for estimate, verdict in zip(estimates, verdicts, strict=True):
        text = f"{what} {percent(estimate.value) if unit == '%' else span(estimate.value, unit)}"
        if not brief or verdict != HOLDS:
            told.append(": ".join(filter(None, [estimate.label, ", ".join(filter(None, [estimate.said, text]))])))
    tests = [estimate.tested for estimate in estimates if estimate.tested]
    p = [f"{number(raw.p, 2)}" for raw in tests]
    if len(tests) > 1:
        adjusted = holm([test.p for test in tests])
        p = [f"{one} ({number(other, 2)})" for one, other in zip(p, adjusted, strict=True)]
    statistics = [
        f"Mann-Whitney U = {', '.join(number(test.u) for test in tests)}, two-sided p = {', '.join(p)}"
        if tests
        else "",
        f"in brackets adjusted by Holm for {len(tests)} tests" if len(tests) > 1 else "",
        "n = " + ", ".join(dict.fromkeys(" + ".join(map(str, estimate.n)) for estimate in estimates)),
        _rule(estimates, unit),
        note,
    ]
    if brief:
        told.insert(0, f"{verdicts.count(HOLDS)} of {len(verdicts)}" + ", not" * bool(told))
    return Judged("; ".join(told), "; ".join(filter(None, statistics)), all_of(verdicts))


def _rule(estimates: Sequence[Estimate], unit: str) -> str:
    """The rule of `Estimate.verdict` in words."""
    scale = 100 if unit == "%" else 1
    several = len(estimates) > 1
    limits = [
        " to ".join(f"{number(scale * end)} {unit}".rstrip() for end in (estimate.low, estimate.high))
        if math.isfinite(estimate.high - estimate.low)
        else ""
        for estimate in estimates
    ]
    low, high = estimates[0].low, estimates[0].high
    if all(limits):
        side = "within " + ", ".join(dict.fromkeys(limits))
    else:
        side = f"{'above' if math.isfinite(low) else 'below'} {number(scale * (low if math.isfinite(low) else high))}"
        side = f"{side} {unit}".rstrip()
    subject, one = ("all intervals lie", "one") if several else ("the interval lies", "it")
    kind = "equivalence test: " if all(limits) else ""
    return f"{kind}holds if {subject} {side}, does not if nothing of {one} does"


def differences(
    pairs: Mapping[str, tuple[Rows, Rows]],
    measure: Measure = TIME,
    names: tuple[str, str] | None = None,
    more: bool = True,
    margin: Callable[[Values, Values], float] | None = None,
    statistic: Statistic = np.median,
    note: str = "",
) -> Judged | None:
    """Judge whether the first group of each pair has the larger median, or an equal one.

    Args:
        pairs: of groups by labels; those without values are left out.
        measure: of which.
        names: of both groups, whose medians are told.
        more: whether the first is to be larger, else smaller.
        margin: from the values of both, the difference that counts as none; then they are to be equal.
        statistic: instead of the median, without a Mann-Whitney test.
        note: told beside the rule.
    """
    found = []
    for label, groups in pairs.items():
        first, second = (values(group, measure) for group in groups)
        if not len(first) or not len(second):
            continue
        said = ""
        if names:
            shown = quartiles if statistic is np.median else lambda v, unit: f"{number(float(np.mean(v)), 4)} {unit}"
            told = [f"{shown(v, measure.unit)} {name}" for v, name in zip((first, second), names, strict=True)]
            said = f"{'median' if statistic is np.median else 'mean'} {', '.join(told)}"
        if names and measure is TIME:
            reached = " and ".join(f"{finished(group)} of {len(group)}" for group in groups)
            said += f", {reached} runs reached {groups[0][0]['goal']} balls"
        tested = compare(first, second) if statistic is np.median else None
        value = tested.difference if tested else difference(first, second, statistic)
        apart = margin(first, second) if margin else math.inf
        low, high = (-apart, apart) if margin else (0.0, math.inf) if more else (-math.inf, 0.0)
        found.append(Estimate(value, (len(first), len(second)), low, high, label, said, tested))
    what = f"difference of the {'medians' if statistic is np.median else 'means'}"
    return judged(found, what, measure.unit, note)


def shares(
    counts: Mapping[str, tuple[int, int]],
    low: float = -math.inf,
    high: float = math.inf,
    said: Mapping[str, str] | None = None,
    note: str = "",
    brief: bool = False,
    least: int = LEAST,
    of: str = "runs",
) -> Judged | None:
    """Judge shares by their exact intervals.

    Args:
        counts: how many of how many, by labels.
        low: the shares are to lie above this.
        high: and below this.
        said: told of each.
        note: told beside the rule.
        brief: tell of the groups only that do not hold.
        least: runs that are needed.
        of: what is counted.
    """
    found = [
        Estimate(
            share(count, total, "exact"),
            (total,),
            low,
            high,
            label,
            f"{count} of {total} {of}{(said or {}).get(label, '')}",
            least=least,
        )
        for label, (count, total) in counts.items()
    ]
    return judged(found, "a share of", "%", note, brief)


def reaching(groups: Mapping[str, Rows], does: bool = True, tell: Measure = DUST, brief: bool = False) -> Judged | None:
    """Judge whether more than half of the runs of each group reach the goal, or do not."""
    if not groups:
        return None
    one = next(iter(groups.values()))[0]
    said = {label: f", median {quartiles(values(runs, tell), tell.unit)}" for label, runs in groups.items()}
    note = f"runs that deliver {one['goal']} balls in {one['max_steps']} steps"
    counts = {label: (finished(runs), len(runs)) for label, runs in groups.items()}
    low, high = (0.5, math.inf) if does else (-math.inf, 0.5)
    return shares(counts, low, high, said, note, brief)


def averages(
    samples: Mapping[str, Values],
    limits: Mapping[str, tuple[float, float]] | tuple[float, float],
    unit: str = "",
    statistic: Statistic = np.mean,
    said: Mapping[str, str] | None = None,
    note: str = "",
) -> Judged | None:
    """Judge whether means, or medians, lie within limits.

    Args:
        samples: by labels; empty ones are left out.
        limits: of each, or of all.
        unit: of the values.
        statistic: the mean or the median.
        said: told of each.
        note: told beside the rule.
    """
    found = [
        Estimate(
            interval(sample, statistic),
            (len(sample),),
            *(limits[label] if isinstance(limits, Mapping) else limits),
            label=label,
            said=(said or {}).get(label, ""),
        )
        for label, sample in samples.items()
        if len(sample)
    ]
    return judged(found, "median" if statistic is np.median else "mean", unit, note)


def optimum(groups: Mapping[float, Rows], measure: Measure, inside: tuple[float, float]) -> Judged | None:
    """Judge whether the group with the lowest median lies inside of a range, by bootstrap over the runs of all."""
    samples = {at: sample for at, rows in sorted(groups.items()) if len(sample := values(rows, measure))}
    if len({inside[0] <= at <= inside[1] for at in samples}) < 2:
        return None
    found = dict(zip(samples, lowest(list(samples.values())), strict=True))
    certain = sum(share for at, share in found.items() if inside[0] <= at <= inside[1])
    medians = {at: float(np.median(sample)) for at, sample in samples.items()}
    ours = f"lowest median at {min(medians, key=medians.__getitem__):g}; " + ", ".join(
        f"{at:g}: {number(median)}" for at, median in medians.items()
    )
    named = ", ".join(f"{at:g} in {100 * share:.0f} %" for at, share in found.items() if share >= 0.005)
    tested = (
        f"n = {', '.join(str(len(s)) for s in samples.values())}; the lowest median is at {named} of {RESAMPLES} "
        f"bootstrap resamples of the runs; holds if it lies inside in {100 * SURE:.0f} %, does not if in "
        f"{100 * (1 - SURE):.0f} % at most"
    )
    verdict = HOLDS if certain >= SURE else FAILS if certain <= 1 - SURE else UNDECIDED
    return Judged(f"{ours} {measure.unit}", tested, verdict if min(map(len, samples.values())) >= LEAST else TOO_FEW)


def always(count: int, total: int, what: str, ours: str, note: str = "", least: float = 0.9) -> Judged:
    """Judge whether all of `total` did something; HOLDS only if they are enough to show that `least` of such do."""
    found = share(count, total, "exact")
    tested = (
        f"{percent(found)}, exact; holds if {what}, in so many trials that the interval is no wider than "
        f"{100 * (1 - least):.0f} %, does not otherwise"
    )
    verdict = FAILS if count < total else HOLDS if found.low >= least else TOO_FEW
    return Judged(ours, f"{tested}; {note}" if note else tested, verdict)
