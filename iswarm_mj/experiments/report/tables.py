"""Blocks of Markdown pages that are written from results; nothing outside of them is touched.

A block begins with a line `<!-- DIRECTORY: NAME -->`, where the directory is `results` or another one whose name begins
so, and the name a topic or one of `OF_ALL`; it ends with a line `<!-- end -->`. `<!-- DIRECTORY: NAME beside OTHER -->`
has the results of two directories, such as those of two configurations.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from iswarm_mj.experiments.analysis.findings import FAILS, NOT_COMPARABLE, NOT_IN_PAPER, UNDECIDED, Finding
from iswarm_mj.experiments.report.markdown import table
from iswarm_mj.experiments.report.numbers import TABLES, engines, evolution
from iswarm_mj.experiments.report.results import (
    EVOLUTION,
    LAWS,
    TITLES,
    Topic,
    collect,
    searches_of,
    tally,
    topics_of,
)
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import read_text

_MARK = re.compile(r"^<!-- (?:end |(results[\w./-]*): *([\w-]+)(?: +beside +(results[\w./-]*))? *)-->$", re.MULTILINE)
Fill = Callable[[str, str, str | None], str | None]
"""Content of a block from its directory, its name, and the other directory if it has one; None leaves the block as it
is, a `UserError` means that it cannot be filled."""
SUMMARY, STATEMENTS, ENGINES, MISSES = "summary", "statements", "engines", "misses"
OF_ALL = (SUMMARY, STATEMENTS, MISSES)
"""Blocks on all topics."""


def filled(text: str, page: str, fill: Fill) -> str:
    """Return the text of a page with its blocks filled anew.

    Args:
        text: of the page.
        page: its name, for errors.
        fill: gives the content of a block.

    Raises:
        UserError: a block does not end or begin, or it names something that is not there; the message names the line.
    """
    marks, kept, at = list(_MARK.finditer(text)), [], 0
    lines = [text.count("\n", 0, mark.start()) + 1 for mark in marks]
    for place, (line, mark) in enumerate(zip(lines, marks, strict=True)):
        if bool(mark[1]) == place % 2 or (mark[1] and place == len(marks) - 1):
            raise UserError(f"{page}:{line}: blocks of results begin and end in turn; this line begins or ends none.")
    for line, begin, end in zip(lines[::2], marks[::2], marks[1::2], strict=True):
        try:
            new = fill(*begin.groups())
        except UserError as error:
            raise UserError(f"{page}:{line}: {error}") from None
        if new is not None:
            kept += [text[at : begin.end()], "\n\n", new.strip("\n"), "\n\n"]
            at = end.start()
    return "".join([*kept, text[at:]])


def new_texts(pages: Iterable[Path], fill: Fill) -> dict[Path, str]:
    """Texts of those pages that change if their blocks are filled anew; writes nothing.

    Raises:
        UserError: a page cannot be read, or as `filled` does.
    """
    found = {page: read_text(page, "give Markdown files") for page in pages}
    new = {page: filled(text, str(page), fill) for page, text in found.items()}
    return {page: text for page, text in new.items() if text != found[page]}


def check_name(directory: str, name: str, beside: str | None = None) -> None:
    """Return nothing if there are blocks of this name.

    Raises:
        UserError: there is no such block, or it needs another directory.
    """
    if name == ENGINES and beside is None:
        raise UserError(f"The block {name!r} compares two directories; write `beside` and the other one.")
    if name not in (names := [*TITLES, *OF_ALL, ENGINES]):
        raise UserError(f"The block was {name!r}; there are {', '.join(names)}: choose one of these.")


class Tables:
    """Contents of blocks, by the directories of results; what was read is kept.

    Args:
        root: directory that the blocks' directories are relative to.
        partial: leave blocks as they are for which there are no results, instead of raising an error.
    """

    def __init__(self, root: Path = Path(), partial: bool = False):
        self._partial = partial
        self._topics = cache(lambda directory: {topic.name: topic for topic in topics_of(collect([root / directory]))})

    def content(self, directory: str, name: str, beside: str | None = None) -> str | None:
        """Content of the block of this name from the results in a directory; None if it is to stay as it is.

        Args:
            directory: of results.
            name: a topic, `ENGINES` or one of `OF_ALL`.
            beside: another directory, whose results stand beside the first's.

        Raises:
            UserError: there is no such block, or no results for it.
        """
        check_name(directory, name, beside)
        try:
            found = {place: self._named(place, name) for place in filter(None, (directory, beside))}
        except UserError:
            if self._partial:
                return None
            raise
        if name == ENGINES:
            return engines({place: {t.name: t.results[0].rows for t in topics} for place, topics in found.items()})
        if name in (SUMMARY, MISSES):
            shown = _summary if name == SUMMARY else _misses
            return _each(found, lambda topics: shown([f for topic in topics for f in topic.findings]))
        if name == STATEMENTS:
            texts = []
            for title in dict.fromkeys(topic.title for topics in found.values() for topic in topics):
                same = {place: topic for place, topics in found.items() for topic in topics if topic.title == title}
                texts.append(f"### {title}\n\n{_each(same, _statements)}")
            return "\n\n".join(texts)
        topics = {place: topic for place, (topic,) in found.items()}
        return "\n\n".join(filter(None, [_each(topics, _numbers), _verdicts(topics)]))

    def _named(self, directory: str, name: str) -> list[Topic]:
        """Topic of this name; for the names of none all that have results or need none."""
        topics = self._topics(directory)
        if name in OF_ALL:
            return [topic for topic in topics.values() if topic.results or topic.name == LAWS]
        wanted = ("hop-count", "density") if name == ENGINES else (name,)
        if any(not topics[each].results and each != LAWS for each in wanted):
            raise UserError(f"{directory} has no results for the block {name!r}; make them with `iswarm reproduce`.")
        return [topics[each] for each in wanted]


def _each(found: Mapping[str, Any], shown: Callable[[Any], str]) -> str:
    """What is shown of each directory, under its name if there are several."""
    texts = {place: shown(each) for place, each in found.items()}
    return "\n\n".join(f"`{place}`:\n\n{text}" if len(texts) > 1 and text else text for place, text in texts.items())


def _numbers(topic: Topic) -> str:
    """The table of a topic's numbers; empty if it has none."""
    if topic.name == EVOLUTION:
        return evolution(searches_of(topic.results))
    return "\n\n".join(TABLES[topic.name](result.rows) for result in topic.results if topic.name in TABLES)


def _verdicts(topics: Mapping[str, Topic]) -> str:
    """Statements with the paper's values, kinds, and the verdicts of one or several directories.

    Numbers of which the paper has none, and that no rule judges, stand in the tables of numbers only.
    """
    several, first = len(topics) > 1, next(iter(topics.values())).findings
    judged = [{f.claim: f.verdict or "not judged" for f in topic.findings} for topic in topics.values()]
    head = ["statement", "the paper", *(f"verdict, `{place}`" if several else "verdict" for place in topics), "kind"]
    return table(
        head,
        [
            [f.claim, f.paper, *(each.get(f.claim, "") for each in judged), f.kind]
            for f in first
            if f.verdict or f.kind != NOT_COMPARABLE
        ],
    )


def _statements(topic: Topic) -> str:
    """Statements with everything but their places in the paper."""
    lines = [[f.claim, f.paper, f.ours, f.statistics, f.verdict or "not judged", f.kind] for f in topic.findings]
    return table(["statement", "the paper", "here", "statistics", "verdict", "kind"], lines)


def _summary(findings: Sequence[Finding]) -> str:
    """Numbers of the paper's statements by verdict and kind, and of the others by verdict."""
    own, others = ([f for f in findings if (f.source != NOT_IN_PAPER) == is_own] for is_own in (True, False))
    kinds, counts = tally(own)
    added = Counter(finding.verdict for finding in others)
    rows = [
        [verdict or "not judged", *(row := counts.get(verdict, [0] * len(kinds))), sum(row), added[verdict]]
        for verdict in [*counts, *(each for each in added if each not in counts)]
    ]
    return table(["verdict", *kinds, "all of the paper's", NOT_IN_PAPER], rows)


def _misses(findings: Sequence[Finding]) -> str:
    """The paper's statements that do not hold here, or are undecided, with what is found instead."""
    own = [f for f in findings if f.source != NOT_IN_PAPER and f.verdict in (FAILS, UNDECIDED)]
    head = ["statement", "the paper", "here", "verdict", "kind"]
    return table(head, [[f.claim, f.paper, f.ours, f.verdict, f.kind] for f in own])
