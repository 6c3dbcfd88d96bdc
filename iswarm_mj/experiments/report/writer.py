"""The report: every statement of the paper's sections 3.2 and 4.6 beside the results found for it, as an HTML page that
embeds its figures."""

import base64
from collections.abc import Sequence
from pathlib import Path
from shlex import join
from tempfile import TemporaryDirectory
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined

from iswarm_mj import __version__
from iswarm_mj.experiments.analysis.findings import KINDS, Finding
from iswarm_mj.experiments.analysis.plots_of_searches import draw_trade
from iswarm_mj.experiments.report.results import EVOLUTION, Topic, collect, files_in, searches_of, tally, topics_of
from iswarm_mj.utils.files import atomic_write, make_output_directory

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
PAPER_FIGURES = {
    "grasp": (
        "Figs. 8 and 9 plot the averages of five grasp voltages against the radius, at 10 % RH and at 30 and 50 %. By "
        "the text they range from 20 to 30 V at 10 %, which is optimal, and the radius does not really influence "
        "them. Fig. 10 has a ball, of 15 µm by the text, that melted to the tool at 70 V; Fig. 11 a release from "
        "about 5 µm, which by the text takes 37 to 47 V."
    ),
    "evolution": (
        "Fig. 14(a) has the absolute fitness of 1200 runs in 120 generations, with a dashed line at the most that a "
        "swarm achieves without removing all dust, 2860 points. By the text the best rise steadily between "
        "generations 1 and 35; the fittest of the two types have 7771 and 7766 points (Table 2). Fig. 14(b) has "
        "p(vector-forget) and the fraction of scouts of the 250 fittest swarms between generations 35 and 100, with "
        "two dashed lines that indicate a negative correlation."
    ),
    "hop-count": (
        "Fig. 15 compares runs with and without hop counts: (a) how quickly the goal is achieved, (b) how much dust "
        "is removed, (c) how many collisions happen, (d) on how short a way dust is carried; medians and third "
        "quartiles, 12 runs a bar. The text gives no numbers."
    ),
    "types": (
        "Fig. 16 has a screenshot of each type. By its caption type 2 shows a more intensive aggregation of empty "
        "robots around the dust areas, and type 1 builds several sub-swarms that are narrowly connected. Colours by "
        "the caption of Fig. 12: empty robots are red boxes, loaded ones blue; dust areas are blue, the dump is "
        "yellow."
    ),
    "density": (
        "Fig. 17 has (a) the time, (b) the cleaning, (c) collisions per robot and (d) the mean carriage at densities "
        "from 0.05 to 0.4; medians and third quartiles, 6 runs a bar. By its caption (a), (c) and (d) are lowest "
        "between 0.1 and 0.15, and swarms between 0.1 and 0.2 cleaned the whole arena."
    ),
}
"""What the paper's text and captions say of its figures, which are not at hand themselves."""
OF_RUNS = "type*[0-9].png"
"""Drawings that the experiment on types leaves in its directory."""
SVG_LIMIT = 400_000
"""A drawing whose SVG file is larger than this is embedded as PNG [bytes]."""
_MIME_TYPES = {".png": "image/png", ".svg": "image/svg+xml"}


class Picture(NamedTuple):
    """A figure of ours."""

    name: str
    content: str
    """As a data URI."""


class Section(NamedTuple):
    """A part of the report."""

    title: str
    findings: Sequence[Finding]
    pictures: Sequence[Picture]
    paper: str
    """What the paper says of its figure; empty without one."""


def report(directories: Sequence[Path], out: Path) -> list[Section]:
    """Write a report of all results below the directories as one HTML page; print a summary.

    Args:
        directories: searched for results at any depth.
        out: the page.

    Raises:
        UserError: a directory does not exist, a table is damaged, or `out` is not writable.
    """
    results = collect(directories)
    make_output_directory(out.parent, given=out)
    sections = [_section(topic) for topic in topics_of(results)]
    kinds, counts = tally([finding for section in sections for finding in section.findings])
    content = {
        "title": TITLE,
        "introduction": INTRODUCTION,
        "tally": counts,
        "kinds": {kind: KINDS[kind] for kind in kinds},
        "sections": sections,
        "results": results,
        "again": join(["iswarm", "report", "--results", *map(str, directories), "--out", str(out)]),
    }
    with atomic_write(out) as part:
        part.write_text(render("report.html", content), encoding="utf-8")
    if not results:
        print(f"no results found in {', '.join(map(str, directories))}; the statements that are judged need none")
    print(", ".join(f"{verdict or 'not judged'}: {sum(row)}" for verdict, row in counts.items()))
    print(f"report in {out}")
    return sections


def _section(topic: Topic) -> Section:
    """Section of a topic, with the figures of its tables."""
    pictures = []
    with TemporaryDirectory() as directory:
        drawn = Path(directory)
        for result in topic.results:
            paths = [*result.draw(drawn), *(files_in(result.path.parent, OF_RUNS) if topic.name == "types" else ())]
            pictures += [Picture(f"{result.name}, {path.stem.replace('_', ' ')}", data_uri(path)) for path in paths]
        if topic.name == EVOLUTION:
            paths = draw_trade(searches_of(topic.results), drawn / "trade")
            pictures += [Picture("Forgetting and scouts among the fittest", data_uri(path)) for path in paths]
    quick = ": the quick version, with few and short runs" * any(r.settings.get("quick") for r in topic.results)
    return Section(topic.title + quick, topic.findings, pictures, PAPER_FIGURES.get(topic.name, ""))


def render(template: str, content: dict) -> str:
    """Fill in a template.

    Args:
        template: report.html.
        content: values of the template's names, see `report`.
    """
    environment = Environment(
        loader=PackageLoader("iswarm_mj.experiments.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return environment.get_template(template).render(content)


def data_uri(path: Path) -> str:
    """Content of a picture as a data URI; for a PNG file, that of the SVG file beside it if small enough."""
    drawing = path.with_suffix(".svg")
    if path.suffix == ".png" and drawing.is_file() and drawing.stat().st_size <= SVG_LIMIT:
        path = drawing
    return f"data:{_MIME_TYPES[path.suffix]};base64,{base64.b64encode(path.read_bytes()).decode()}"
