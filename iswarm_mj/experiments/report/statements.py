"""What results say on all statements, by topics, in the order of the paper."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from iswarm_mj.experiments.analysis import evolution_findings, grasp_findings, law_findings
from iswarm_mj.experiments.analysis.findings import KINDS, Finding
from iswarm_mj.experiments.report.results import Result, Results
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.utils.tables import write_csv

SEARCHES = ("paper", "random", "cmaes")
"""Methods in the order in which they stand."""
LAWS, GRASP, EVOLUTION = "laws", "grasp", "evolution"
TITLES = {
    LAWS: "The gripper's theory (section 3.2.1)",
    GRASP: "Grasping and releasing (section 3.2.3, Figs. 6 to 11)",
    EVOLUTION: "Evolution (section 4.6.1, Fig. 14, Table 2)",
    "hop-count": "Hop counts (section 4.6.1, Fig. 15)",
    "types": "The two types (Table 2, Fig. 16)",
    "density": "The optimal density (section 4.6.2, Fig. 17)",
    "message-time": "Messages that take time (section 4.1, Fig. 15)",
    "sensitivity": "Beyond the paper: other choices and other noise",
    "robustness": "Beyond the paper: failed robots",
    "resolved-grasps": "Beyond the paper: grasps by trials on the bench",
    "time-step": "Beyond the paper: the physics time step",
    "infer": "Beyond the paper: which readings agree with it",
}
"""Topics and their titles; experiments that have none here come last."""
FINDINGS = "findings.csv"


class Topic(NamedTuple):
    """A part of the statements."""

    name: str
    """An experiment, or another name of `TITLES`."""
    title: str
    findings: Sequence[Finding]
    results: Sequence[Result]
    """Tables that the findings are based on; none if they were not made, or are not needed."""


def topics_of(results: Results) -> list[Topic]:
    """All topics with their findings."""
    searches = {method: results.searches[method] for method in SEARCHES if method in results.searches}
    trials = [results.trials] if results.trials else []
    found = {
        LAWS: (law_findings.findings(), []),
        GRASP: (grasp_findings.findings(trials[0].rows if trials else []), trials),
        EVOLUTION: (
            evolution_findings.findings(
                {method: (result.rows, result.settings) for method, result in searches.items()}
            ),
            list(searches.values()),
        ),
    }
    for name, experiment in EXPERIMENTS.items():
        result = results.experiments.get(name)
        found[name] = (experiment.findings(result.rows if result else []), [result] if result else [])
    names = [*TITLES, *(name for name in found if name not in TITLES)]
    return [Topic(name, TITLES.get(name, f"Beyond the paper: {name}"), *found[name]) for name in names]


def tally(findings: Sequence[Finding]) -> tuple[list[str], dict[str, list[int]]]:
    """The kinds that occur, and the number of statements of each by verdict."""
    kinds = [kind for kind in KINDS if any(finding.kind == kind for finding in findings)]
    counts = Counter((finding.verdict, finding.kind) for finding in findings)
    verdicts = dict.fromkeys(finding.verdict for finding in findings)
    return kinds, {verdict: [counts[verdict, kind] for kind in kinds] for verdict in verdicts}


def findings_files(topics: Sequence[Topic]) -> dict[Path, Sequence[Finding]]:
    """Findings by the files beside the tables that they are based on, for the evolution beside its first table."""
    return {topic.results[0].path.with_name(FINDINGS): topic.findings for topic in topics if topic.results}


def write_findings(topics: Sequence[Topic]) -> None:
    """Write `findings_files`.

    Raises:
        UserError: one of them cannot be written.
    """
    for path, findings in findings_files(topics).items():
        write_csv(path, [finding._asdict() for finding in findings])
