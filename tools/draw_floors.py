"""Draws the layers of the package from its imports: docs/floors.svg. Needs grimp, which comes with import-linter.

Run `python tools/draw_floors.py` after moving files or changing imports.
"""

import tomllib
from collections import Counter
from pathlib import Path
from xml.sax.saxutils import escape

import grimp

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "floors.svg"

ROW, WIDTH, TOP = 34, 680, 46
FILL = "#dbe9f6"
DOT = "#1f5a92"


def layers() -> list[str]:
    """Packages from top to bottom, as in the contract in pyproject.toml."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    return next(contract["layers"] for contract in contracts if contract["containers"] == ["iswarm_mj"])


def count(packages: list[str]) -> tuple[Counter[str], Counter[tuple[str, str]]]:
    """Number of modules in each package, and of imports between packages."""
    graph = grimp.build_graph("iswarm_mj", cache_dir=None)

    def package_of(module: str) -> str:
        return [*module.split("."), ""][1]

    sizes, arrows = Counter(), Counter()
    for module in graph.modules:
        sizes[package_of(module)] += 1
        for other in graph.find_modules_directly_imported_by(module):
            arrows[package_of(module), package_of(other)] += 1
    return sizes, Counter({(a, b): n for (a, b), n in arrows.items() if a != b and a in packages and b in packages})


def summaries(packages: list[str]) -> dict[str, str]:
    """First line of each package's docstring."""
    found = {}
    for name in packages:
        path = ROOT / "iswarm_mj" / name
        file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
        found[name] = file.read_text().split('"""')[1].splitlines()[0]
    return found


def draw(packages: list[str]) -> str:
    """The picture as SVG text: a row for each package, a dot where it imports from the package of the column."""
    sizes, arrows = count(packages)
    text = summaries(packages)
    dots = WIDTH + 30
    width, height = dots + len(packages) * ROW + 20, TOP + len(packages) * ROW + 20
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" font-family="sans-serif">',
        f'<rect width="{width}" height="{height}" fill="white"/>',
        '<text x="10" y="22" font-size="14" font-weight="bold">Layers of iswarm_mj</text>',
        f'<text x="{dots}" y="22" font-size="12">squares: modules; dots: imports from the package of the column</text>',
    ]
    for row, name in enumerate(packages):
        y = TOP + row * ROW
        parts += [
            f'<rect x="10" y="{y}" width="{WIDTH}" height="{ROW - 4}" rx="4" fill="{FILL}"/>',
            f'<text x="20" y="{y + 20}" font-size="13" font-weight="bold">{escape(name)}</text>',
            f'<text x="130" y="{y + 20}" font-size="11">{escape(text[name])}</text>',
        ]
        for column, other in enumerate(packages):
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
    PICTURE.write_text(draw(layers()))
