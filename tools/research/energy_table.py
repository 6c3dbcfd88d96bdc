"""What light does to swarms whose robots have capacitors: balls delivered and picked up, time,
waiting, by both types.

    python tools/research/energy_table.py --worlds 4 --steps 400

Whole runs with the planar engine, until 66 balls are delivered; prints a table in Markdown.
"""

import argparse
from dataclasses import replace
from statistics import fmean

from iswarm_mj.config.swarm import EnergyConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.layout import robots_for

GOAL = 66
USUAL = EnergyConfig(model="capacitor")
LIGHTS = {
    "no capacitors": EnergyConfig(),
    "full light": USUAL,
    "half": replace(USUAL, light_power=USUAL.light_power / 2),
    "a quarter": replace(USUAL, light_power=USUAL.light_power / 4),
    "dark": replace(USUAL, light_power=0.0),
}
HEAD = (
    "type",
    "light",
    "balls delivered",
    "picked up",
    "worlds that deliver 66",
    "their steps",
    "waiting for energy",
)


def row(name, light, args):
    """What worlds of one type come to under one light."""
    config, genome = SwarmConfig(energy=LIGHTS[light]), PRESETS[name]
    n_robots = robots_for(config.arena, genome.density_of_robots)
    scenario = Scenario(
        config,
        strategy=genome,
        robots=n_robots,
        engine=PlanarSettings(refinement=1),
        seed=args.seed,
        worlds=args.worlds,
        steps=args.steps,
        goal=GOAL,
    )
    run = Run(scenario, record_worlds=())
    while not run.is_over:
        run.advance()
    found = [run.measures(world) for world in range(args.worlds)]
    ends = [m.finished_at for m in found if m.finished_at is not None]
    steps = sum(m.finished_at or args.steps for m in found)
    waits = sum(m.starved for m in found) / (n_robots * steps)
    balls = (
        f"{fmean(values):.1f}"
        for values in ([m.delivered for m in found], [m.picked for m in found])
    )
    time = f"{fmean(ends):.0f} ({min(ends)} to {max(ends)})" if ends else "-"
    return (name, light, *balls, f"{len(ends)} of {args.worlds}", time, f"{100 * waits:.0f} %")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=4)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    print(f"| {' | '.join(HEAD)} |\n|{' --- |' * len(HEAD)}")
    for name in ("type1", "type2"):
        for light in LIGHTS:
            print(f"| {' | '.join(row(name, light, args))} |", flush=True)


if __name__ == "__main__":
    main()
