"""The learning curve of a policy."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.ticker import MaxNLocator

from iswarm_mj.experiments.analysis.plots import BLUE, ORANGE
from iswarm_mj.output.plot_style import figure


def draw_learning(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Draw fitness, and the balls picked up and delivered, over the generations; PNG and SVG.

    Args:
        rows: of learning.csv.
        path: of the files, without suffix.
    """
    generation = [row["generation"] for row in rows]

    def of(name: str) -> list[float]:
        return [row[name] for row in rows]

    caption = "Lines: means of a generation; band: from its worst to its best candidate."
    with figure(path, columns=2, size=(3.6, 3.0), caption=caption) as (left, right):
        left.fill_between(generation, of("worst"), of("best"), color=BLUE, alpha=0.2, linewidth=0)
        left.plot(generation, of("mean"), color=BLUE)
        left.set_ylabel("fitness [points]")
        for name, hue in (("picked", ORANGE), ("delivered", BLUE)):
            right.plot(generation, of(name), color=hue, label=name)
        right.set_ylabel("balls")
        right.legend(fontsize=8)
        for axes in (left, right):
            axes.set_xlabel("generation")
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
            axes.set_ylim(bottom=0)
