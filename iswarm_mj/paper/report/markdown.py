"""Markdown tables."""

import re
from collections.abc import Sequence

_TAG = re.compile(r"<(?=[A-Za-z/!?])")
_BARE_PIPE = re.compile(r"(?<!\\)\|")


def cell_text(value: object) -> str:
    """Return a value as one line of a page or a cell of a table.

    Tags, links and pictures in it are shown as text.
    """
    line = " ".join(str(value).split())
    line = _TAG.sub("&lt;", line).replace("](", "]\\(")
    return _BARE_PIPE.sub(r"\\|", line)


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """Return a Markdown table."""
    lines = []
    for cells in [head, ["---"] * len(head), *rows]:
        lines.append(f"| {' | '.join(cell_text(cell) for cell in cells)} |")
    return "\n".join(lines)
