"""Cards of the page that has our figures beside the paper's values, with a verdict for each."""

import csv
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.resources import files
from operator import attrgetter
from typing import NamedTuple

from iswarm_mj.config.static import MESSAGE_BITS
from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.robot_file import read_robots
from iswarm_mj.paper.analysis.choice_effects import effects_of_choices
from iswarm_mj.paper.analysis.findings import (
    FAILS,
    HOLDS,
    NOT_IN_PAPER,
    UNDECIDED,
    Finding,
    claim_of,
)
from iswarm_mj.paper.report.paper_figures import (
    FIGURES,
    TABLE_1,
    PaperFigure,
    TableOneRow,
)
from iswarm_mj.paper.report.results import Topic
from iswarm_mj.search.rows import Rows

DIRECTORY = "beside-paper"
"""Directory of the figures, below that of the results."""


class _Line(NamedTuple):
    """What a card says on a statement."""

    claim: str
    """The statement, as findings have it."""
    statement: str
    """The statement in a few words."""
    reason: str
    """Why it does not hold, or is undecided; empty where nothing is known or needed."""


def _read_lines() -> dict[str, list[_Line]]:
    """Return the lines of each card by the names of figures."""
    table = files("iswarm_mj.paper.report").joinpath("beside_paper.csv")
    lines: dict[str, list[_Line]] = {}
    for row in csv.DictReader(table.read_text(encoding="utf-8").splitlines()):
        line = _Line(claim_of(row["test"]), row["statement"], row["reason"])
        lines.setdefault(row["figure"], []).append(line)
    return lines


_LINES = _read_lines()


def tally(topics: Sequence[Topic]) -> str:
    """Return a sentence: how many of the paper's statements hold, and how many do not."""
    verdicts = [
        finding.verdict
        for topic in topics
        for finding in topic.findings
        if finding.source != NOT_IN_PAPER
    ]
    n_hold = verdicts.count(HOLDS)
    n_fail = verdicts.count(FAILS)
    sentence = f"**{n_hold}** of {len(verdicts)} statements of the paper hold, {n_fail} do not"
    if n_hold + n_fail < len(verdicts):
        sentence += "; the others are undecided"
    return f"{sentence}."


def cards(topics: Sequence[Topic], directory: str) -> str:
    """Return a card for each figure that has results: the figure, the verdict, and what misses.

    Args:
        topics: topics with results.
        directory: directory of the results, relative to the root of the repository.
    """
    results = {result.name for topic in topics for result in topic.results}
    findings = {finding.claim: finding for topic in topics for finding in topic.findings}
    rows = {topic.name: topic.data for topic in topics}

    texts = []
    for figure in FIGURES:
        if results >= set(figure.needs):
            picture = f"![{figure.title}](../{directory}/{DIRECTORY}/{figure.name}.svg)"
            if figure.name == "table-1":
                verdict = _verdict_on_table_1(rows["sensitivity"])
            else:
                verdict = _verdict_on(figure, findings)
            parts = [f"**{figure.title}**", picture, verdict]
            texts.append("-   " + "\n\n    ".join(parts))
    return '<div class="grid cards beside" markdown>\n\n' + "\n\n".join(texts) + "\n\n</div>"


def _verdict_on(figure: PaperFigure, findings: Mapping[str, Finding]) -> str:
    """Return the verdict on a figure in a sentence, and a line for each statement that misses."""
    lines = _LINES[figure.name]
    verdicts = [findings[line.claim].verdict for line in lines]
    if set(verdicts) == {HOLDS}:
        held = "; ".join(line.statement[0].lower() + line.statement[1:] for line in lines)
        number = "Both" if len(lines) == 2 else f"All {len(lines)}"
        return f"**{number} statements hold**: {held}."

    # Statements with one verdict for one reason share a line.
    missing: dict[tuple[str, str], list[str]] = {}
    for line, verdict in zip(lines, verdicts, strict=True):
        if verdict != HOLDS:
            missing.setdefault((verdict, line.reason), []).append(f"*{line.statement}*")
    misses = [
        f"- {'; '.join(statements)}: {_verdict_text(verdict, len(statements))}. {reason}".rstrip()
        for (verdict, reason), statements in missing.items()
    ]
    sentence = f"**Of {len(lines)} statements {_counts_text(verdicts)}.**"
    return f"{sentence}\n\n    " + "\n    ".join(misses)


def _verdict_text(verdict: str, number: int) -> str:
    """Return a verdict on a number of statements as text."""
    return "do not hold" if verdict == FAILS and number > 1 else verdict


def _counts_text(verdicts: Sequence[str]) -> str:
    """Return how many statements hold, do not hold and are undecided, as words."""
    count = Counter(verdicts)
    texts = [_count_text(count[HOLDS], "holds", "hold")]
    if count[FAILS]:
        texts.append(_count_text(count[FAILS], "does not", "do not"))
    if count[UNDECIDED]:
        texts.append(_count_text(count[UNDECIDED], "is undecided", "are undecided"))
    n_others = len(verdicts) - count[HOLDS] - count[FAILS] - count[UNDECIDED]
    if n_others:
        texts.append(_count_text(n_others, "is not judged", "are not judged"))
    return ", ".join(texts)


def _count_text(number: int, singular: str, plural: str) -> str:
    """Return a number and its verb."""
    return f"{number} {singular if number == 1 else plural}"


def _verdict_on_table_1(rows: Rows) -> str:
    """Return the verdict on Table 1: whether its values are the defaults, and what others do."""
    changed = _changed_values(TABLE_1)
    if changed:
        sentence = f"**Not the defaults here: {', '.join(changed)}.**"
    else:
        sentence = f"**All {len(TABLE_1)} values are used unchanged.**"

    choices = {row.setting for row in TABLE_1}
    effects = [effect for effect in effects_of_choices(rows) if effect.choice in choices]
    if not effects:
        return sentence

    smallest_p = min(effect.adjusted_p for effect in effects)
    if smallest_p < 0.05:
        return (
            f"{sentence} Other values change the time to the goal "
            f"(least p by Holm {smallest_p:.2g})."
        )
    return (
        f"{sentence} Of {len(effects)} other values none changes the time to the goal clearly "
        "(bars: 95 % intervals; all p above 0.05 by Holm)."
    )


def _changed_values(table: Sequence[TableOneRow]) -> list[str]:
    """Return the names of those lines of Table 1 whose values are not the defaults here."""
    config = SwarmConfig()
    bearings = read_robots(None).sides.led_bearings
    value_of_robot = {
        "Number-of-LEDs": len(bearings),
        "Inter-LED-angle": math.degrees(bearings[1] - bearings[0]),
        "Communication-capacity": MESSAGE_BITS,
    }

    names = []
    for row in table:
        used = attrgetter(row.setting)(config) if row.setting else value_of_robot[row.name]
        if not math.isclose(used, row.value):
            names.append(row.name)
    return names
