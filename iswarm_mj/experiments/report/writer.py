"""The report: every statement of the paper's sections 3.2 and 4.6 beside what the results at hand say."""

from collections.abc import Sequence
from pathlib import Path

from iswarm_mj.experiments.report.html import page
from iswarm_mj.experiments.report.markdown import document
from iswarm_mj.experiments.report.results import collect
from iswarm_mj.experiments.report.sections import Section, sections_of
from iswarm_mj.experiments.report.text import tally_text
from iswarm_mj.utils.files import prepare, whole


def report(directories: Sequence[Path], out: Path) -> list[Section]:
    """Write the report of all results below the directories as HTML, and as Markdown beside it; print a summary.

    The HTML page holds all that it shows. The Markdown file refers to figures in a folder beside it.

    Args:
        directories: where results are looked for.
        out: the HTML file.

    Raises:
        UserError: a directory is not there, or `out` cannot be written to.
    """
    results = collect(directories)
    figures = out.with_name(f"{out.stem}_figures")
    prepare(figures, given=out)
    sections = sections_of(results, figures)
    again = f"iswarm report --results {' '.join(map(str, directories))} --out {out}"
    markdown = out.with_suffix(".md")
    for path, text in (
        (out, page(sections, results, again)),
        (markdown, document(sections, results, again, figures)),
    ):
        with whole(path) as part:
            part.write_text(text, encoding="utf-8")
    print(f"{tally_text(sections)}\nreport in {out} and {markdown}")
    return sections
