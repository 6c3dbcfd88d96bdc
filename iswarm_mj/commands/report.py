"""`iswarm report`."""

from dataclasses import dataclass
from pathlib import Path

from iswarm_mj.utils.constraints import check


@dataclass(frozen=True)
class Report:
    """Put all results beside the paper's statements: one HTML page, and Markdown beside it."""

    results: tuple[Path, ...] = (Path("runs"),)
    """Directories with results of `iswarm experiment`, `iswarm evolve` and `iswarm grasp`, at any depth."""
    beside: Path | None = None
    """Directory of other results, such as those with another --reading, whose verdicts stand beside the first ones."""
    out: Path = Path("report.html")
    """The page; the Markdown file and a folder of its figures and of videos get names from it."""

    def run(self) -> None:
        """Run the command."""
        check("results", "nothing", "at least one directory", bool(self.results))
        check("out", self.out, "a name that ends in .html", self.out.suffix == ".html")
        check("beside", self.beside, "an existing directory", self.beside is None or self.beside.is_dir())
        from iswarm_mj.experiments.report.writer import report

        report(self.results, self.out, self.beside)
