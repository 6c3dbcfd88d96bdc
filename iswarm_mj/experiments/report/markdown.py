"""The report as Markdown, with its figures in a folder beside it."""

import shutil
from collections.abc import Iterable, Sequence
from pathlib import Path

from iswarm_mj.experiments.report import assumptions
from iswarm_mj.experiments.report.results import Results, command
from iswarm_mj.experiments.report.sections import Picture, Section
from iswarm_mj.experiments.report.text import INTRODUCTION, TITLE, read_tables, tally_text


def document(sections: Sequence[Section], results: Results, again: str, figures: Path) -> str:
    """Markdown of the report.

    Args:
        sections: of the report.
        results: the tables that it was made of.
        again: command that makes the report again.
        figures: folder beside the document; figures from elsewhere are copied into it.
    """
    parts = [f"# {TITLE}", *INTRODUCTION]
    parts.append(f"{tally_text(sections)}.".capitalize())
    for section in sections:
        parts += [f"## {section.title}", _findings(section)]
        if section.paper:
            parts.append(f"The paper: {section.paper}")
        parts += [_figure(picture, figures) for picture in section.pictures]
        if section.commands:
            parts.append("Run again: " + ", ".join(f"`{line}`" for line in section.commands))
    names = ("Name", "Value", "Meaning")
    parts += [
        "## Chosen where the paper is silent",
        "\n".join(f"- {rule}" for rule in (*assumptions.RULES, *assumptions.operators())),
        _table(names, ((f"`{c.name}`", c.value, c.meaning) for c in assumptions.assumed())),
        "## Fitted, and not fitted",
        assumptions.fitting(),
        _table(names, ((f"`{c.name}`", c.value, c.meaning) for c in assumptions.fitted())),
        "## Results that were read",
        _table(
            ("Table", "Rows", "Version", "Made by"),
            ((f"`{r.path}`", str(len(r.rows)), r.settings["version"], f"`{command(r)}`") for r in read_tables(results)),
        ),
        f"Made again by `{again}`",
    ]
    return "\n\n".join(parts) + "\n"


def _findings(section: Section) -> str:
    heads = ("Statement", "Source", "The paper", "Ours", "Statistics", "Verdict")
    rows = (
        (*finding[:-1], f"**{finding.verdict}**" if finding.verdict else "not judged") for finding in section.findings
    )
    return _table(heads, rows)


def _figure(picture: Picture, figures: Path) -> str:
    path = picture.path
    if path.parent != figures:
        path = Path(shutil.copy(path, figures / path.name))
    link = f"{figures.name}/{path.name}"
    return f"[{picture.caption}]({link})" if path.suffix == ".mp4" else f"![{picture.caption}]({link})"


def _table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [heads, ["---"] * len(heads), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)
