"""Draw the figures of all tables of results, each in the folder of its table.

    python tools/make/redraw_figures.py results

Drawings of single runs stay as they are, since tables do not have them. Of the SVG files only those
stay that were there before.
"""

import argparse
import subprocess
from pathlib import Path

from iswarm_mj.paper.report.results import collect_results


def redraw(directory: Path) -> None:
    """Draw the figures of all tables in a directory and below."""
    svg_files_before = set(directory.glob("**/*.svg"))
    for result in collect_results([directory]).values():
        result.draw(result.path.parent)
    for path in set(directory.glob("**/*.svg")) - svg_files_before:
        path.unlink()


def main() -> None:
    """Draw the figures, and list those that have changed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("directory", type=Path, help="results, in a clone of the repository")
    directory = parser.parse_args().directory
    redraw(directory)
    subprocess.run(["git", "status", "--short", directory], check=True)


if __name__ == "__main__":
    main()
