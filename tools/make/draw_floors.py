"""Draw the layers of the package, in the order of the contract in pyproject.toml: docs/floors.svg.

Run `python tools/make/draw_floors.py` after a layer was added, renamed or described differently.
The text can be read on a phone.
"""

import textwrap
import tomllib
from pathlib import Path
from xml.sax.saxutils import escape

ROOT = Path(__file__).resolve().parents[2]
PICTURE = ROOT / "docs" / "floors.svg"
WIDTH = 400
"""Width of the picture [pixels]."""
LETTERS = 48
"""Maximum number of letters in a line."""
LINE = 19
"""Height of a line of text [pixels]."""
PADDING = 14
"""Height of a box without its lines [pixels]."""
GAP = 5
"""Distance between two boxes [pixels]."""
COLOURS = {
    "__main__": "#dbe9f6",
    "output": "#e6f2df",
    "simulation": "#fdeccf",
    "tasks": "#f7dfe3",
    "config": "#ececec",
}
"""Colours of groups of layers, by the first layer of each."""


def layers() -> list[str]:
    """Return the packages from top to bottom."""
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    for contract in settings["tool"]["importlinter"]["contracts"]:
        if contract["containers"] == ["iswarm_mj"]:
            return contract["layers"]
    raise LookupError("pyproject.toml has no contract for the layers of iswarm_mj")


def summary(name: str) -> str:
    """Return the first line of a package's docstring."""
    path = ROOT / "iswarm_mj" / name
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return file.read_text().split('"""')[1].splitlines()[0]


def box(y: int, height: int, colour: str, name: str, lines: list[str]) -> list[str]:
    """Return the SVG elements of a layer.

    Args:
        y: top of the box [pixels].
        height: height of the box [pixels].
        colour: fill of the box.
        name: name of the layer.
        lines: description of the layer.
    """
    size = f'width="{WIDTH - 8}" height="{height}" rx="6"'
    elements = [f'<rect x="4" y="{y}" {size} fill="{colour}"/>']
    baseline = y + LINE + 2
    bold = 'font-size="16" font-weight="bold"'
    elements.append(f'<text x="16" y="{baseline}" {bold}>{escape(name)}</text>')
    for line in lines:
        baseline += LINE
        elements.append(f'<text x="16" y="{baseline}" font-size="15">{escape(line)}</text>')
    return elements


def draw() -> str:
    """Return the picture as SVG text: a box for each layer, which imports only from those below."""
    boxes = []
    y = 6
    colour = ""
    for name in layers():
        colour = COLOURS.get(name, colour)
        lines = textwrap.wrap(summary(name), LETTERS)
        height = LINE * (len(lines) + 1) + PADDING
        boxes += box(y, height, colour, name, lines)
        y += height + GAP

    size = f'width="{WIDTH}" viewBox="0 0 {WIDTH} {y + 2}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif">'
    ground = f'<rect width="{WIDTH}" height="{y + 2}" fill="white"/>'
    return "\n".join([head, ground, *boxes, "</svg>", ""])


if __name__ == "__main__":
    PICTURE.write_text(draw())
