"""`iswarm inspect`."""

from dataclasses import dataclass
from pathlib import Path

import tyro


@dataclass(frozen=True)
class Inspect:
    """Say what a directory of results holds: what ran, its measures and faults, its files and how to open them."""

    directory: tyro.conf.Positional[Path] = Path("runs")
    """The --out of a command, also of an interrupted one, or a directory of several."""

    def run(self) -> None:
        """Run the command."""
        from iswarm_mj.experiments.report.inspection import inspection

        print(inspection(self.directory))
