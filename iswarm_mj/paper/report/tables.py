"""Blocks of Markdown pages that are written from results; nothing outside of them is touched.

A block begins with a line `<!-- DIRECTORY: NAME -->`, where the directory is `results` or one
below it, and the name a topic or one of `OF_ALL`; it ends with a line `<!-- end -->`.
`<!-- DIRECTORY: NAME beside OTHER -->` has the results of two directories on a topic, such as
those of two configurations. A block without results stays as it is.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, partial
from pathlib import Path

from iswarm_mj.paper.analysis.findings import (
    FAILS,
    HOLDS,
    NOT_COMPARABLE,
    NOT_IN_PAPER,
    UNDECIDED,
    Finding,
)
from iswarm_mj.paper.analysis.statistics import LEVEL
from iswarm_mj.paper.report.numbers import engines, evolution, grouped, readings, sensitivity, table
from iswarm_mj.paper.report.results import (
    EVOLUTION,
    LAWS,
    TOPICS,
    Topic,
    as_named,
    collect,
    tally,
    topics_of,
)
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import read_text

_BLOCK = re.compile(
    r"(^<!-- (results[\w./-]*): *([\w-]+)(?: +beside +(results[\w./-]*))? *-->$)"
    r"((?:(?!^<!-- results).)*?)(^<!-- end -->$)",
    re.MULTILINE | re.DOTALL,
)
OF_ALL = ("summary", "statements", "misses")
"""Blocks on all topics."""
NAMES = (*TOPICS, *OF_ALL, "engines")
Topics = Sequence[Topic]
Fill = Callable[[str, str, str | None], str | None]
"""Content of a block from its directory, its name, and the other directory if it has one; None
leaves it as it is."""


def new_texts(pages: Iterable[Path], fill: Fill) -> dict[Path, str]:
    """Texts of those pages that change if their blocks are filled anew; writes nothing.

    Raises:
        UserError: a page cannot be read, or a block has an unknown name.
    """
    found = {page: read_text(page, "give Markdown files") for page in pages}
    new = {page: filled(text, fill) for page, text in found.items()}
    return {page: text for page, text in new.items() if text != found[page]}


def filled(text: str, fill: Fill) -> str:
    """Text of a page with its blocks filled anew."""

    def block(found: re.Match[str]) -> str:
        content = fill(found[2], found[3], found[4])
        return (
            found[0] if content is None else "\n\n".join([found[1], content.strip("\n"), found[6]])
        )

    return _BLOCK.sub(block, text)


class Tables:
    """Contents of blocks from the directories of results below a root; what was read is kept.

    Attributes:
        topics: of a directory.
    """

    def __init__(self, root: Path = Path()):
        self._root = root
        self.topics = cache(lambda directory: topics_of(collect([root / directory])))

    def content(self, directory: str, name: str, beside: str | None = None) -> str | None:
        """Content of the block of this name from the results in a directory; None if there are
        none.

        Those of another directory stand beside the first's, but for `OF_ALL`; of engines it must be
        given.
        """
        if name not in NAMES:
            raise UserError(
                f"The block was {name!r}; there are {', '.join(NAMES)}: choose one of these."
            )
        places = [place for place in (directory, beside) if place]
        found = {
            place: self._named(place, name) for place in places if (self._root / place).is_dir()
        }
        if len(found) < len(places) or not all(found.values()):
            return None
        match name:
            case "engines":
                return engines(
                    {
                        place: {t.name: t.results[0].rows for t in topics}
                        for place, topics in found.items()
                    }
                )
            case "summary":
                return f"{_summary(found[directory])}\n\n{self._together(found[directory])}"
            case "misses":
                return _misses(found[directory])
            case "statements":
                return "\n\n".join(
                    f"### {topic.title}\n\n{_statements(topic)}" for topic in found[directory]
                )
        topics = {place: topic for place, (topic,) in found.items()}
        numbers = {place: _numbers(topic) for place, topic in topics.items()}
        named = [
            f"`{place}`:\n\n{text}" if beside and text else text for place, text in numbers.items()
        ]
        return "\n\n".join(filter(None, ["\n\n".join(named), _verdicts(topics)]))

    def _named(self, directory: str, name: str) -> Topics:
        """Topics that a block is on, none if one of them lacks results; of `OF_ALL` those with
        results."""
        made = {
            topic.name: topic
            for topic in self.topics(directory)
            if topic.results or topic.name == LAWS
        }
        wanted = (
            [*made] if name in OF_ALL else ["hop-count", "density"] if name == "engines" else [name]
        )
        return (
            [topic for each, topic in made.items() if each in wanted]
            if made.keys() >= {*wanted}
            else []
        )

    @staticmethod
    def _together(topics: Topics) -> str:
        """Which verdicts on results stay when the intervals are so wide that all together err in 5
        % (Bonferroni)."""
        results = {result.name: result for topic in topics for result in topic.results}
        judged = [
            f
            for topic in topics
            if topic.results
            for f in topic.findings
            if f.verdict in (HOLDS, FAILS, UNDECIDED)
        ]
        level = 1 - (1 - LEVEL.get()) / len(judged)
        token = LEVEL.set(level)
        after = {f.claim: f.verdict for topic in topics_of(results) for f in topic.findings}
        LEVEL.reset(token)
        decided = [f for f in judged if f.verdict != UNDECIDED]
        lost = [f for f in decided if after[f.claim] != f.verdict]
        own = "; ".join(f.claim for f in lost if f.source != NOT_IN_PAPER) or "none"
        return (
            f"Family-wise: with intervals at {100 * level:.2f} %, by Bonferroni for these {len(judged)} verdicts on "
            f"runs and trials, {len(decided) - len(lost)} of the {len(decided)} decided ones stay. Of the paper's "
            f"statements these become undecided: {own}."
        )


def _numbers(topic: Topic) -> str:
    """The table of a topic's numbers; empty if it has none."""
    shown = {
        LAWS: lambda _: "",
        EVOLUTION: evolution,
        "sensitivity": sensitivity,
        "infer": readings,
    }
    with as_named(topic.results[0].path if topic.results else Path()):
        return shown.get(topic.name, partial(grouped, topic.name))(topic.data)


def _verdicts(topics: Mapping[str, Topic]) -> str:
    """Statements with the paper's values, kinds, and the verdicts of one or several directories.

    Numbers of which the paper has none, and that no rule judges, stand in the tables of numbers
    only.
    """
    several, first = len(topics) > 1, next(iter(topics.values())).findings
    judged = [
        {f.claim: f.verdict or "not judged" for f in topic.findings} for topic in topics.values()
    ]
    head = [
        "statement",
        "the paper",
        *(f"verdict, `{place}`" if several else "verdict" for place in topics),
        "kind",
    ]
    shown = [f for f in first if f.verdict or f.kind != NOT_COMPARABLE]
    return table(
        head,
        [[f.claim, f.paper, *(each.get(f.claim, "") for each in judged), f.kind] for f in shown],
    )


def _statements(topic: Topic) -> str:
    """Statements with everything but their places in the paper."""
    lines = [
        [f.claim, f.paper, f.ours, f.statistics, f.verdict or "not judged", f.kind]
        for f in topic.findings
    ]
    return table(["statement", "the paper", "here", "statistics", "verdict", "kind"], lines)


def _findings(topics: Topics) -> list[Finding]:
    return [finding for topic in topics for finding in topic.findings]


def _summary(topics: Topics) -> str:
    """Numbers of the paper's statements by verdict and kind, and of the others by verdict."""
    findings = _findings(topics)
    own, others = (
        [f for f in findings if (f.source != NOT_IN_PAPER) == is_own] for is_own in (True, False)
    )
    kinds, counts = tally(own)
    added = Counter(finding.verdict for finding in others)
    rows = [
        [
            verdict or "not judged",
            *(row := counts.get(verdict, [0] * len(kinds))),
            sum(row),
            added[verdict],
        ]
        for verdict in [*counts, *(each for each in added if each not in counts)]
    ]
    return table(["verdict", *kinds, "all of the paper's", NOT_IN_PAPER], rows)


def _misses(topics: Topics) -> str:
    """The paper's statements that do not hold here, or are undecided, with what is found
    instead."""
    own = [
        f for f in _findings(topics) if f.source != NOT_IN_PAPER and f.verdict in (FAILS, UNDECIDED)
    ]
    head = ["statement", "the paper", "here", "verdict", "kind"]
    return table(head, [[f.claim, f.paper, f.ours, f.verdict, f.kind] for f in own])
