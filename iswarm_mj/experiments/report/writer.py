"""The report: every statement of the paper's sections 3.2 and 4.6 beside the results found for it, as an HTML page that
embeds its figures."""

import base64
from collections.abc import Sequence
from pathlib import Path
from shlex import join
from tempfile import TemporaryDirectory
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from iswarm_mj import __version__
from iswarm_mj.experiments.analysis.findings import KINDS
from iswarm_mj.experiments.analysis.plots_of_searches import draw_trade
from iswarm_mj.experiments.report.results import (
    EVOLUTION,
    Picture,
    Topic,
    collect,
    files_in,
    searches_of,
    tally,
    topics_of,
)
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
OF_RUNS = "type*[0-9].png"
"""Drawings that the experiment on types leaves in its directory."""
SVG_LIMIT = 400_000
"""A drawing whose SVG file is larger than this is embedded as PNG [bytes]."""
_MIME_TYPES = {".png": "image/png", ".svg": "image/svg+xml"}


def report(directories: Sequence[Path], out: Path) -> list[Topic]:
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
        part.write_text(_render(content), encoding="utf-8")
    if not results:
        print(f"no results found in {', '.join(map(str, directories))}; the statements that are judged need none")
    print(", ".join(f"{verdict or 'not judged'}: {sum(row)}" for verdict, row in counts.items()))
    print(f"report in {out}")
    return sections


def _section(topic: Topic) -> Topic:
    """A topic with the figures of its tables."""
    pictures = []
    with TemporaryDirectory() as directory:
        for result in topic.results:
            drawn = Path(directory, result.name)
            drawn.mkdir()
            result.draw(drawn)
            of_runs = files_in(result.path.parent, OF_RUNS) if topic.name == "types" else ()
            for path in (*sorted(drawn.glob("*.png")), *of_runs):
                pictures.append(Picture(f"{result.name}, {path.stem.replace('_', ' ')}", data_uri(path)))
        if topic.name == EVOLUTION:
            draw_trade(searches_of(topic.results), Path(directory, "trade"))
            for path in Path(directory).glob("trade.png"):
                pictures.append(Picture("Forgetting and scouts among the fittest", data_uri(path)))
    quick = ": the quick version, with few and short runs" * any(r.settings.get("quick") for r in topic.results)
    return topic._replace(title=topic.title + quick, pictures=pictures)


def _render(content: dict) -> str:
    """Fill in the template of the page."""
    loader = PackageLoader("iswarm_mj.experiments.report")
    how: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True, "keep_trailing_newline": True}
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, **how)
    return environment.get_template("report.html").render(content)


def data_uri(path: Path) -> str:
    """Content of a picture as a data URI; for a PNG file, that of the SVG file beside it if small enough."""
    drawing = path.with_suffix(".svg")
    if path.suffix == ".png" and drawing.is_file() and drawing.stat().st_size <= SVG_LIMIT:
        path = drawing
    return f"data:{_MIME_TYPES[path.suffix]};base64,{base64.b64encode(path.read_bytes()).decode()}"
