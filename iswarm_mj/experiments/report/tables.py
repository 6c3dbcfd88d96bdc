"""Tables of results in Markdown, by the names of the blocks in which README and docs show them."""

from collections.abc import Sequence
from pathlib import Path

from iswarm_mj.experiments.analysis.findings import Finding
from iswarm_mj.experiments.report.result_tables import TABLES, evolution, markdown
from iswarm_mj.experiments.report.results import collect
from iswarm_mj.experiments.report.statements import EVOLUTION, LAWS, TITLES, Topic, tally, topics_of
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.utils.errors import UserError

SUMMARY, STATEMENTS = "summary", "statements"


def check_name(directory: str, name: str) -> None:
    """Return nothing if there are blocks of this name.

    Raises:
        UserError: there is no such block.
    """
    if name not in (names := [*TITLES, *(each for each in EXPERIMENTS if each not in TITLES), SUMMARY, STATEMENTS]):
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

    def content(self, directory: str, name: str) -> str | None:
        """Content of the block of this name from the results in a directory; None if it is to stay as it is.

        Raises:
            UserError: there is no such block, or no results for it.
        """
        check_name(directory, name)
        if self._partial and not (self._root / directory).is_dir():
            return None
        if directory not in self._topics:
            self._topics[directory] = {topic.name: topic for topic in topics_of(collect([self._root / directory]))}
        topics = self._topics[directory]
        if name == SUMMARY:
            return summary([finding for topic in topics.values() for finding in topic.findings])
        if name == STATEMENTS:
            return "\n\n".join(f"### {topic.title}\n\n{statements(topic.findings)}" for topic in topics.values())
        topic = topics[name]
        if not topic.results and name != LAWS:
            if self._partial:
                return None
            raise UserError(f"{directory} has no results for the block {name!r}; make them with `iswarm reproduce`.")
        return "\n\n".join([*numbers(topic), verdicts(topic.findings)])


def numbers(topic: Topic) -> list[str]:
    """The table of a topic's numbers, if it has one."""
    if topic.name == EVOLUTION:
        return [evolution({result.settings["method"]: (result.rows, result.settings) for result in topic.results})]
    return [TABLES[topic.name](result.rows) for result in topic.results if topic.name in TABLES]


def verdicts(findings: Sequence[Finding]) -> str:
    """Statements with the paper's values, verdicts and kinds."""
    head = ["statement", "the paper", "verdict", "kind"]
    return markdown(head, [[f.claim, f.paper, f.verdict or "not judged", f.kind] for f in findings])


def statements(findings: Sequence[Finding]) -> str:
    """Statements with everything but their places in the paper."""
    head = ["statement", "the paper", "here", "statistics", "verdict", "kind"]
    return markdown(
        head, [[f.claim, f.paper, f.ours, f.statistics, f.verdict or "not judged", f.kind] for f in findings]
    )


def summary(findings: Sequence[Finding]) -> str:
    """Numbers of the statements by verdict and kind."""
    kinds, counts = tally(findings)
    rows = [[verdict or "not judged", *row, sum(row)] for verdict, row in counts.items()]
    return markdown(["verdict", *kinds, "all"], rows)
