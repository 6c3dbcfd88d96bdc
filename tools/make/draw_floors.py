"""Draws the layers of the package, as the contract in pyproject.toml orders them: docs/floors.svg.

Run `python tools/make/draw_floors.py` after a layer is added, renamed or described anew. The text can be read on a
phone.
"""

import textwrap
import tomllib
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parents[2]
PICTURE = ROOT / "docs" / "floors.svg"
WIDTH, LETTERS, LINE = 400, 48, 19
COLOURS = {  # of groups of layers, by the first of them
    "__main__": "#dbe9f6",
    "output": "#e6f2df",
    "simulation": "#fdeccf",
    "tasks": "#f7dfe3",
    "config": "#ececec",
}


def layers() -> list[str]:
    """Packages from top to bottom."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    return next(contract["layers"] for contract in contracts if contract["containers"] == ["iswarm_mj"])


def summary(name: str) -> str:
    """First line of a package's docstring."""
    path = ROOT / "iswarm_mj" / name
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return file.read_text().split('"""')[1].splitlines()[0]


def draw() -> str:
    """The picture as SVG text: a row for each layer, which imports only from those below it."""
    parts, y, colour = [], 6, ""
    for name in layers():
        colour = COLOURS.get(name, colour)
        lines = textwrap.wrap(summary(name), LETTERS)
        height = LINE * (len(lines) + 1) + 14
        parts.append(f'<rect x="4" y="{y}" width="{WIDTH - 8}" height="{height}" rx="6" fill="{colour}"/>')
        parts.append(f'<text x="16" y="{y + LINE + 2}" font-size="16" font-weight="bold">{escape(name)}</text>')
        for k, line in enumerate(lines, 2):
            parts.append(f'<text x="16" y="{y + k * LINE + 2}" font-size="15">{escape(line)}</text>')
        y += height + 5
    size = f'width="{WIDTH}" viewBox="0 0 {WIDTH} {y + 2}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif">'
    return "\n".join([head, f'<rect width="{WIDTH}" height="{y + 2}" fill="white"/>', *parts, "</svg>", ""])


if __name__ == "__main__":
    PICTURE.write_text(draw())
