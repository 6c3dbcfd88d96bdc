"""Blocks of Markdown pages that are written from results; nothing outside of them is touched.

A block begins with a line `<!-- DIRECTORY: NAME -->`, where the directory is `results` or one
below it, and the name a topic or one of `OVERVIEWS`; it ends with a line `<!-- end -->`.
`<!-- DIRECTORY: NAME beside OTHER -->` has the results of two directories on a topic, such as
those of two configurations. A block without results stays as it is.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.paper.analysis.findings import (
    FAILS,
    HOLDS,
    NOT_COMPARABLE,
    NOT_IN_PAPER,
    UNDECIDED,
    Finding,
)
from iswarm_mj.paper.report.beside_paper import cards, tally
from iswarm_mj.paper.report.markdown import markdown_table
from iswarm_mj.paper.report.number_tables import (
    engines_table,
    evolution_table,
    readings_tables,
    runs_table,
    sensitivity_table,
    trials_table,
)
from iswarm_mj.paper.report.results import (
    EVOLUTION,
    GRASP,
    LAWS,
    TOPICS,
    Topic,
    collect_results,
    count_verdicts,
    explaining_damage,
    topics_of,
)
from iswarm_mj.utils import intervals
from iswarm_mj.utils.errors import UserError
from iswarm_mj.utils.files import read_text
from iswarm_mj.utils.intervals import LEVEL

_BLOCK = re.compile(
    r"(?P<begin>^<!-- (?P<directory>results[\w./-]*): *(?P<name>[\w-]+)"
    r"(?: +beside +(?P<beside>results[\w./-]*))? *-->$)"
    r"(?:(?!^<!-- results).)*?(?P<end>^<!-- end -->$)",
    re.MULTILINE | re.DOTALL,
)
OVERVIEWS = ("summary", "statements", "misses", "tally", "beside")
"""Blocks on all topics."""
ENGINES = "engines"
"""Block that compares the finishing times of two engines."""
NAMES = (*TOPICS, *OVERVIEWS, ENGINES)
"""Names of all blocks."""
_TOPICS_OF_ENGINES = ("hop-count", "density")
_DECIDED = (HOLDS, FAILS)
_JUDGED = (*_DECIDED, UNDECIDED)

Topics = Sequence[Topic]
Fill = Callable[[str, str, str | None], str | None]
"""Returns the content of a block from its directory, its name, and the other directory if it has
one; None leaves it as it is."""


def changed_pages(pages: Iterable[Path], fill: Fill) -> dict[Path, str]:
    """Return the texts of those pages that change if their blocks are filled again.

    Nothing is written.

    Raises:
        UserError: a page cannot be read, or a block has an unknown name.
    """
    new_texts = {}
    for page in pages:
        text = read_text(page, "give Markdown files")
        new_text = fill_blocks(text, fill)
        if new_text != text:
            new_texts[page] = new_text
    return new_texts


def fill_blocks(text: str, fill: Fill) -> str:
    """Return the text of a page with its blocks filled again."""

    def replacement(block: re.Match[str]) -> str:
        content = fill(block["directory"], block["name"], block["beside"])
        if content is None:
            return block[0]
        return "\n\n".join([block["begin"], content.strip("\n"), block["end"]])

    return _BLOCK.sub(replacement, text)


class ResultBlocks:
    """Contents of blocks, from the directories of results below a root.

    Args:
        root: where the directories are.

    Attributes:
        topics: returns the topics of a directory; what was read is kept.
    """

    def __init__(self, root: Path = Path()):
        self._root = root
        self.topics = cache(lambda directory: topics_of(collect_results([root / directory])))

    def content(self, directory: str, name: str, beside: str | None = None) -> str | None:
        """Return the content of a block; None if there are no results for it.

        Args:
            directory: directory of the results.
            name: name of the block.
            beside: another directory, whose results stand beside those of the first. Overviews
                ignore it; it must be given for engines.

        Raises:
            UserError: there is no block of this name.
        """
        if name not in NAMES:
            names = ", ".join(NAMES)
            raise UserError(f"The block was {name!r}; there are {names}: choose one of these.")

        places = [place for place in (directory, beside) if place is not None]
        topics_at = {place: self._topics_of_block(place, name) for place in places}
        if len(topics_at) < len(places) or not all(topics_at.values()):
            return None

        if name == ENGINES:
            return _engines(topics_at)
        if name == "summary":
            return f"{_summary(topics_at[directory])}\n\n{_family_wise(topics_at[directory])}"
        if name == "misses":
            return _misses(topics_at[directory])
        if name == "tally":
            return tally(topics_at[directory])
        if name == "beside":
            return cards(topics_at[directory], directory)
        if name == "statements":
            return _statements(topics_at[directory])
        return _numbers_and_verdicts({place: topic for place, (topic,) in topics_at.items()})

    def _topics_of_block(self, directory: str, name: str) -> Topics:
        """Return the topics that a block is on; none if one of them lacks results.

        Overviews are on all topics with results.
        """
        if not (self._root / directory).is_dir():
            return []
        with_results = {
            topic.name: topic
            for topic in self.topics(directory)
            if topic.results or topic.name == LAWS
        }
        if name in OVERVIEWS:
            return list(with_results.values())
        wanted = _TOPICS_OF_ENGINES if name == ENGINES else (name,)
        if not with_results.keys() >= set(wanted):
            return []
        return [topic for topic in with_results.values() if topic.name in wanted]


# --- A topic ---


def _numbers_and_verdicts(topic_at: Mapping[str, Topic]) -> str:
    """Return the numbers of a topic, and its verdicts, in one or two directories."""
    texts = []
    for place, topic in topic_at.items():
        numbers = _numbers(topic)
        if numbers:
            heading = f"{_place_text(place, topic)}:\n\n" if len(topic_at) > 1 else ""
            texts.append(heading + numbers)
    texts.append(_verdicts(topic_at))
    return "\n\n".join(texts)


def _place_text(place: str, topic: Topic) -> str:
    """Return a directory, with those settings of planar's physics that are not the defaults."""
    settings = topic.results[0].settings
    flags = []
    for name in ("accuracy", "refinement"):
        value = settings.get(name)
        if value is not None and value != getattr(PlanarSettings, name):
            flags.append(f"--{name} {value:g}")
    return f"`{place}`, made with `{' '.join(flags)}`" if flags else f"`{place}`"


def _numbers(topic: Topic) -> str:
    """Return the table of a topic's numbers; an empty text if it has none."""
    if topic.name == LAWS:
        return ""
    tables = {
        GRASP: trials_table,
        EVOLUTION: evolution_table,
        "sensitivity": sensitivity_table,
        "infer": readings_tables,
    }
    with explaining_damage(topic.results[0].path):
        if topic.name in tables:
            return tables[topic.name](topic.data)
        return runs_table(topic.name, topic.data)


def _verdicts(topic_at: Mapping[str, Topic]) -> str:
    """Return the statements of a topic with the verdicts of one or two directories.

    Numbers of which the paper has none, and that no rule judges, stand in the tables of numbers
    only.
    """
    verdict_heads = ["verdict"]
    if len(topic_at) > 1:
        verdict_heads = [f"verdict, `{place}`" for place in topic_at]
    head = ["statement", "the paper", *verdict_heads, "kind"]

    verdicts_at = {place: _verdict_by_claim(topic) for place, topic in topic_at.items()}
    first_topic = next(iter(topic_at.values()))
    lines = []
    for finding in first_topic.findings:
        if finding.verdict or finding.kind != NOT_COMPARABLE:
            verdicts = [verdict_of.get(finding.claim, "") for verdict_of in verdicts_at.values()]
            lines.append([finding.claim, finding.paper, *verdicts, finding.kind])
    return markdown_table(head, lines)


def _verdict_by_claim(topic: Topic) -> dict[str, str]:
    """Return the verdicts on the statements of a topic, as text."""
    return {finding.claim: _verdict_text(finding.verdict) for finding in topic.findings}


def _verdict_text(verdict: str) -> str:
    """Return a verdict as text; a number that is reported without one is not judged."""
    return verdict or "not judged"


def _engines(topics_at: Mapping[str, Topics]) -> str:
    """Return the comparison of the finishing times in two directories."""
    rows_at = {}
    for place, topics in topics_at.items():
        rows_at[place] = {topic.name: topic.results[0].rows for topic in topics}
    return engines_table(rows_at)


# --- All topics ---


def _statements(topics: Topics) -> str:
    """Return a section in Markdown for each topic, with a table of its statements and verdicts."""
    head = ["statement", "the paper", "here", "statistics", "verdict", "kind"]
    sections = []
    for topic in topics:
        lines = [
            [
                finding.claim,
                finding.paper,
                finding.ours,
                finding.statistics,
                _verdict_text(finding.verdict),
                finding.kind,
            ]
            for finding in topic.findings
        ]
        sections.append(f"### {topic.title}\n\n{markdown_table(head, lines)}")
    return "\n\n".join(sections)


def _split_findings(topics: Topics) -> tuple[list[Finding], list[Finding]]:
    """Return the findings on the paper's statements, and the added ones."""
    findings = [finding for topic in topics for finding in topic.findings]
    of_paper = [finding for finding in findings if finding.source != NOT_IN_PAPER]
    added = [finding for finding in findings if finding.source == NOT_IN_PAPER]
    return of_paper, added


def _summary(topics: Topics) -> str:
    """Return the numbers of the paper's statements by verdict and kind, of others by verdict."""
    of_paper, added = _split_findings(topics)
    kinds, counts_of_paper = count_verdicts(of_paper)
    count_of_added = Counter(finding.verdict for finding in added)

    lines = []
    for verdict in dict.fromkeys([*counts_of_paper, *count_of_added]):
        counts = counts_of_paper.get(verdict, [0] * len(kinds))
        lines.append([_verdict_text(verdict), *counts, sum(counts), count_of_added[verdict]])
    return markdown_table(["verdict", *kinds, "all of the paper's", NOT_IN_PAPER], lines)


def _family_wise(topics: Topics) -> str:
    """Return which verdicts on results stay when all together err in 5 % (Bonferroni).

    For that the intervals are wider.
    """
    results = {result.name: result for topic in topics for result in topic.results}
    judged = [
        finding
        for topic in topics
        if topic.results
        for finding in topic.findings
        if finding.verdict in _JUDGED
    ]
    level = 1 - (1 - LEVEL.get()) / len(judged)
    with _confidence(level):
        verdict_after = {
            finding.claim: finding.verdict
            for topic in topics_of(results)
            for finding in topic.findings
        }

    # Wider intervals only make decided verdicts undecided.
    decided = [finding for finding in judged if finding.verdict in _DECIDED]
    lost = [finding for finding in decided if verdict_after[finding.claim] != finding.verdict]
    lost_of_paper = [finding.claim for finding in lost if finding.source != NOT_IN_PAPER]
    return (
        f"Family-wise: with intervals at {100 * level:.2f} %, by Bonferroni for these "
        f"{len(judged)} verdicts on runs and trials, {len(decided) - len(lost)} of the "
        f"{len(decided)} decided ones stay. Of the paper's statements these become undecided: "
        f"{'; '.join(lost_of_paper) or 'none'}. {_tails_text(level)}"
    )


def _tails_text(level: float) -> str:
    """Return a sentence on how few resamples lie outside of an interval by bootstrap."""
    n_outside = intervals.RESAMPLES * (1 - level) / 2
    return (
        f"At each end of such an interval by bootstrap lie {n_outside:.1f} of {intervals.RESAMPLES} "
        "resamples on average, so verdicts near a limit may change with the random numbers."
    )


@contextmanager
def _confidence(level: float) -> Iterator[None]:
    """Set the confidence level of all intervals."""
    token = LEVEL.set(level)
    try:
        yield
    finally:
        LEVEL.reset(token)


def _misses(topics: Topics) -> str:
    """Return the paper's statements that do not hold here, or are undecided, and what is found."""
    papers, _ = _split_findings(topics)
    lines = [
        [finding.claim, finding.paper, finding.ours, finding.verdict, finding.kind]
        for finding in papers
        if finding.verdict in (FAILS, UNDECIDED)
    ]
    return markdown_table(["statement", "the paper", "here", "verdict", "kind"], lines)
