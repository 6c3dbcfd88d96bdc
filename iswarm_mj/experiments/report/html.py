"""The report as one HTML page that holds all it shows."""

import base64
import re
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

from iswarm_mj.experiments.analysis.findings import FAILS, HOLDS, Finding
from iswarm_mj.experiments.report import assumptions
from iswarm_mj.experiments.report.assumptions import Setting
from iswarm_mj.experiments.report.results import Results, command
from iswarm_mj.experiments.report.sections import Picture, Section
from iswarm_mj.experiments.report.text import INTRODUCTION, TITLE, read_tables, tally

MOST_SVG = 400_000
"""Drawings with a larger SVG file than this are shown as PNG [bytes]."""
_TYPES = {".png": "image/png", ".svg": "image/svg+xml", ".mp4": "video/mp4"}


def page(sections: Sequence[Section], results: Results, again: str) -> str:
    """HTML of the report.

    Args:
        sections: of the report.
        results: the tables that it was made of.
        again: command that makes the report again.
    """
    numbered = list(enumerate(sections, 1))
    tail = ("Chosen where the paper is silent", "Fitted, and not fitted", "Results that were read")
    links = [(f"s{n}", section.title) for n, section in numbered] + [(f"t{n}", title) for n, title in enumerate(tail)]
    contents = "".join(f'<li><a href="#{anchor}">{escape(title)}</a></li>' for anchor, title in links)
    counts = "".join(f"<li><b>{count}</b>{_verdict(verdict)}</li>" for verdict, count in tally(sections))
    parts = [
        *(f"<p>{escape(paragraph)}</p>" for paragraph in INTRODUCTION),
        f'<ul class="tally">{counts}</ul>',
        f"<nav><ol>{contents}</ol></nav>",
        *(_section(f"s{n}", section) for n, section in numbered),
        f'<h2 id="t0">{tail[0]}</h2>{_silences()}',
        f'<h2 id="t1">{tail[1]}</h2><p>{_prose(assumptions.fitting())}</p>{_table(assumptions.fitted())}',
        f'<h2 id="t2">{tail[2]}</h2>{_read(results)}',
        f"<footer><p>Made again by <code>{escape(again)}</code></p></footer>",
    ]
    template = files("iswarm_mj.experiments.report").joinpath("report.html").read_text(encoding="utf-8")
    return Template(template).substitute(title=escape(TITLE), body="\n".join(parts))


def embedded(path: Path) -> str:
    """Content of a picture or video as a data URI; the SVG file beside a PNG file, if it is not too large."""
    drawing = path.with_suffix(".svg")
    if path.suffix == ".png" and drawing.is_file() and drawing.stat().st_size <= MOST_SVG:
        path = drawing
    return f"data:{_TYPES[path.suffix]};base64,{base64.b64encode(path.read_bytes()).decode()}"


def _section(anchor: str, section: Section) -> str:
    rows = "".join(map(_finding, section.findings))
    heads = "".join(f"<th>{head}</th>" for head in ("Statement", "The paper", "Ours", "Statistics", "Verdict"))
    parts = [
        f'<h2 id="{anchor}">{escape(section.title)}</h2>',
        f'<div class="wide"><table class="claims"><tr>{heads}</tr>{rows}</table></div>',
    ]
    figures = "".join(map(_figure, section.pictures))
    ours = f'<div class="ours"><h3>Ours</h3><div class="figures">{figures or "<p>not run yet</p>"}</div></div>'
    if section.paper:
        theirs = f'<div class="theirs"><h3>The paper</h3><p>{escape(section.paper)}</p></div>'
        parts.append(f'<div class="beside">{theirs}{ours}</div>')
    elif figures:
        parts.append(f'<div class="beside alone">{ours}</div>')
    if not section.commands:
        return "\n".join(parts)
    commands = "<br>".join(f"<code>{escape(line)}</code>" for line in section.commands)
    parts.append(f"<p>Run again: {commands}</p>")
    return "\n".join(parts)


def _finding(finding: Finding) -> str:
    cells = (finding.paper, finding.ours, finding.statistics)
    body = "".join(f"<td>{escape(cell)}</td>" for cell in cells)
    claim = f'{escape(finding.claim)}<span class="source">{escape(finding.source)}</span>'
    return f"<tr><td>{claim}</td>{body}<td>{_verdict(finding.verdict)}</td></tr>"


def _verdict(verdict: str) -> str:
    kind = {HOLDS: "holds", FAILS: "fails"}.get(verdict, "open")
    return f'<span class="verdict {kind}">{escape(verdict or "not judged")}</span>'


def _figure(picture: Picture) -> str:
    source, caption = embedded(picture.path), escape(picture.caption)
    shown = (
        f'<video controls loop muted preload="metadata" src="{source}"></video>'
        if picture.path.suffix == ".mp4"
        else f'<img src="{source}" alt="{caption}">'
    )
    return f"<figure>{shown}<figcaption>{caption}</figcaption></figure>"


def _silences() -> str:
    listed = "".join(f"<li>{_prose(rule)}</li>" for rule in (*assumptions.RULES, *assumptions.operators()))
    return f"<ul>{listed}</ul>{_table(assumptions.assumed())}"


def _prose(text: str) -> str:
    """What stands between backquotes is code."""
    return re.sub("`([^`]+)`", r"<code>\1</code>", escape(text))


def _table(listed: Sequence[Setting]) -> str:
    rows = "".join(
        f"<tr><td><code>{escape(choice.name)}</code></td><td>{escape(choice.value)}</td><td>{_prose(choice.meaning)}</td></tr>"
        for choice in listed
    )
    return f'<div class="wide"><table><tr><th>Name</th><th>Value</th><th>Meaning</th></tr>{rows}</table></div>'


def _read(results: Results) -> str:
    heads = "".join(f"<th>{head}</th>" for head in ("Table", "Rows", "Version", "Made by"))
    rows = "".join(
        f"<tr><td><code>{escape(str(result.path))}</code></td><td>{len(result.rows)}</td>"
        f"<td>{escape(result.settings['version'])}</td><td><code>{escape(command(result))}</code></td></tr>"
        for result in read_tables(results)
    )
    left = ", ".join(f"<code>{escape(str(path))}</code>" for path in results.left_out)
    note = f"<p>Left out, since another table of the kind has more runs: {left}</p>" if left else ""
    return f'<div class="wide"><table><tr>{heads}</tr>{rows}</table></div>{note}'
