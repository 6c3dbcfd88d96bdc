"""The report: every statement of the paper's sections 3.2 and 4.6 beside the results found for it."""

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from iswarm_mj import __version__
from iswarm_mj.experiments.analysis.findings import KINDS
from iswarm_mj.experiments.report import assumptions
from iswarm_mj.experiments.report.render import render
from iswarm_mj.experiments.report.results import Results, collect
from iswarm_mj.experiments.report.sections import Section, sections_of
from iswarm_mj.experiments.report.statements import tally, topics_of
from iswarm_mj.experiments.report.usable import usable
from iswarm_mj.utils.files import atomic_write
from iswarm_mj.utils.lock import locked

TITLE = "The I-SWARM paper beside its re-implementation"
INTRODUCTION = (
    "Every statement of sections 3.2 and 4.6 of P. Valdastri et al., Micromanipulation, communication and swarm "
    "intelligence issues in a swarm microrobotic platform, Robotics and Autonomous Systems 54 (2006) 789-804, with the "
    f"paper's value, ours by iswarm-mj {__version__}, the statistics, and whether it holds here by the rule that "
    "stands beside it. Of the paper's figures there is what its text says.",
    "The swarm is simulated with rigid bodies; the paper's own simulator was another one. Intervals are at 95 %, and "
    "they decide: that two quantities are equal holds only if the interval of their difference lies within a margin. "
    "p-values are two-sided. A verdict tells whether the statement holds in this simulation, not whether the paper is "
    "right; its kind tells what that is worth.",
)


def report(directories: Sequence[Path], out: Path, beside: Path | None = None) -> list[Section]:
    """Write a report of all results below the directories as HTML and, beside it, as Markdown; print a summary.

    The HTML page embeds its figures. The Markdown file links to them in a directory beside it, as both do to videos.

    Args:
        directories: searched for results at any depth.
        out: the HTML file.
        beside: directory of other results, such as those of another configuration, whose values and verdicts stand
            beside the first ones.

    Raises:
        UserError: a directory does not exist, or `out` is not writable.
    """
    results = usable(collect(directories))
    others = {f.claim: f for topic in topics_of(usable(collect([beside]))) for f in topic.findings} if beside else {}
    figures = out.with_name(f"{out.stem}_figures")
    markdown = out.with_suffix(".md")
    again = f"iswarm report --results {' '.join(map(str, directories))} --out {out}"
    again += f" --beside {beside}" if beside else ""
    with locked(figures, given=out):
        sections = sections_of(results, figures)
        for picture in (picture for section in sections for picture in section.pictures):
            if picture.path.parent != figures:
                with atomic_write(figures / picture.path.name) as part:
                    shutil.copyfile(picture.path, part)
        content = content_of(sections, results) | {"again": again, "figures": figures.name}
        content |= {"beside": str(beside or ""), "others": others}
        for path, template in ((out, "report.html"), (markdown, "report.md")):
            with atomic_write(path) as part:
                part.write_text(render(template, content), encoding="utf-8")
    for path in results.unusable:
        print(f"left out, since it is damaged or holds something else: {path}")
    if not results.used:
        places = ", ".join(map(str, directories))
        print(f"no results found in {places}; the statements that are judged need none")
    print(f"{content['tally_text']}\nreport in {out} and {markdown}")
    return sections


def content_of(sections: Sequence[Section], results: Results) -> dict[str, Any]:
    """Values of the names in the templates."""
    kinds, counts = tally([finding for section in sections for finding in section.findings])
    return {
        "title": TITLE,
        "introduction": INTRODUCTION,
        "tally": counts,
        "kinds": {kind: KINDS[kind] for kind in kinds},
        "tally_text": ", ".join(f"{verdict or 'not judged'}: {sum(row)}" for verdict, row in counts.items()),
        "sections": sections,
        "rules": (*assumptions.RULES, *assumptions.operators()),
        "assumed": assumptions.assumed(),
        "fitting": assumptions.fitting(),
        "fitted": assumptions.fitted(),
        "tables": results.used,
        "left_out": results.left_out,
        "unusable": results.unusable,
    }
