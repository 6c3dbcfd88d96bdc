"""Findings on statements: the paper's value, ours, the statistics, whether the statement holds, and
what that tells."""

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from typing import Any, NamedTuple

from iswarm_mj.paper.analysis.statistics import Interval

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


class Finding(NamedTuple):
    """A statement and the verdict on it."""

    claim: str
    source: str
    """Place in the paper, or a note that the paper does not say so."""
    paper: str
    """The paper's value."""
    kind: str
    """What the verdict is about, one of `KINDS`; of what `infer` asks also whether it selects or is
    held out."""
    ours: str = ""
    """Our value; empty without results."""
    statistics: str = ""
    """Test, sample sizes, intervals, and the rule for the verdict."""
    verdict: str = NOT_RUN
    """One of HOLDS, FAILS, UNDECIDED, TOO_FEW and NOT_RUN; empty for a number that is reported
    without a verdict."""


class Judged(NamedTuple):
    """What results say on a statement; the fields of `Finding`."""

    ours: str
    statistics: str
    verdict: str = ""


Test = Callable[[Any], Judged | None]


class Statement(NamedTuple):
    """A statement of the paper, or one beyond it, and how it is judged."""

    study: str
    """Whose results it is about."""
    claim: str
    source: str
    paper: str
    kind: str
    """As in `Finding`."""
    note: str
    """What is to be known of the test or the verdict; ends the statistics of the finding."""
    test: Test
    """Of the results: rows, or for evolutions samples by methods; None where they have nothing on
    it."""

    def finding(self, results: Any) -> Finding:
        """Return the finding; results that are empty, or None, were not made."""
        judged = self.test(results) if results else None
        if judged:
            judged = judged._replace(
                statistics="; ".join(filter(None, (judged.statistics, self.note)))
            )
        return Finding(*self[1:5], *(judged or ()))


_TABLE = files("iswarm_mj.paper.analysis").joinpath("statements.csv").read_text(encoding="utf-8")
_WORDS = {row.pop("test"): row for row in csv.DictReader(_TABLE.splitlines())}
"""Study, claim, source, the paper's value, kind, role and note by the names of tests."""
for _row in _WORDS.values():
    _row["kind"] = ", ".join(filter(None, (_row["kind"], _row.pop("role"))))


def named(study: str) -> list[str]:
    """Names of the tests of a study in the table."""
    return [name for name, words in _WORDS.items() if words["study"] == study]


def stated(tests: Mapping[str, Test]) -> list[Statement]:
    """Statements that these tests judge, by their names in the table beside this file, which has
    the words."""
    return [Statement(**_WORDS[name], test=test) for name, test in tests.items()]


def findings_on(statements: Sequence[Statement], study: str, results: Any) -> list[Finding]:
    """Findings on the statements of a study."""
    return [one.finding(results) for one in statements if one.study == study]


def added(study: str, claim: str, test: Test) -> Statement:
    """Statement that the paper does not make, on a question that it does not study."""
    return Statement(study, claim, NOT_IN_PAPER, "not studied", PREDICTED, "", test)


def number(value: float, digits: int = 3) -> str:
    """A number with `digits` significant digits, without an exponent if it has at most six
    places."""
    if math.isnan(value):
        return "undefined"
    if value == 0 or 1e-3 <= abs(value) < 1e6:
        places = max(0, digits - 1 - math.floor(math.log10(abs(value)))) if value else 0
        text = f"{value:z.{places}f}"
        return text.rstrip("0").rstrip(".") if "." in text else text
    return f"{value:.{digits - 1}e}"


def short(value: Interval, unit: str = "", digits: int = 3) -> str:
    """An estimate with its interval, if it has one: 3.1 V (2.8 to 3.4); shares as 43 % (38 to
    48)."""
    estimate, low, high = (number(100 * end if unit == "%" else end, digits) for end in value)
    shown = f"{estimate} {unit}".rstrip()
    return shown if math.isnan(value.low) else f"{shown} ({low} to {high})"
