"""`iswarm report`."""

from dataclasses import dataclass
from pathlib import Path

from iswarm_mj.utils.errors import UserError


@dataclass(frozen=True)
class Report:
    """Put all results beside the paper's statements: one HTML page, and Markdown beside it."""

    results: tuple[Path, ...] = (Path("runs"),)
    """Directories with results of `iswarm experiment`, `iswarm evolve` and `iswarm grasp`, at any depth."""
    out: Path = Path("report.html")
    """The page; the Markdown file and a folder of its figures get names from it."""

    def run(self) -> None:
        """Run the command."""
        if not self.results:
            raise UserError("--results was empty; it must be one or more directories with results: give at least one.")
        if self.out.suffix != ".html":
            raise UserError(f"--out was {self.out}; it must be a name ending in .html: give such a one.")
        from iswarm_mj.experiments.report.writer import report

        report(self.results, self.out)
