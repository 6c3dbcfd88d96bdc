"""Figures of results drawn anew from their tables."""

from pathlib import Path

from iswarm_mj.experiments.analysis.evolution_figures import draw_fitness
from iswarm_mj.experiments.report.results import collect
from iswarm_mj.experiments.runner.search import FIGURE
from iswarm_mj.experiments.studies.registry import EXPERIMENTS
from iswarm_mj.output.plot_trials import draw_figures
from iswarm_mj.utils.files import remove


def redraw(results: Path) -> list[Path]:
    """Draw the figures of all tables below a directory, each beside its table; return the paths of the PNG files.

    Drawings and pictures of single runs stay as they are, since tables do not have them. An SVG file is kept where one
    was before.

    Raises:
        UserError: there is no such directory, or a file cannot be written.
    """
    found, drawn = collect([results]), []
    kept = set(results.glob("**/*.svg"))
    for name, result in found.experiments.items():
        drawn += EXPERIMENTS[name].draw(result.rows, result.path.parent)
    for result in found.searches.values():
        n_dust = result.settings.get("config", {}).get("arena", {}).get("n_dust", 72)
        draw_fitness(result.rows, n_dust, result.path.parent / FIGURE)
        drawn.append(result.path.parent / f"{FIGURE}.png")
    if found.trials is not None:
        drawn += draw_figures(found.trials.rows, found.trials.settings, found.trials.path.parent)
    for path in drawn:
        if (drawing := path.with_suffix(".svg")) not in kept:
            remove(drawing)
    return drawn
