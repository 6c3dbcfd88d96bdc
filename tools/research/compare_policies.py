"""The learned strategy against the paper's, in worlds that no training saw, on the planar engine.

    python tools/research/compare_policies.py
    python tools/research/compare_policies.py --robots 190 --only type1 neural
    python tools/research/compare_policies.py --only neural no-messages no-vectors no-flag no-memory

A row per strategy: worlds in which all balls were delivered; control steps until then, those of the
other worlds counted as --steps, and collisions: medians with 95 % intervals by order statistics;
the mean number of balls delivered with its interval by bootstrap.
`knows-all` is the network with robots that are told where dump and nearest ball are; the rows
without something are the network with its shipped weights, or with --weights.
"""

import argparse
from pathlib import Path

import neural_without as without
import numpy as np
from hop_gradient import HopGradient

from iswarm_mj.config.arena import ArenaConfig
from iswarm_mj.config.swarm import DriveConfig, OpticsConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.paper.analysis.statistics import interval
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.strategy.neural import Neural, untrained
from iswarm_mj.tasks.cleaning import CLEANING

FRESH = 2**31 + 1
"""Seed of the worlds; trainings have others, unless they are given such."""


class Untrained(Neural):
    """The network with which training begins."""

    def for_world(self, config, robot, n_robots):
        return untrained(config, robot)


OTHERS = {name: (genome, None) for name, genome in PRESETS.items()} | {
    "hop-gradient": (None, HopGradient())
}
NETWORKS = {
    "neural": Neural,
    "untrained": Untrained,
    "knows-all": without.KnowsAll,
    "no-messages": without.NoMessages,
    "no-vectors": without.NoVectors,
    "no-flag": without.NoFlag,
    "no-memory": without.NoMemory,
}


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--worlds", type=int, default=48)
    parser.add_argument("--steps", type=int, default=800)
    parser.add_argument("--robots", type=int, default=280)
    parser.add_argument("--size", type=float, default=49.0, help="edge of the arena [rd]")
    parser.add_argument(
        "--dust", type=float, nargs=3, default=(12, 6, 72), help="offset, edge of areas [rd], balls"
    )
    parser.add_argument(
        "--failed", type=float, default=0.0, help="share of robots that are dead from the start"
    )
    parser.add_argument(
        "--noise", type=float, default=1.0, help="times the errors of distances and messages"
    )
    parser.add_argument(
        "--turn-error", type=float, default=0.0, help="standard deviation of executed turns [deg]"
    )
    parser.add_argument("--robot", type=Path, help="MJCF file of other robots")
    parser.add_argument("--weights", type=Path, help="of the networks but `untrained`")
    parser.add_argument(
        "--only",
        nargs="+",
        default=["type1", "type2", "evolved", "hop-gradient", "untrained", "neural", "knows-all"],
    )
    parser.add_argument("--threads", type=int, default=0)
    args = parser.parse_args()
    light = OpticsConfig(
        error_distance_measure=0.1 * args.noise,
        error_in_communication=0.1 * args.noise,
        p_communication_break=0.1 * args.noise,
    )
    offset, edge, balls = args.dust
    arena = ArenaConfig(
        size=args.size, dust_area_offset=offset, dust_area_size=edge, n_dust=int(balls)
    )
    config = SwarmConfig(arena, DriveConfig(error_turn=args.turn_error), light)
    print("| | clean worlds | steps until clean | collisions | delivered |\n|---|---|---|---|---|")
    for name in args.only:
        genome, strategy = OTHERS[name] if name in OTHERS else (None, NETWORKS[name](args.weights))
        worlds = [
            World(genome or PRESETS["type1"], args.robots, FRESH, index, args.failed)
            for index in range(args.worlds)
        ]
        scenario = Scenario(
            config,
            strategy=genome if strategy is None else strategy,
            task=without.Told() if name == "knows-all" else CLEANING,
            robot_file=args.robot,
            engine=PlanarSettings(args.threads),
            worlds=worlds,
            steps=args.steps,
        )
        run = Run(scenario, record_worlds=())
        while not run.is_over:
            run.advance()
        found = [run.measures(world) for world in range(args.worlds)]
        clean = sum(one.finished_at is not None for one in found)
        steps = told([one.finished_at or args.steps for one in found])
        collisions = told([one.collisions for one in found])
        delivered = told([one.delivered for one in found], np.mean)
        faults = " faults!" * bool(run.faults)
        print(
            f"| {name} | {clean} of {args.worlds} | {steps} | {collisions} | {delivered} |{faults}",
            flush=True,
        )


def told(values, statistic=np.median):
    """A statistic of values with its interval."""
    return "{:.1f} ({:.1f} to {:.1f})".format(*interval(np.array(values, float), statistic))


if __name__ == "__main__":
    main()
