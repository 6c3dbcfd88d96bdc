"""Draw the figures of all tables of results, each beside its table: `python tools/make/redraw_figures.py results`.

Drawings of single runs stay as they are, since tables do not have them. Of the SVG files those are kept that git has.
"""

import subprocess
import sys
from pathlib import Path

from iswarm_mj.paper.report.results import collect

if __name__ == "__main__":
    results = Path(sys.argv[1])
    kept = set(results.glob("**/*.svg"))
    for result in collect([results]).values():
        result.draw(result.path.parent)
    for path in set(results.glob("**/*.svg")) - kept:
        path.unlink()
    subprocess.run(["git", "status", "--short", results], check=True)
