"""Swarms whose grasps are trials against swarms whose grasps the balance of the forces decides.

    python tools/compare_grasps.py --seeds 24 --preset type1 --rh 10 30 50 --volts 30 40 55 --engine mujoco

For each humidity and voltage it prints medians of paired runs, and the 95 % interval of the mean difference.
"""

import argparse
import json
import time
from dataclasses import replace

import numpy as np
from scipy.stats import bootstrap

from iswarm_mj.config import ArenaConfig, GripperConfig, SwarmConfig
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.settings import MujocoSettings, PlanarSettings, RunSettings
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.layout import robots_for

SPOT = {"spot_spread_tool_object": 0.12, "spot_spread_object_substrate": 0.16, "tool_error": 0.02}
"""All spread of adhesion from attempt to attempt, none from ball to ball."""


def one(args, seed, humidity, volts, resolution):
    """Finishing time, attempts a ball, failed grasps, seconds of one run."""
    gripper = GripperConfig(
        relative_humidity=humidity,
        grasp_voltage=min(volts, 69.0),
        resolution=resolution,
        spread_tool_object=0.0,
        spread_object_substrate=0.0,
        grasp_time=args.grasp_time,
        release_time=args.grasp_time,
        **SPOT,
    )
    config = SwarmConfig(gripper=gripper)
    if args.small:
        arena = ArenaConfig(size=15, dump_size=3, dust_area_size=3, dust_area_offset=5, n_dust=24)
        config = replace(config, arena=arena)
    genome = PRESETS[args.preset]
    n_robots = robots_for(config.arena, genome.density_of_robots)
    engine = MujocoSettings() if args.engine == "mujoco" else PlanarSettings()
    stop_at = round(config.arena.n_dust * 66 / 72)
    run = Run(config, genome, RunSettings(n_robots, args.steps, seed, stop_at=stop_at, record_worlds=()), engine)
    run.advance()  # which compiles
    started = time.perf_counter()
    while not run.is_over:
        run.advance()
    seconds = time.perf_counter() - started
    found = run.measures(0)
    end = found.finished_at or args.steps
    picked = max(found.picked, 1)
    return end, found.attempts / picked, found.failed_grasps, found.failed_releases, found.work_time, seconds


NAMES = ("steps", "attempts a ball", "failed grasps", "failed releases", "time of trials [s]", "wall [s]")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=24)
    parser.add_argument("--preset", default="type1", choices=("type1", "type2"))
    parser.add_argument("--rh", type=float, nargs="+", default=[10, 30, 50])
    parser.add_argument("--volts", type=float, nargs="+", default=[30, 40, 55])
    parser.add_argument("--engine", default="planar", choices=("planar", "mujoco"))
    parser.add_argument("--steps", type=int, default=800)
    parser.add_argument("--grasp-time", type=float, default=0.0, help="of an attempt [s]")
    parser.add_argument("--small", action="store_true", help="an arena of 15 x 15 rd with 24 balls")
    args = parser.parse_args()
    for humidity in args.rh:
        for volts in args.volts:
            both = np.array(
                [
                    [one(args, seed, humidity, volts, kind) for kind in ("quasi-static", "dynamic")]
                    for seed in range(args.seeds)
                ]
            )
            row = {"rh": humidity, "volts": volts, "preset": args.preset, "seeds": args.seeds, "engine": args.engine}
            for k, name in enumerate(NAMES):
                static, dynamic = both[:, 0, k], both[:, 1, k]
                row[name] = [round(float(np.median(static)), 3), round(float(np.median(dynamic)), 3)]
                if args.seeds > 2 and np.ptp(dynamic - static) > 0:
                    ends = bootstrap((dynamic - static,), np.mean, rng=np.random.default_rng(0)).confidence_interval
                    row[name].append([round(float(end), 3) for end in ends])
            print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
