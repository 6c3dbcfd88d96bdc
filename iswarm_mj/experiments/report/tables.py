"""Tables of results in Markdown, by the names of the blocks in which README and docs show them."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from iswarm_mj.experiments.analysis.findings import FAILS, NOT_COMPARABLE, NOT_IN_PAPER, UNDECIDED, Finding
from iswarm_mj.experiments.report.engine_table import PARTS, engines
from iswarm_mj.experiments.report.markdown import markdown
from iswarm_mj.experiments.report.result_tables import TABLES, evolution
from iswarm_mj.experiments.report.results import collect
from iswarm_mj.experiments.report.statements import EVOLUTION, LAWS, TITLES, Topic, tally, topics_of
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.utils.errors import UserError

SUMMARY, STATEMENTS, ENGINES, MISSES = "summary", "statements", "engines", "misses"
OF_ALL = (SUMMARY, STATEMENTS, MISSES)
"""Blocks on all topics."""


def check_name(directory: str, name: str, beside: str | None = None) -> None:
    """Return nothing if there are blocks of this name.

    Raises:
        UserError: there is no such block, or it needs another directory.
    """
    if name == ENGINES and beside is None:
        raise UserError(f"The block {name!r} compares two directories; write `beside` and the other one.")
    if name not in (names := [*TITLES, *(each for each in EXPERIMENTS if each not in TITLES), *OF_ALL, ENGINES]):
        raise UserError(f"The block was {name!r}; there are {', '.join(names)}: choose one of these.")


class Tables:
    """Contents of blocks, by the directories of results below a root; what was read is kept."""

    def __init__(self, root: Path = Path(), partial: bool = False):
        """Remember where the results are.

        Args:
            root: directory that the blocks' directories are relative to.
            partial: leave blocks as they are for which there are no results, instead of raising an error.
        """
        self._root, self._partial = root, partial
        self._topics: dict[str, dict[str, Topic]] = {}

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
        places = [directory] if beside is None else [directory, beside]
        try:
            found = {place: self._named(place, name) for place in places}
        except UserError:
            if self._partial:
                return None
            raise
        if name == ENGINES:
            rows = {place: {t.name: t.results[0].rows for t in topics} for place, topics in found.items()}
            return engines(rows)
        if name in (SUMMARY, MISSES):
            shown = summary if name == SUMMARY else misses
            return _each(found, lambda topics: shown([f for topic in topics for f in topic.findings]))
        if name == STATEMENTS:
            same: dict[str, dict[str, Topic]] = {}
            for place, topics in found.items():
                for topic in topics:
                    same.setdefault(topic.title, {})[place] = topic
            return "\n\n".join(
                f"### {title}\n\n{_each(topics, lambda topic: statements(topic.findings))}"
                for title, topics in same.items()
            )
        topics = {place: topic for place, (topic,) in found.items()}
        table = _each(topics, numbers)
        return "\n\n".join(filter(None, [table, verdicts({place: t.findings for place, t in topics.items()})]))

    def _named(self, directory: str, name: str) -> list[Topic]:
        """Topic of this name; for the names of none all that have results or need none."""
        if directory not in self._topics:
            self._topics[directory] = {topic.name: topic for topic in topics_of(collect([self._root / directory]))}
        topics = self._topics[directory]
        if name in OF_ALL:
            return [topic for topic in topics.values() if topic.results or topic.name == LAWS]
        wanted = PARTS if name == ENGINES else (name,)
        if any(not topics[each].results and each != LAWS for each in wanted):
            raise UserError(f"{directory} has no results for the block {name!r}; make them with `iswarm reproduce`.")
        return [topics[each] for each in wanted]


def _each(found: Mapping[str, Any], shown: Callable[[Any], str]) -> str:
    """What is shown of each directory, under its name if there are several."""
    texts = {place: shown(each) for place, each in found.items()}
    return "\n\n".join(f"`{place}`:\n\n{text}" if len(texts) > 1 and text else text for place, text in texts.items())


def numbers(topic: Topic) -> str:
    """The table of a topic's numbers; empty if it has none."""
    if topic.name == EVOLUTION:
        return evolution({result.settings["method"]: (result.rows, result.settings) for result in topic.results})
    return "\n\n".join(TABLES[topic.name](result.rows) for result in topic.results if topic.name in TABLES)


def verdicts(findings: Mapping[str, Sequence[Finding]]) -> str:
    """Statements with the paper's values, kinds, and the verdicts of one or several directories.

    Numbers of which the paper has none, and that no rule judges, stand in the tables of numbers only.
    """
    several = len(findings) > 1
    judged = [{f.claim: f.verdict or "not judged" for f in each} for each in findings.values()]
    head = ["statement", "the paper", *(f"verdict, `{place}`" if several else "verdict" for place in findings), "kind"]
    first = [f for f in next(iter(findings.values())) if f.verdict or f.kind != NOT_COMPARABLE]
    return markdown(head, [[f.claim, f.paper, *(each.get(f.claim, "") for each in judged), f.kind] for f in first])


def statements(findings: Sequence[Finding]) -> str:
    """Statements with everything but their places in the paper."""
    head = ["statement", "the paper", "here", "statistics", "verdict", "kind"]
    return markdown(
        head, [[f.claim, f.paper, f.ours, f.statistics, f.verdict or "not judged", f.kind] for f in findings]
    )


def summary(findings: Sequence[Finding]) -> str:
    """Numbers of the paper's statements by verdict and kind, and of the others by verdict."""
    own, others = ([f for f in findings if (f.source != NOT_IN_PAPER) == is_own] for is_own in (True, False))
    kinds, counts = tally(own)
    added = Counter(finding.verdict for finding in others)
    rows = [
        [verdict or "not judged", *(row := counts.get(verdict, [0] * len(kinds))), sum(row), added[verdict]]
        for verdict in [*counts, *(each for each in added if each not in counts)]
    ]
    return markdown(["verdict", *kinds, "all of the paper's", NOT_IN_PAPER], rows)


def misses(findings: Sequence[Finding]) -> str:
    """The paper's statements that do not hold here, or are undecided, with what is found instead."""
    own = [f for f in findings if f.source != NOT_IN_PAPER and f.verdict in (FAILS, UNDECIDED)]
    head = ["statement", "the paper", "here", "verdict", "kind"]
    return markdown(head, [[f.claim, f.paper, f.ours, f.verdict, f.kind] for f in own])
