"""The report: every statement of the paper's sections 3.2 and 4.6 beside the results found for it, as an HTML page that
embeds its figures."""

import base64
from collections.abc import Sequence
from pathlib import Path
from shlex import join
from tempfile import TemporaryDirectory

from jinja2 import Environment, PackageLoader, StrictUndefined

from iswarm_mj import __version__
from iswarm_mj.experiments.analysis.findings import KINDS
from iswarm_mj.experiments.analysis.plots_of_searches import draw_trade
from iswarm_mj.experiments.report.results import EVOLUTION, Topic, collect, files_in, tally, topics_of
from iswarm_mj.utils.files import atomic_write, make_output_directory

OF_RUNS = "type*[0-9].png"
"""Drawings that the experiment on types leaves in its directory."""
SVG_LIMIT = 400_000
"""A drawing whose SVG file is larger than this is embedded as PNG [bytes]."""


def report(directories: Sequence[Path], out: Path) -> list[Topic]:
    """Write a report of all results below the directories, at any depth, as one HTML page; print a summary."""
    results = collect(directories)
    make_output_directory(out.parent, given=out)
    sections = [_section(topic) for topic in topics_of(results)]
    kinds, counts = tally([finding for section in sections for finding in section.findings])
    page = Environment(
        loader=PackageLoader("iswarm_mj.experiments.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    ).get_template("report.html")
    text = page.render(
        version=__version__,
        tally=counts,
        kinds={kind: KINDS[kind] for kind in kinds},
        sections=sections,
        results=results,
        again=join(["iswarm", "report", "--results", *map(str, directories), "--out", str(out)]),
    )
    with atomic_write(out) as part:
        part.write_text(text, encoding="utf-8")
    if not results:
        print(f"no results found in {', '.join(map(str, directories))}; the statements that are judged need none")
    print(", ".join(f"{verdict or 'not judged'}: {sum(row)}" for verdict, row in counts.items()))
    print(f"report in {out}")
    return sections


def _section(topic: Topic) -> Topic:
    """A topic with the figures of its tables."""
    pictures: dict[str, Path] = {}
    with TemporaryDirectory() as directory:
        for result in topic.results:
            drawn = Path(directory, result.name)
            drawn.mkdir()
            result.draw(drawn)
            of_runs = files_in(result.path.parent, OF_RUNS) if topic.name == "types" else ()
            paths = (*sorted(drawn.glob("*.png")), *of_runs)
            pictures |= {f"{result.name}, {path.stem.replace('_', ' ')}": path for path in paths}
        if topic.name == EVOLUTION:
            draw_trade(topic.data.get("paper", ()), Path(directory, "trade"))
            if (trade := Path(directory, "trade.png")).is_file():
                pictures["Forgetting and scouts among the fittest"] = trade
        embedded = [{"name": name, "content": data_uri(path)} for name, path in pictures.items()]
    quick = ": the quick version, with few and short runs" * any(r.settings.get("quick") for r in topic.results)
    return topic._replace(title=topic.title + quick, pictures=embedded)


def data_uri(path: Path) -> str:
    """Content of a PNG file as a data URI; that of the SVG file beside it if this is small enough."""
    drawing, kind = path.with_suffix(".svg"), "png"
    if drawing.is_file() and drawing.stat().st_size <= SVG_LIMIT:
        path, kind = drawing, "svg+xml"
    return f"data:image/{kind};base64,{base64.b64encode(path.read_bytes()).decode()}"
