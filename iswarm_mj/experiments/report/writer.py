"""The report: every statement of the paper's sections 3.2 and 4.6 beside the results found for it, as an HTML page that
embeds all its figures but videos, and as Markdown that links to them."""

import base64
import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from shlex import join
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from iswarm_mj import __version__
from iswarm_mj.experiments.analysis.findings import KINDS, Finding
from iswarm_mj.experiments.analysis.plots_of_searches import draw_searches
from iswarm_mj.experiments.report import assumptions, markdown
from iswarm_mj.experiments.report.results import (
    EVOLUTION,
    GRASP,
    METHODS,
    Results,
    Topic,
    collect,
    draw_table,
    files_in,
    searches_of,
    tally,
    topics_of,
)
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
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
_BARS, _LINES = (
    "bars to the median, lines to the third quartile",
    "lines through the medians, bands between the quartiles",
)
CAPTIONS = {
    "grasp_voltage": "Grasp voltages at 10 % RH",
    "grasp_voltage_humidity": "Grasp voltages at all humidities",
    "release_voltage": "Release voltages",
    "no_contact": "Attempts without contact",
    "evolution_paper": "Fitness in the paper's evolution",
    "evolution_random": "Fitness in random search",
    "evolution_cmaes": "Fitness in CMA-ES",
    "trade": "Forgetting and scouts among the 250 fittest, generations 35 to 100",
    "traits": "Means of the last 20 generations and correlations: dots are evolutions or searches, lines medians",
    "hop_count": f"With and without hop counts: {_BARS}, dots are runs",
    "density": f"Densities: {_BARS}, dots are runs",
    "types": "All types: dots are runs, lines medians",
    "sensitivity": "Each choice on its own against the default: orange intervals lie above zero, blue ones below",
    "robustness": f"Failed robots: {_LINES}, dots are runs",
    "time_step": f"Physics steps a second: {_LINES}, dots are runs",
    "message_time": f"Messages that take time: {_BARS}, dots are runs",
}
AT_RUN_TIME = {
    "type*[0-9].png": "drawn from the trajectory: vectors that robots follow in their colours, links grey",
    "type*_mujoco.png": "by MuJoCo's renderer, balls 15 times enlarged",
    "type*.mp4": "video, 12 control steps a second",
}
"""Drawings, pictures and videos that the experiment on types leaves in its directory."""
SVG_LIMIT = 400_000
"""A drawing whose SVG file is larger than this is embedded as PNG [bytes]."""
_MIME_TYPES = {".png": "image/png", ".svg": "image/svg+xml"}


class Picture(NamedTuple):
    """A figure or a video of ours."""

    path: Path
    caption: str


class Section(NamedTuple):
    """A part of the report: statements, figures of ours, what the paper says of its figure, commands."""

    title: str
    findings: Sequence[Finding]
    pictures: Sequence[Picture]
    paper: str
    """What the paper says of its figure; empty without one."""
    commands: Sequence[str]


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
    results = collect(directories)
    others = {f.claim: f for topic in topics_of(collect([beside])) for f in topic.findings} if beside else {}
    figures, pages = out.with_name(f"{out.stem}_figures"), (out, out.with_suffix(".md"))
    again = ["iswarm", "report", "--results", *map(str, directories), "--out", str(out)]
    with locked(figures, given=out):
        sections = [_section(topic, results, figures) for topic in topics_of(results)]
        for picture in (picture for section in sections for picture in section.pictures):
            if picture.path.parent != figures:
                with atomic_write(figures / picture.path.name) as part:
                    shutil.copyfile(picture.path, part)
        kinds, counts = tally([finding for section in sections for finding in section.findings])
        content = {
            "title": TITLE,
            "introduction": INTRODUCTION,
            "tally": counts,
            "kinds": {kind: KINDS[kind] for kind in kinds},
            "sections": sections,
            "rules": (*assumptions.RULES, *assumptions.operators()),
            "assumed": assumptions.assumed(),
            "fitting": assumptions.fitting(),
            "fitted": assumptions.fitted(),
            "results": results,
            "again": join(again + (["--beside", str(beside)] if beside else [])),
            "figures": figures.name,
            "beside": str(beside or ""),
            "others": others,
        }
        for path in pages:
            with atomic_write(path) as part:
                part.write_text(render(f"report{path.suffix}", content), encoding="utf-8")
    for path in results.unusable:
        print(f"left out, since it is damaged or holds something else: {path}")
    if not results.used:
        places = ", ".join(map(str, directories))
        print(f"no results found in {places}; the statements that are judged need none")
    print(", ".join(f"{verdict or 'not judged'}: {sum(row)}" for verdict, row in counts.items()))
    print(f"report in {pages[0]} and {pages[1]}")
    return sections


def _section(topic: Topic, results: Results, figures: Path) -> Section:
    """Section of a topic: its figures, drawn into a directory, and the commands that make its tables."""
    name, title, found, tables = topic
    drawn, pictures = [], []
    if name == EVOLUTION:
        drawn = draw_searches(searches_of(tables), figures)
        flags = {"paper": "--out runs/evolve"} | {m: f"--method {m} --out runs/evolve-{m}" for m in METHODS[1:]}
        known = {table.name: table.command for table in tables}
        commands = [known.get(f"evolve-{method}", f"iswarm evolve {flags[method]}") for method in METHODS]
    else:
        first = {GRASP: "iswarm grasp --out runs/grasp"} | {each: f"iswarm experiment {each}" for each in EXPERIMENTS}
        commands = [table.command for table in tables] or [first[each] for each in first if each == name]
    for table in tables:
        title += ": the quick version, with few and short runs" if table.settings.get("quick") else ""
        drawn += draw_table(table, figures)
        for pattern, caption in AT_RUN_TIME.items() if name == "types" else ():
            for path in files_in(table.path.parent, pattern):
                pictures.append(Picture(path, f"{path.stem.split('_')[0].replace('type', 'Type ')}, {caption}"))
    pictures += [Picture(path, CAPTIONS.get(path.stem, path.stem.replace("_", " "))) for path in drawn]
    return Section(title, found, pictures, PAPER_FIGURES.get(name, ""), commands)


def render(template: str, content: dict) -> str:
    """Fill in a template.

    Args:
        template: report.html or report.md.
        content: values of the template's names, see `report`.
    """
    environment = Environment(
        loader=PackageLoader("iswarm_mj.experiments.report"),
        autoescape=select_autoescape(["html"]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"data_uri": data_uri, "prose": prose, "md": markdown.text, "code": markdown.code}
    return environment.get_template(template).render(content)


def data_uri(path: Path) -> str:
    """Content of a picture as a data URI; for a PNG file, that of the SVG file beside it if small enough."""
    drawing = path.with_suffix(".svg")
    if path.suffix == ".png" and drawing.is_file() and drawing.stat().st_size <= SVG_LIMIT:
        path = drawing
    return f"data:{_MIME_TYPES[path.suffix]};base64,{base64.b64encode(path.read_bytes()).decode()}"


def prose(text: str) -> Markup:
    """HTML of a text in which backquotes enclose code."""
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", str(escape(text))))
