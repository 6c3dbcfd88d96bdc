"""Figures of searches in the form of the paper's Fig. 14, and the runs that they show."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from iswarm_mj.experiments.analysis.findings import Row, Rows
from iswarm_mj.output.plot_style import figure

PLATEAU = (35, 100)
"""Generations from which the paper takes its fittest swarms."""
FITTEST = 250


def draw_fitness(rows: Rows, n_dust: int, path: Path) -> None:
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


def draw_search(rows: Rows, settings: Mapping[str, Any], out: Path) -> list[Path]:
    """Draw Fig. 14: fitness over the generations; scouts and forgetting of the fittest."""
    name = f"evolution_{settings['method']}"
    draw_fitness(rows, settings["config"]["arena"]["n_dust"], out / name)
    drawn, top = [out / f"{name}.png"], fittest(rows, *PLATEAU)
    if top and settings["method"] == "paper":
        x, y = (np.array([row[column] for row in top]) for column in ("fraction_scouts", "p_vector_forget"))
        with figure(out / "trade", size=(4.4, 3.6)) as (axes,):
            axes.plot(x, y, "o", markersize=4, alpha=0.5)
            if np.ptp(x) > 0:
                ends = np.array([x.min(), x.max()])
                axes.plot(ends, np.polyval(np.polyfit(x, y, 1), ends), "--", color="0.3", linewidth=1)
            axes.set(xlabel="fraction-scouts", ylabel="p(vector-forget)", xlim=(0, None), ylim=(0, None))
        drawn.append(out / "trade.png")
    return drawn


def fittest(rows: Rows, first: int, last: int) -> list[Row]:
    """The `FITTEST` fittest runs of these generations, the first one being 1; none if the search was shorter."""
    if max(row["generation"] for row in rows) + 1 < last:
        return []
    among = [row for row in rows if first <= row["generation"] + 1 <= last]
    return sorted(among, key=lambda row: -row["fitness"])[:FITTEST]
