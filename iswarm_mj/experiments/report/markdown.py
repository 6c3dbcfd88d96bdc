"""Text of anyone in Markdown: it is read as it stands, and is no markup."""

import re
from collections.abc import Sequence


def text(value: object) -> str:
    """A value in one line of a page or a cell of a table; tags, links and pictures in it are shown as text."""
    line = re.sub(r"<(?=[A-Za-z/!?])", "&lt;", " ".join(str(value).split())).replace("](", "]\\(")
    return re.sub(r"(?<!\\)\|", r"\\|", line)


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(text(cell) for cell in line) + " |" for line in lines)
