"""The report: every statement of sections 3.2 and 4.6 beside the results, as one HTML page."""

import base64
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from jinja2 import Environment, PackageLoader, StrictUndefined

from iswarm_mj._version import __version__
from iswarm_mj.paper.analysis.findings import KINDS
from iswarm_mj.paper.analysis.plots import draw_trade_off
from iswarm_mj.paper.report.results import (
    EVOLUTION,
    Topic,
    collect_results,
    count_verdicts,
    files_in,
    topics_of,
)
from iswarm_mj.utils.files import atomic_write, check_name, make_output_directory
from iswarm_mj.utils.operating_system import shell_line

DRAWINGS_OF_TYPES = "type*[0-9].png"
"""Pattern of the drawings that the experiment on types leaves in its directory."""


def write_report(directories: Sequence[Path], out: Path) -> list[Topic]:
    """Write a report of all results below the directories, and print a summary.

    Args:
        directories: where results are, at any depth.
        out: path of the page.

    Returns:
        The sections of the page.
    """
    check_name(out, ".html")
    results = collect_results(directories)
    make_output_directory(out.parent, given=out)
    sections = [_with_figures(topic) for topic in topics_of(results)]
    all_findings = [finding for section in sections for finding in section.findings]
    kinds, counts = count_verdicts(all_findings)

    environment = Environment(
        loader=PackageLoader("iswarm_mj.paper.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    page = environment.get_template("report.html").render(
        version=__version__,
        tally=counts,
        kinds={kind: KINDS[kind] for kind in kinds},
        sections=sections,
        results=results,
        again=shell_line(
            ["iswarm", "report", "--results", *map(str, directories), "--out", str(out)]
        ),
    )
    with atomic_write(out) as part:
        part.write_text(page, encoding="utf-8")

    # Print how many statements have which verdict.
    if not results:
        places = ", ".join(map(str, directories))
        print(f"no results found in {places}; the statements that are judged need none")
    print(", ".join(f"{verdict or 'not judged'}: {sum(row)}" for verdict, row in counts.items()))
    print(f"report in {out}")
    return sections


def _with_figures(topic: Topic) -> Topic:
    """Return a topic with the figures of its tables."""
    with TemporaryDirectory() as directory:
        pictures = [
            {"name": name, "content": _as_data_url(path)}
            for name, path in _draw_figures(topic, Path(directory))
        ]
    is_quick = any(result.is_quick for result in topic.results)
    suffix = ": the quick version, with few and short runs" if is_quick else ""
    return topic._replace(title=topic.title + suffix, pictures=pictures)


def _draw_figures(topic: Topic, directory: Path) -> Iterator[tuple[str, Path]]:
    """Draw the figures of a topic into a directory; yield their names and paths."""
    for result in topic.results:
        out = directory / result.name
        out.mkdir()
        result.draw(out)
        paths = sorted(out.glob("*.png"))
        if topic.name == "types":
            paths += files_in(result.path.parent, DRAWINGS_OF_TYPES)
        for path in paths:
            yield f"{result.name}, {path.stem.replace('_', ' ')}", path

    if topic.name == EVOLUTION:
        draw_trade_off(topic.data.get("paper", ()), directory / "trade")
        path = directory / "trade.png"
        if path.is_file():
            yield "Forgetting and scouts among the fittest", path


def _as_data_url(path: Path) -> str:
    """Return the content of a PNG file as a URL."""
    content = base64.b64encode(path.read_bytes()).decode()
    return f"data:image/png;base64,{content}"
