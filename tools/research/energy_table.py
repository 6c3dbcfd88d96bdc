"""Print what light does to swarms whose robots have capacitors.

    python tools/research/energy_table.py --worlds 4 --steps 400

The table in Markdown has, for both types, the balls delivered and picked up, the time and the
waiting, of whole runs with the planar engine until 66 balls are delivered.
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
from iswarm_mj.tasks.measures import Measures

GOAL = 66
"""Number of balls after which a world ends."""
CAPACITOR = EnergyConfig(model="capacitor")
LIGHTS = {
    "no capacitors": EnergyConfig(),
    "full light": CAPACITOR,
    "half": replace(CAPACITOR, light_power=CAPACITOR.light_power / 2),
    "a quarter": replace(CAPACITOR, light_power=CAPACITOR.light_power / 4),
    "dark": replace(CAPACITOR, light_power=0.0),
}
TITLES = (
    "type",
    "light",
    "balls delivered",
    "picked up",
    f"worlds that deliver {GOAL}",
    "their steps",
    "waiting for energy",
)


def measure(scenario: Scenario) -> list[Measures]:
    """Return the measures of all worlds of a run."""
    run = Run(scenario, record_worlds=())
    while not run.is_over:
        run.advance()
    return [run.measures(world) for world in range(scenario.n_worlds)]


def row(genome_name: str, light: str, arguments: argparse.Namespace) -> list[str]:
    """Return the row of one type under one light.

    Args:
        genome_name: one of the presets.
        light: one of `LIGHTS`.
        arguments: seed, worlds and steps of the run.
    """
    config = SwarmConfig(energy=LIGHTS[light])
    genome = PRESETS[genome_name]
    n_robots = robots_for(config.arena, genome.density_of_robots)
    scenario = Scenario(
        config,
        strategy=genome,
        robots=n_robots,
        engine=PlanarSettings(),
        seed=arguments.seed,
        worlds=arguments.worlds,
        steps=arguments.steps,
        goal=GOAL,
    )
    worlds = measure(scenario)

    ends = [world.finished_at for world in worlds if world.finished_at is not None]
    n_steps = sum(world.finished_at or arguments.steps for world in worlds)
    waiting = sum(world.starved for world in worlds) / (n_robots * n_steps)
    return [
        genome_name,
        light,
        f"{fmean(world.delivered for world in worlds):.1f}",
        f"{fmean(world.picked for world in worlds):.1f}",
        f"{len(ends)} of {len(worlds)}",
        f"{fmean(ends):.0f} ({min(ends)} to {max(ends)})" if ends else "-",
        f"{100 * waiting:.0f} %",
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--worlds", type=int, default=4)
    parser.add_argument("--steps", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    print(f"| {' | '.join(TITLES)} |")
    print(f"|{' --- |' * len(TITLES)}")
    for genome_name in ("type1", "type2"):
        for light in LIGHTS:
            print(f"| {' | '.join(row(genome_name, light, arguments))} |", flush=True)


if __name__ == "__main__":
    main()
