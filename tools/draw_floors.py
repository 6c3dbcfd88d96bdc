"""Draws the floors of the package from its imports: docs/floors.svg. Needs grimp, which comes with import-linter.

Run `python tools/draw_floors.py` after files were moved or began to import others.
"""

import tomllib
from collections import Counter
from pathlib import Path
from xml.sax.saxutils import escape

import grimp

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "floors.svg"

ROW, WIDTH, TOP = 34, 680, 46
FLOOR = "#dbe9f6"
DOT = "#1f5a92"


def floors() -> list[str]:
    """Rooms from the top to the bottom, as the contract in pyproject.toml has them."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    return next(contract["layers"] for contract in contracts if contract["containers"] == ["iswarm_mj"])


def count(rooms: list[str]) -> tuple[Counter[str], Counter[tuple[str, str]]]:
    """Number of modules in each room, and of imports from room to room."""
    graph = grimp.build_graph("iswarm_mj")

    def room(module: str) -> str:
        return [*module.split("."), ""][1]

    sizes, arrows = Counter(), Counter()
    for module in graph.modules:
        sizes[room(module)] += 1
        for other in graph.find_modules_directly_imported_by(module):
            arrows[room(module), room(other)] += 1
    return sizes, Counter({(a, b): n for (a, b), n in arrows.items() if a != b and a in rooms and b in rooms})


def summaries(rooms: list[str]) -> dict[str, str]:
    """First line of the docstring of each room."""
    found = {}
    for name in rooms:
        path = ROOT / "iswarm_mj" / name
        file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        found[name] = file.read_text().split('"""')[1].splitlines()[0]
    return found


def draw(rooms: list[str]) -> str:
    """The picture as SVG text: a row for each room, a dot where it imports from the room of the column."""
    sizes, arrows = count(rooms)
    text = summaries(rooms)
    dots = WIDTH + 30
    width, height = dots + len(rooms) * ROW + 20, TOP + len(rooms) * ROW + 20
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        '<text x="10" y="22" font-size="14" font-weight="bold">Floors of iswarm_mj</text>',
        f'<text x="{dots}" y="22" font-size="12">squares: modules; dots: imports from the room of the column</text>',
    ]
    for row, name in enumerate(rooms):
        y = TOP + row * ROW
        parts += [
            f'<rect x="10" y="{y}" width="{WIDTH}" height="{ROW - 4}" rx="4" fill="{FLOOR}"/>',
            f'<text x="20" y="{y + 20}" font-size="13" font-weight="bold">{escape(name)}</text>',
            f'<text x="130" y="{y + 20}" font-size="11">{escape(text[name])}</text>',
        ]
        for column, other in enumerate(rooms):
            n, x = arrows[name, other], dots + column * ROW + ROW // 2
            if n:
                parts += [
                    f'<circle cx="{x}" cy="{y + 15}" r="{min(14, 6 + n**0.5):.1f}" fill="{DOT}"><title>{escape(name)} '
                    f"imports {escape(other)}: {n}</title></circle>",
                    f'<text x="{x}" y="{y + 19}" font-size="10" fill="white" text-anchor="middle">{n}</text>',
                ]
            elif column == row:
                parts.append(
                    f'<text x="{x}" y="{y + 19}" font-size="11" text-anchor="middle">{sizes[name]}</text>'
                    f'<rect x="{x - 13}" y="{y + 2}" width="26" height="26" fill="none" stroke="{DOT}"/>'
                )
    return "\n".join([*parts, "</svg>", ""])


if __name__ == "__main__":
    PICTURE.write_text(draw(floors()))
