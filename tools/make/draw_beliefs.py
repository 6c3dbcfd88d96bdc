"""Draw what robots of the learned strategy believe and say: docs/beliefs.png.

    python tools/make/draw_beliefs.py

One world of the paper's arena with 280 robots: after 10, 30 and 60 control steps, how each robot
doubts its vectors to dust and dump, and which robots send the flag.
"""

from pathlib import Path

import numpy as np
from matplotlib import pyplot as plt

from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.beliefs import MAX_DOUBT
from iswarm_mj.strategy.neural import Neural
from iswarm_mj.utils.units import RD

STEPS = (10, 30, 60)
OUT = Path(__file__).parents[2] / "docs" / "beliefs.png"


def main():
    """Draw a row for each step."""
    run = Run(
        Scenario(strategy=Neural(), robots=280, engine=PlanarSettings(), seed=5, steps=max(STEPS))
    )
    figure, axes = plt.subplots(
        3, 3, figsize=(7.2, 7.6), layout="constrained", sharex=True, sharey=True
    )
    arena = run.config.arena
    while not run.is_over:
        before, record = run.step, run.advance()
        for step in STEPS:
            if not before < step <= run.step:
                continue
            index = step - before - 1
            x, y = record.poses[index, 0, :, :2].T / RD
            memory = record.swarm.memory
            row = axes[STEPS.index(step)]
            for panel, name in zip(row, ("dust", "dump"), strict=False):
                belief = getattr(memory, name)
                known, doubt = (
                    np.asarray(belief.known[index, 0]),
                    np.asarray(belief.doubt[index, 0]),
                )
                panel.scatter(
                    x[~known], y[~known], s=9, facecolors="none", edgecolors="0.75", linewidths=0.6
                )
                shades = panel.scatter(
                    x[known],
                    y[known],
                    s=10,
                    c=doubt[known],
                    cmap="viridis_r",
                    vmin=0,
                    vmax=MAX_DOUBT,
                )
            flag, loaded = (
                np.asarray(memory.flag[index, 0]),
                np.asarray(record.swarm.is_loaded[index, 0]),
            )
            for colour, which in (
                ("0.8", ~flag & ~loaded),
                ("tab:blue", flag & ~loaded),
                ("tab:orange", flag & loaded),
                ("tab:red", ~flag & loaded),
            ):
                row[2].scatter(x[which], y[which], s=10, color=colour)
            row[0].set_ylabel(f"after {step} steps\ny [rd]")
            for panel in row:
                half = arena.dump_size / 2
                panel.add_patch(
                    plt.Rectangle((-half, -half), 2 * half, 2 * half, fill=False, lw=0.8)
                )
                for side in (-1, 1):
                    corner = (
                        side * arena.dust_area_offset - arena.dust_area_size / 2,
                        -arena.dust_area_size / 2,
                    )
                    panel.add_patch(
                        plt.Rectangle(
                            corner, arena.dust_area_size, arena.dust_area_size, fill=False, lw=0.8
                        )
                    )
                panel.set_aspect("equal")
    titles = ("doubt of dust", "doubt of the dump", "flag")
    for panel, title in zip(axes[0], titles, strict=True):
        panel.set_title(title, fontsize=10)
    for panel in axes[-1]:
        panel.set_xlabel("x [rd]")
    figure.colorbar(
        shades,
        ax=axes[:, :2],
        orientation="horizontal",
        shrink=0.6,
        label="doubt; pale rings know nothing",
    )
    figure.savefig(OUT, dpi=110)
    print(OUT)


if __name__ == "__main__":
    main()
