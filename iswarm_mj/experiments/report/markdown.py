"""Text of anyone in Markdown: it is read as it stands, and is no markup."""

import re
from collections.abc import Sequence


def text(value: object) -> str:
    """A value in one line of a page or a cell of a table; tags, links and pictures in it are shown as text."""
    line = re.sub(r"<(?=[A-Za-z/!?])", "&lt;", " ".join(str(value).split())).replace("](", "]\\(")
    return re.sub(r"(?<!\\)\|", r"\\|", line)


def code(value: object) -> str:
    """A value as code, which may contain backquotes itself."""
    line = " ".join(str(value).split())
    fence = "`" * (1 + max(map(len, re.findall("`+", line)), default=0))
    space = " " if line.startswith("`") or line.endswith("`") or not line else ""
    return f"{fence}{space}{line}{space}{fence}"


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(text(cell) for cell in line) + " |" for line in lines)
