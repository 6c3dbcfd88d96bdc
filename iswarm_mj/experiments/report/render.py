"""The report as an HTML page that embeds all its figures but videos, and as Markdown that links to them."""

import base64
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup, escape

from iswarm_mj.experiments.report import markdown
from iswarm_mj.experiments.report.reproduction import command

SVG_LIMIT = 400_000
"""A drawing whose SVG file is larger than this is embedded as PNG [bytes]."""
_MIME_TYPES = {".png": "image/png", ".svg": "image/svg+xml"}


def render(template: str, content: Mapping[str, Any]) -> str:
    """Fill in a template.

    Args:
        template: report.html or report.md.
        content: values of the template's names, see `writer.content_of`.
    """
    environment = Environment(
        loader=PackageLoader("iswarm_mj.experiments.report"),
        autoescape=select_autoescape(["html"]),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "command": command,
        "data_uri": data_uri,
        "prose": prose,
        "md": markdown.text,
        "code": markdown.code,
        "target": markdown.target,
    }
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
