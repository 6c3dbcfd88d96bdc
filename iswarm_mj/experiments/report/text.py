"""What the HTML and the Markdown report share."""

from collections.abc import Sequence

from iswarm_mj import __version__
from iswarm_mj.experiments.report.results import Result, Results
from iswarm_mj.experiments.report.sections import Section

TITLE = "The I-SWARM paper beside its re-implementation"
INTRODUCTION = (
    "Every statement of sections 3.2 and 4.6 of P. Valdastri et al., Micromanipulation, communication and swarm "
    "intelligence issues in a swarm microrobotic platform, Robotics and Autonomous Systems 54 (2006) 789-804, with the "
    f"paper's value, ours by iswarm-mj {__version__}, the statistics, and whether it holds here by the rule that "
    "stands beside it. The paper's figures are described, not shown.",
    "The swarm is simulated with rigid bodies; the paper's own simulator was another one. Tests are two-sided at a "
    "level of 0.01, intervals are at 95 %. A verdict tells whether the statement holds in this simulation, not whether "
    "the paper is right.",
)


def tally(sections: Sequence[Section]) -> list[tuple[str, int]]:
    """How many statements have each verdict."""
    verdicts = [finding.verdict for section in sections for finding in section.findings]
    return [(verdict, verdicts.count(verdict)) for verdict in dict.fromkeys(verdicts)]


def tally_text(sections: Sequence[Section]) -> str:
    """The same in one line."""
    return ", ".join(f"{verdict or 'not judged'}: {count}" for verdict, count in tally(sections))


def read_tables(results: Results) -> list[Result]:
    """All tables that were used."""
    trials = [results.trials] if results.trials else []
    return [*trials, *results.searches.values(), *results.experiments.values()]
