"""Draw the layers of the package, in the order of the contract in pyproject.toml: docs/floors.svg.

    python tools/make/draw_floors.py

Run it after a layer was added, renamed or described differently. The text can be read on a phone.
"""

import argparse
import textwrap
import tomllib
from pathlib import Path
from typing import NamedTuple
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


class Box(NamedTuple):
    """The box of a layer."""

    name: str
    """Name of the layer."""
    lines: list[str]
    """Description of the layer."""
    colour: str

    @property
    def height(self) -> int:
        """Height [pixels]."""
        return LINE * (len(self.lines) + 1) + PADDING

    def elements(self, y: int) -> list[str]:
        """Return the SVG elements of the box, whose top is at a height [pixels]."""
        size = f'width="{WIDTH - 8}" height="{self.height}" rx="6"'
        elements = [f'<rect x="4" y="{y}" {size} fill="{self.colour}"/>']
        baseline = y + LINE + 2
        bold = 'font-size="16" font-weight="bold"'
        elements.append(f'<text x="16" y="{baseline}" {bold}>{escape(self.name)}</text>')
        for line in self.lines:
            baseline += LINE
            elements.append(f'<text x="16" y="{baseline}" font-size="15">{escape(line)}</text>')
        return elements


def draw() -> str:
    """Return the picture as SVG text: a box for each layer, which imports only from those below."""
    elements = []
    y = 6
    colour = ""
    for name in layers():
        colour = COLOURS.get(name, colour)
        box = Box(name, textwrap.wrap(summary(name), LETTERS), colour)
        elements += box.elements(y)
        y += box.height + GAP

    size = f'width="{WIDTH}" viewBox="0 0 {WIDTH} {y + 2}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif">'
    ground = f'<rect width="{WIDTH}" height="{y + 2}" fill="white"/>'
    return "\n".join([head, ground, *elements, "</svg>", ""])


def main() -> None:
    """Write the picture."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=PICTURE, help="the picture")
    parser.parse_args().out.write_text(draw())


if __name__ == "__main__":
    main()
