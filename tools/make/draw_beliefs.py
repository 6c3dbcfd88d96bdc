"""Draw what robots of the learned strategy believe and say: docs/beliefs.png.

    python tools/make/draw_beliefs.py

It is one world of the paper's arena with 280 robots: after 10, 30 and 60 control steps, how each
robot doubts its vectors to dust and dump, and which robots send the flag.
"""

import argparse
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection

from iswarm_mj.config.swarm import ArenaConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.beliefs import MAX_DOUBT
from iswarm_mj.strategy.neural import Neural
from iswarm_mj.utils.units import RD

STEPS = (10, 30, 60)
"""Control steps after which the swarm is drawn."""
N_ROBOTS = 280
SEED = 5
OUT = Path(__file__).parents[2] / "docs" / "beliefs.png"
TITLES = ("doubt of dust", "doubt of the dump", "flag")


class Belief(NamedTuple):
    """Beliefs of robots about a place."""

    is_known: Bool[np.ndarray, "N"]
    doubt: Float[np.ndarray, "N"]


class Moment(NamedTuple):
    """The swarm after a control step."""

    x: Float[np.ndarray, "N"]
    """Positions [rd]."""
    y: Float[np.ndarray, "N"]
    dust: Belief
    dump: Belief
    sends_flag: Bool[np.ndarray, "N"]
    is_loaded: Bool[np.ndarray, "N"]


def moments(run: Run) -> dict[int, Moment]:
    """Return the swarm of the first world after each of `STEPS`, by their numbers."""
    moment_of = {}
    while not run.is_over:
        n_before = run.step
        record = run.advance()
        for step in STEPS:
            if n_before < step <= run.step:
                moment_of[step] = _moment(record, step - n_before - 1)
    return moment_of


def _moment(record, index: int) -> Moment:
    """Return the swarm after one of the steps of a record."""
    x, y = record.poses[index, 0, :, :2].T / RD
    memory = record.swarm.memory

    def of_first_world(values) -> np.ndarray:
        return np.asarray(values[index, 0])

    return Moment(
        x,
        y,
        dust=Belief(of_first_world(memory.dust.known), of_first_world(memory.dust.doubt)),
        dump=Belief(of_first_world(memory.dump.known), of_first_world(memory.dump.doubt)),
        sends_flag=of_first_world(memory.flag),
        is_loaded=of_first_world(record.swarm.is_loaded),
    )


def draw_belief(axes: Axes, moment: Moment, belief: Belief) -> PathCollection:
    """Draw robots shaded by their doubt, those that know nothing as pale rings."""
    knows = belief.is_known
    x, y = moment.x, moment.y
    axes.scatter(x[~knows], y[~knows], s=9, facecolors="none", edgecolors="0.75", linewidths=0.6)
    shades = {"cmap": "viridis_r", "vmin": 0, "vmax": MAX_DOUBT}
    return axes.scatter(x[knows], y[knows], s=10, c=belief.doubt[knows], **shades)


def draw_flags(axes: Axes, moment: Moment) -> None:
    """Draw robots coloured by their flag and their load."""
    flag, loaded = moment.sends_flag, moment.is_loaded
    for colour, is_drawn in (
        ("0.8", ~flag & ~loaded),
        ("tab:blue", flag & ~loaded),
        ("tab:orange", flag & loaded),
        ("tab:red", ~flag & loaded),
    ):
        axes.scatter(moment.x[is_drawn], moment.y[is_drawn], s=10, color=colour)


def draw_areas(axes: Axes, arena: ArenaConfig) -> None:
    """Outline the dump and the dust areas."""
    half = arena.dump_size / 2
    _outline(axes, (-half, -half), 2 * half)
    for side in (-1, 1):
        left = side * arena.dust_area_offset - arena.dust_area_size / 2
        _outline(axes, (left, -arena.dust_area_size / 2), arena.dust_area_size)
    axes.set_aspect("equal")


def _outline(axes: Axes, corner: tuple[float, float], edge: float) -> None:
    """Outline a square by its lower left corner."""
    axes.add_patch(plt.Rectangle(corner, edge, edge, fill=False, lw=0.8))


def draw(run: Run, out: Path) -> None:
    """Draw a row for each of `STEPS` of a run that has not begun."""
    size = (7.2, 7.6)
    figure, axes = plt.subplots(
        len(STEPS), 3, figsize=size, layout="constrained", sharex=True, sharey=True
    )
    for row, (step, moment) in zip(axes, moments(run).items(), strict=True):
        draw_belief(row[0], moment, moment.dust)
        shades = draw_belief(row[1], moment, moment.dump)
        draw_flags(row[2], moment)
        row[0].set_ylabel(f"after {step} steps\ny [rd]")
        for panel in row:
            draw_areas(panel, run.config.arena)

    for panel, title in zip(axes[0], TITLES, strict=True):
        panel.set_title(title, fontsize=10)
    for panel in axes[-1]:
        panel.set_xlabel("x [rd]")
    label = "doubt; pale rings know nothing"
    figure.colorbar(shades, ax=axes[:, :2], orientation="horizontal", shrink=0.6, label=label)
    figure.savefig(out, dpi=110)


def main() -> None:
    """Run the world and write the picture."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=OUT, help="the picture")
    arguments = parser.parse_args()
    scenario = Scenario(
        strategy=Neural(), robots=N_ROBOTS, engine=PlanarSettings(), seed=SEED, steps=max(STEPS)
    )
    draw(Run(scenario), arguments.out)
    print(arguments.out)


if __name__ == "__main__":
    main()
