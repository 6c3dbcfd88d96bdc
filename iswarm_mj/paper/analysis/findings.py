"""Findings on statements: the paper's value, ours, the statistics, the verdict and its kind."""

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from typing import Any, NamedTuple

from iswarm_mj.utils.intervals import Interval

HOLDS = "holds"
FAILS = "does not hold"
UNDECIDED = "undecided"
NOT_RUN = "not run yet"
TOO_FEW = "too few runs to judge"
NOT_IN_PAPER = "not in the paper"
"""Source of a statement that the paper does not make."""
ALPHA = 0.01
"""Level below which a p-value is mentioned; verdicts follow from intervals."""

PREDICTED = "predicted"
FITTED = "fitted"
CONSTRUCTED = "by construction"
SLIP = "the paper's slip"
NOT_COMPARABLE = "not comparable"
KINDS = {
    PREDICTED: "follows from the model's rules; no value was set with the statement alone in view "
    "(the default's distance of the dust was chosen by Figs. 15 and 17 and Table 2 together)",
    FITTED: "a value was set so that it holds, or was selected by the measure that it is about",
    CONSTRUCTED: "put in, or algebra: it could not have come out otherwise",
    SLIP: "on the paper's own arithmetic, or on an equation of it outside of the range for which "
    "it is stated",
    NOT_COMPARABLE: "what is measured here is not what the paper measured, or depends on the "
    "computer",
}
"""Meanings of the kinds of statements: what a verdict on them is worth."""


class Finding(NamedTuple):
    """A statement and the verdict on it."""

    claim: str
    """The statement."""
    source: str
    """Place in the paper, or NOT_IN_PAPER."""
    paper: str
    """The paper's value."""
    kind: str
    """One of `KINDS`; for statements that the experiment `infer` uses also whether it selects by
    them or holds them out."""
    ours: str = ""
    """Our value; empty without results."""
    statistics: str = ""
    """Test, sample sizes, intervals, and the rule for the verdict."""
    verdict: str = NOT_RUN
    """One of HOLDS, FAILS, UNDECIDED, TOO_FEW and NOT_RUN; empty for a number that is reported
    without a verdict."""


class Judgement(NamedTuple):
    """The outcome of a test: the fields of a `Finding` that depend on results."""

    ours: str
    statistics: str
    verdict: str = ""


Test = Callable[[Any], Judgement | None]
"""Judges results: rows, or searches by their methods; returns None where they say nothing."""


class Statement(NamedTuple):
    """A statement of the paper, or one beyond it, and how it is judged."""

    study: str
    """Study whose results it is about."""
    claim: str
    """The statement."""
    source: str
    """Place in the paper, or NOT_IN_PAPER."""
    paper: str
    """The paper's value."""
    kind: str
    """Kind of the statement, as in `Finding`."""
    note: str
    """Remark on the test or the verdict; it ends the statistics of the finding."""
    test: Test
    """Judges the results."""

    def finding(self, results: Any) -> Finding:
        """Return the finding; results that are empty or None count as not run yet."""
        finding = Finding(self.claim, self.source, self.paper, self.kind)
        judgement = self.test(results) if results else None
        if judgement is None:
            return finding

        statistics = filter(None, (judgement.statistics, self.note))
        return finding._replace(
            ours=judgement.ours, statistics="; ".join(statistics), verdict=judgement.verdict
        )


def _read_statements() -> dict[str, dict[str, str]]:
    """Return the fields of the paper's statements, without their tests, by the tests' names."""
    table = files("iswarm_mj.paper.analysis").joinpath("statements.csv")
    fields_of = {}
    for row in csv.DictReader(table.read_text(encoding="utf-8").splitlines()):
        test_name = row.pop("test")
        role = row.pop("role")
        row["kind"] = ", ".join(filter(None, (row["kind"], role)))
        fields_of[test_name] = row
    return fields_of


_PAPER_STATEMENTS = _read_statements()


def paper_statements(tests: Mapping[str, Test]) -> list[Statement]:
    """Return the statements of statements.csv that these tests judge, by the tests' names there."""
    return [Statement(**_PAPER_STATEMENTS[name], test=test) for name, test in tests.items()]


def claim_of(test_name: str) -> str:
    """Return the paper's statement that the test of this name in statements.csv judges."""
    return _PAPER_STATEMENTS[test_name]["claim"]


def added_statement(study: str, claim: str, test: Test) -> Statement:
    """Return a statement on a question that the paper does not study."""
    return Statement(study, claim, NOT_IN_PAPER, "not studied", PREDICTED, "", test)


def findings_on(statements: Sequence[Statement], study: str, results: Any) -> list[Finding]:
    """Return the findings on the statements of a study."""
    return [statement.finding(results) for statement in statements if statement.study == study]


def number_text(value: float, digits: int = 3) -> str:
    """Return a number as text, rounded to a number of significant digits.

    From 0.001 to a million it has no exponent, no trailing zeros, and all digits before the point:
    123456. Others have an exponent: 1.00e-05. Infinity is "inf" and nan "undefined".

    Args:
        value: the number.
        digits: number of significant digits, at least 1.
    """
    if math.isnan(value):
        return "undefined"
    if value == 0:
        return "0"
    if not 1e-3 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"

    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    text = f"{value:.{places}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def interval_text(value: Interval, unit: str = "", digits: int = 3) -> str:
    """Return an estimate with its interval, if it has one.

    Shares, with the unit %, are multiplied by 100: 3.1 V (2.8 to 3.4), 43 % (38 to 48).
    """
    factor = 100 if unit == "%" else 1
    estimate, low, high = (number_text(factor * number, digits) for number in value)
    text = f"{estimate} {unit}".rstrip()
    return text if math.isnan(value.low) else f"{text} ({low} to {high})"
