"""What trials cost in a cleaning run: processor time of a control step by trials and by the
balance, alternately.

    taskset -c 1 python tools/benchmarks/time_grasps.py --engine mujoco --pairs 5

Whole runs of type 1, from the second control step to the 66th ball, on one thread; a JSON line for
each engine.

    taskset -c 1 python tools/benchmarks/time_grasps.py --engine --batch 256

Random attempts in one batch of MJX: how large its program is, how long it compiles and runs, which
of them end as in C.
"""

import argparse
import json
import sys
import time

import jax
import numpy as np

from iswarm_mj.config.swarm import GripperConfig, SwarmConfig
from iswarm_mj.engines.mujoco.settings import MujocoSettings
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.gripper.attempts import Attempts
from iswarm_mj.gripper.bench.batch_trials import by_batch
from iswarm_mj.gripper.bench.swarm_trials import outcomes
from iswarm_mj.gripper.laws.detachment import (
    WORK_OBJECT_SUBSTRATE,
    WORK_TOOL_OBJECT,
    grasp_voltage,
    release_voltage,
)
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.strategy.genome import PRESETS
from iswarm_mj.tasks.layout import robots_for

ENGINES = {
    "mujoco": MujocoSettings(1),
    "planar": PlanarSettings(1, refinement=1),
    "planar-fine": PlanarSettings(1, refinement=10),
}
GOAL, LIMIT = 66, 1200


def one(engine, resolution, seed):
    """Processor time of a control step [ms], and attempts of a run."""
    config, genome = SwarmConfig(gripper=GripperConfig(resolution=resolution)), PRESETS["type1"]
    n_robots = robots_for(config.arena, genome.density_of_robots)
    scenario = Scenario(
        config,
        strategy=genome,
        robots=n_robots,
        engine=ENGINES[engine],
        seed=seed,
        steps=LIMIT,
        goal=GOAL,
    )
    run = Run(scenario, record_worlds=())
    run.advance()  # which compiles
    started = time.process_time()
    while not run.is_over:
        run.advance()
    seconds = time.process_time() - started
    found = run.measures(0)
    made = found.attempts + found.releases
    return 1e3 * seconds / (run.step - 1), made, run.step


def batch(count):
    """Size and times of a batch's program, in processor time, and its outcomes against those in
    C."""
    random, gripper = (
        np.random.default_rng(0),
        GripperConfig(resolution="dynamic", bench_capacity=count),
    )
    radius, lifts = random.uniform(15e-6, 25e-6, count), random.random(count) < 0.5
    tool, floor = WORK_TOOL_OBJECT * np.ones(count), WORK_OBJECT_SUBSTRATE * np.ones(count)
    threshold = np.where(lifts, grasp_voltage(radius, tool, floor), release_voltage(radius, tool))
    voltage = np.minimum(threshold * np.exp(random.uniform(-0.3, 0.3, count)), 69.0)
    numbers = (np.asarray(a, np.float32) for a in (voltage, radius, tool, floor, np.zeros(count)))
    attempts = Attempts(lifts, ~lifts, *numbers)
    jax.config.update("jax_enable_compilation_cache", False)
    lowered = jax.jit(lambda *arrays: by_batch(gripper, Attempts(*arrays))).lower(*attempts)
    times = [time.process_time()]
    program = lowered.compile()
    times.append(time.process_time())
    found = jax.block_until_ready(program(*attempts))
    times.append(time.process_time())
    theirs = outcomes(gripper.release_gap, attempts)
    same = (np.asarray(found.lifted) == theirs.lifted) & (
        np.asarray(found.released) == theirs.released
    )
    seconds = np.diff(times).round(2).tolist()
    return {
        "attempts": count,
        "lines": lowered.as_text().count("\n"),
        "s_compiling": seconds[0],
        "s_running": seconds[1],
        "as_in_c": int(same.sum()),
    }


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--engine", nargs="*", default=["mujoco"], choices=list(ENGINES))
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--batch", type=int, help="attempts in one batch of MJX")
    args = parser.parse_args()
    if args.batch:
        print(json.dumps(batch(args.batch)), flush=True)
    for engine in args.engine:
        one(engine, "dynamic", 0)  # which loads everything
        found = []
        for seed in range(args.pairs):
            found.append([one(engine, kind, seed) for kind in ("quasi-static", "dynamic")])
            print(
                f"{engine}, seed {seed}: " + ", ".join(f"{run[0]:.2f} ms" for run in found[-1]),
                file=sys.stderr,
            )
        both = np.array(found)
        ratios = both[:, 1, 0] / both[:, 0, 0]
        row = {
            "engine": engine,
            "ms_per_step_quasi_static": round(float(np.median(both[:, 0, 0])), 2),
            "ms_per_step_dynamic": round(float(np.median(both[:, 1, 0])), 2),
            "ratio": round(float(np.median(ratios)), 3),
            "ratios": [round(float(ratio), 3) for ratio in ratios],
            "attempts_and_releases": float(np.median(both[:, 1, 1])),
            "steps": both[:, :, 2].astype(int).tolist(),
        }
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
