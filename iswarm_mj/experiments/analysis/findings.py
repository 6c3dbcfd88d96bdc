"""Findings on statements: the paper's value, ours, the statistics, whether the statement holds, and what that tells."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from iswarm_mj.experiments.analysis.statistics import Comparison, Interval, smallest_p

HOLDS, FAILS, UNDECIDED, NOT_RUN = "holds", "does not hold", "undecided", "not run yet"
TOO_FEW = "too few runs to judge"
NOT_IN_PAPER = "not in the paper"
"""Source of a statement that the paper does not make."""
ALPHA = 0.01
"""Level below which a p-value is named; verdicts follow from intervals."""

PREDICTED, FITTED, CONSTRUCTED = "predicted", "fitted", "by construction"
SLIP, NOT_COMPARABLE = "the paper's slip", "not comparable"
KINDS = {
    PREDICTED: "follows from the model's rules; no value was set with the statement alone in view (the default's "
    "distance of the dust was chosen by Figs. 15 and 17 and Table 2 together)",
    FITTED: "a value was set so that it holds, or was selected by the measure that it is about",
    CONSTRUCTED: "put in, or algebra: it could not have come out otherwise",
    SLIP: "on the paper's own arithmetic, or on an equation of it outside of the range for which it is stated",
    NOT_COMPARABLE: "what is measured here is not what the paper measured, or depends on the computer",
}
"""What a verdict on a statement is worth: the kinds and their meanings."""

Row = Mapping[str, Any]
Rows = Sequence[Row]


class Finding(NamedTuple):
    """A statement and the verdict on it."""

    claim: str
    source: str
    """Place in the paper, or a note that the paper does not say so."""
    paper: str
    """The paper's value."""
    kind: str
    """What the verdict is about, one of `KINDS`."""
    ours: str
    """Our value; empty without results."""
    statistics: str
    """Test, sample sizes, intervals, and the rule for the verdict."""
    verdict: str
    """One of HOLDS, FAILS, UNDECIDED, TOO_FEW and NOT_RUN; empty for a number that is reported without a verdict."""


class Claim(NamedTuple):
    """A statement to be judged."""

    text: str
    source: str
    paper: str
    kind: str
    """What a verdict on it is about, one of `KINDS`."""

    def found(self, ours: str, statistics: str, verdict: str | bool) -> Finding:
        """Return the finding; the verdict may be a Boolean."""
        if not isinstance(verdict, str):
            verdict = HOLDS if verdict else FAILS
        return Finding(*self, ours, statistics, verdict)

    def not_run(self) -> Finding:
        """Return the finding for missing results."""
        return Finding(*self, "", "", NOT_RUN)


def verdict_of(comparison: Comparison, is_larger: bool) -> str:
    """Whether the first group's median is larger (smaller, if not `is_larger`), by the interval of the difference.

    HOLDS if the interval lies above zero, FAILS if nothing of it does, so that no difference at all counts as none;
    TOO_FEW if the groups are too small for any test to reach `ALPHA`.
    """
    if smallest_p(comparison.n_first, comparison.n_second) >= ALPHA:
        return TOO_FEW
    ends = comparison.difference.low, comparison.difference.high
    low, high = ends if is_larger else (-ends[1], -ends[0])
    return HOLDS if low > 0 else FAILS if high <= 0 else UNDECIDED


def rule_of(is_larger: bool) -> str:
    """The rule of `verdict_of` in words."""
    side = "above" if is_larger else "below"
    return f"holds if the interval lies {side} zero, does not if nothing of it does"


def number(value: float, digits: int = 3) -> str:
    """A number with `digits` significant digits, without an exponent if it has at most six places."""
    if math.isnan(value):
        return "undefined"
    if value == 0 or 1e-3 <= abs(value) < 1e6:
        places = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
        text = f"{value:z.{places}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.{digits - 1}e}"


def span(value: Interval, unit: str = "", digits: int = 3) -> str:
    """An estimate with its interval: 3.1 (95 % interval 2.8 to 3.4) V."""
    tail = f" {unit}" if unit else ""
    return f"{number(value.estimate, digits)}{tail} (95 % interval {number(value.low, digits)} to " + (
        f"{number(value.high, digits)})"
    )


def percent(value: Interval) -> str:
    """A share with its interval, in percent."""
    ends = [f"{100 * v:.1f}" for v in value]
    return f"{ends[0]} % (95 % interval {ends[1]} to {ends[2]} %)"


def in_words(comparison: Comparison, unit: str = "") -> str:
    """A comparison in words."""
    return (
        f"Mann-Whitney U = {number(comparison.u)}, two-sided p = {number(comparison.p, 2)}, "
        f"n = {comparison.n_first} + {comparison.n_second}; difference of the medians "
        f"{span(comparison.difference, unit)}"
    )
