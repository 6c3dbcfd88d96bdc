"""Draw the figures of all tables of results, each in the folder of its table.

    python tools/make/redraw_figures.py results

Drawings of single runs stay as they are, since tables do not have them. Of the SVG files only those
stay that were there before.
"""

import subprocess
import sys
from pathlib import Path

from iswarm_mj.paper.report.results import collect_results

if __name__ == "__main__":
    results = Path(sys.argv[1])
    svg_files_before = set(results.glob("**/*.svg"))
    for result in collect_results([results]).values():
        result.draw(result.path.parent)
    for path in results.glob("**/*.svg"):
        if path not in svg_files_before:
            path.unlink()
    subprocess.run(["git", "status", "--short", results], check=True)
