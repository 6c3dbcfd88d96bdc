"""Compare the learned strategy with the paper's, in worlds that no training saw.

    python tools/research/compare_policies.py
    python tools/research/compare_policies.py --robots 190 --only type1 neural
    python tools/research/compare_policies.py --only neural no-messages no-vectors no-flag no-memory

It prints a row per strategy, of runs on the planar engine: worlds in which all balls were
delivered; control steps until then, those of the other worlds counted as --steps, and collisions:
medians with 95 % intervals by order statistics; the mean number of balls delivered with its
interval by bootstrap. `knows-all` is the network with robots that are told where dump and nearest
ball are; the rows without something are the network with its shipped weights, or with --weights.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import neural_without as without
import numpy as np
from hop_gradient import HopGradient

from iswarm_mj.config.arena import ArenaConfig
from iswarm_mj.config.swarm import DriveConfig, OpticsConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.neural import Neural, untrained
from iswarm_mj.tasks.cleaning import CLEANING
from iswarm_mj.utils.intervals import interval

FRESH = 2**31 + 1
"""Seed of the worlds; trainings have others, unless they are given such."""
TITLES = ("", "clean worlds", "steps until clean", "collisions", "delivered")


class Untrained(Neural):
    """The network with which training begins."""

    def for_world(self, config, robot, n_robots):
        return untrained(config, robot)


NETWORKS = {
    "neural": Neural,
    "untrained": Untrained,
    "knows-all": without.KnowsAll,
    "no-messages": without.NoMessages,
    "no-vectors": without.NoVectors,
    "no-flag": without.NoFlag,
    "no-memory": without.NoMemory,
}
"""Classes of strategies that take weights."""
DEFAULT_NAMES = ["type1", "type2", "evolved", "hop-gradient", "untrained", "neural", "knows-all"]


def strategy_of(name: str, weights: Path | None) -> Any:
    """Return the strategy of a row."""
    if name in PRESETS:
        return PRESETS[name]
    if name == "hop-gradient":
        return HopGradient()
    return NETWORKS[name](weights)


def config_of(arguments: argparse.Namespace) -> SwarmConfig:
    """Return the configuration that the arguments describe."""
    offset, edge, n_balls = arguments.dust
    arena = ArenaConfig(
        size=arguments.size, dust_area_offset=offset, dust_area_size=edge, n_dust=int(n_balls)
    )
    error = 0.1 * arguments.noise
    optics = OpticsConfig(
        error_distance_measure=error, error_in_communication=error, p_communication_break=error
    )
    return SwarmConfig(arena, DriveConfig(error_turn=arguments.turn_error), optics)


def worlds_of(name: str, arguments: argparse.Namespace) -> list[World]:
    """Return the worlds of a row, which are the same for all strategies."""
    genome = PRESETS.get(name, PRESETS["type1"])
    return [
        World(genome, arguments.robots, FRESH, index, arguments.failed)
        for index in range(arguments.worlds)
    ]


def row(name: str, config: SwarmConfig, arguments: argparse.Namespace) -> str:
    """Return the row of a strategy after a run of all worlds."""
    scenario = Scenario(
        config,
        strategy=strategy_of(name, arguments.weights),
        task=without.Told() if name == "knows-all" else CLEANING,
        robot_file=arguments.robot,
        engine=PlanarSettings(arguments.threads),
        worlds=worlds_of(name, arguments),
        steps=arguments.steps,
    )
    run = Run(scenario, record_worlds=())
    while not run.is_over:
        run.advance()

    measures = [run.measures(world) for world in range(arguments.worlds)]
    n_clean = sum(world.finished_at is not None for world in measures)
    steps = [world.finished_at or arguments.steps for world in measures]
    cells = [
        name,
        f"{n_clean} of {arguments.worlds}",
        with_interval(steps),
        with_interval([world.collisions for world in measures]),
        with_interval([world.delivered for world in measures], np.mean),
    ]
    note = " faults!" if run.faults else ""
    return f"| {' | '.join(cells)} |{note}"


def with_interval(values: Sequence[float], statistic: Any = np.median) -> str:
    """Return a statistic of values with its interval, as text."""
    value, low, high = interval(np.array(values, float), statistic)
    return f"{value:.1f} ({low:.1f} to {high:.1f})"


def parse_arguments() -> argparse.Namespace:
    """Return the conditions of the comparison."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--worlds", type=int, default=48)
    add("--steps", type=int, default=800)
    add("--robots", type=int, default=280)
    add("--size", type=float, default=49.0, help="edge of the arena [rd]")
    dust_help = "offset and edge of the dust areas [rd], balls"
    add("--dust", type=float, nargs=3, default=(12, 6, 72), help=dust_help)
    failed_help = "share of robots that are dead from the start"
    add("--failed", type=float, default=0.0, help=failed_help)
    noise_help = "factor of the errors of distances and messages"
    add("--noise", type=float, default=1.0, help=noise_help)
    turn_help = "standard deviation of executed turns [deg]"
    add("--turn-error", type=float, default=0.0, help=turn_help)
    add("--robot", type=Path, help="MJCF file of other robots")
    add("--weights", type=Path, help="of the networks but `untrained`")
    names = [*PRESETS, "hop-gradient", *NETWORKS]
    add("--only", nargs="+", choices=names, metavar="NAME", default=DEFAULT_NAMES)
    add("--threads", type=int, default=0)
    return parser.parse_args()


def main() -> None:
    """Print the table."""
    arguments = parse_arguments()
    config = config_of(arguments)
    print(f"| {' | '.join(TITLES)} |")
    print("|" + "---|" * len(TITLES))
    for name in arguments.only:
        print(row(name, config, arguments), flush=True)


if __name__ == "__main__":
    main()
