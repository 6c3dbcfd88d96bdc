"""Compare finishing times at the default time step with those at finer physics steps.

    python tools/research/compare_time_steps.py --worlds 512 --impl warp --out time-steps.csv
    python tools/research/compare_time_steps.py --densities 0.3 --presets type1 --refinement 4

It prints a row for each density and preset, and writes them to --out: worlds that delivered 66 of
72 balls within --steps control steps, and the geometric means of the control steps until then, at
the default and at the finer steps; then the ratio of the means with its 95 % interval, by bootstrap
over the worlds. A world that did not deliver them counts with --steps. Both begin from the same
layouts.

The rule of the verdict: the default has `converged` if the interval of the ratio lies between 0.95
and 1.05, it `differs` if the interval does not touch that range, and is `undecided` otherwise.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from iswarm_mj.config.swarm import SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.engines.settings import REFINEMENT
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.tables import write_csv
from iswarm_mj.workflows.rollout import rollout

GOAL = 66
"""Number of delivered balls at which a world ends (section 4.6.1 of the paper)."""
SEED = 2**31 + 51
"""Seed of the worlds, which no other study has."""
EQUIVALENCE = (0.95, 1.05)
"""Range of ratios within which both are taken for equal."""
N_RESAMPLES = 10_000
"""Number of resamples of the bootstrap."""
DENSITIES = (0.05, 0.118, 0.2, 0.3, 0.4)


def steps_to_goal(
    preset: str, n_robots: int, refinement: int, arguments: argparse.Namespace
) -> np.ndarray:
    """Return the control steps that each world took (B,); 0 for worlds that did not finish."""
    genome = PRESETS[preset]
    worlds = [World(genome, n_robots, SEED, index) for index in range(arguments.worlds)]
    scenario = Scenario(
        strategy=genome,
        engine=PlanarSettings(refinement=refinement, impl=arguments.impl),
        worlds=worlds,
        steps=arguments.steps,
        goal=GOAL,
    )
    result = rollout(scenario, every=min(arguments.steps, 50))
    if result.faults:
        raise SystemExit(f"{len(result.faults)} worlds failed: {result.faults[0]}")
    return np.where(result.is_finished, result.finished_at, 0)


def geometric_mean(steps: np.ndarray) -> float:
    """Return the geometric mean of numbers of steps."""
    return float(np.exp(np.log(steps).mean()))


def ratio_interval(default: np.ndarray, finer: np.ndarray) -> tuple[float, float]:
    """Return the 95 % interval of the ratio of geometric means, default over finer."""
    rng = np.random.default_rng(0)
    logs = np.log(default), np.log(finer)
    resampled = [rng.choice(values, (N_RESAMPLES, len(values))).mean(axis=1) for values in logs]
    low, high = np.quantile(np.exp(resampled[0] - resampled[1]), [0.025, 0.975])
    return float(low), float(high)


def verdict(low: float, high: float) -> str:
    """Return the verdict on a ratio with this interval."""
    least, greatest = EQUIVALENCE
    if least <= low and high <= greatest:
        return "converged"
    if high < least or low > greatest:
        return "differs"
    return "undecided"


def row(preset: str, density: float, arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the row of a density and a preset, by the titles of the columns."""
    n_robots = robots_for(SwarmConfig().arena, density)
    raw = [
        steps_to_goal(preset, n_robots, refinement, arguments)
        for refinement in (REFINEMENT, arguments.refinement)
    ]
    default, finer = (np.where(steps > 0, steps, arguments.steps) for steps in raw)
    low, high = ratio_interval(default, finer)
    return {
        "preset": preset,
        "density": density,
        "robots": n_robots,
        "worlds": arguments.worlds,
        "finished": int(np.count_nonzero(raw[0])),
        "finished, finer": int(np.count_nonzero(raw[1])),
        "steps": round(geometric_mean(default), 1),
        "steps, finer": round(geometric_mean(finer), 1),
        "ratio": round(geometric_mean(default) / geometric_mean(finer), 3),
        "low": round(low, 3),
        "high": round(high, 3),
        "verdict": verdict(low, high),
    }


def parse_arguments(words: Sequence[str] | None = None) -> argparse.Namespace:
    """Return what is compared."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--worlds", type=int, default=48, help="number of worlds of each row")
    add("--steps", type=int, default=1200, help="maximum number of control steps")
    add("--densities", type=float, nargs="+", default=DENSITIES)
    add("--presets", nargs="+", choices=[*PRESETS], default=["type1", "type2"])
    add("--refinement", type=int, default=10, help="parts of a physics step in the finer runs")
    add("--out", type=Path, help="CSV file of the rows")
    add("--impl", choices=["numba", "warp"], default="numba")
    return parser.parse_args(words)


def main() -> None:
    """Print and write the table."""
    arguments = parse_arguments()
    rows = []
    for density in arguments.densities:
        for preset in arguments.presets:
            rows.append(row(preset, density, arguments))
            print(rows[-1], flush=True)
            if arguments.out is not None:
                write_csv(arguments.out, rows)


if __name__ == "__main__":
    main()
