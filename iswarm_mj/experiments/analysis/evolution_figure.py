"""Fitness over the generations, in the form of the paper's Fig. 14(a)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from iswarm_mj.output.plot_style import figure


def draw_fitness(rows: Sequence[Mapping[str, Any]], n_dust: int, path: Path) -> None:
    """Draw each run as a dot, the best and the mean of each generation as lines; PNG and SVG.

    Args:
        rows: of the table of a search.
        n_dust: balls in the arena; swarms that do not deliver all get 40 n - 20 points at most, the dashed line.
        path: of the files, without suffix.
    """
    generation, fitness = (np.array([row[name] for row in rows]) for name in ("generation", "fitness"))
    numbers = np.unique(generation)
    with figure(path, size=(6.0, 3.6)) as (axes,):
        axes.plot(generation + 1, fitness, ".", color="0.6", markersize=4, label="run")
        axes.plot(numbers + 1, [fitness[generation == g].max() for g in numbers], color="C0", label="best")
        axes.plot(numbers + 1, [fitness[generation == g].mean() for g in numbers], color="C1", label="mean")
        axes.axhline(40 * n_dust - 20, color="0.3", linestyle="--", linewidth=0.8, label="most without the last ball")
        axes.set_xlabel("generation")
        axes.set_ylabel("fitness [points]")
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, fontsize=8)
