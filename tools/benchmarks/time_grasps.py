"""Time what trials cost in a cleaning run, against the balance of forces.

    taskset -c 1 python tools/benchmarks/time_grasps.py --engine mujoco --pairs 5

It prints the processor time of a control step by trials and by the balance, of runs that take
turns: whole runs of type 1, from the second control step to the 66th ball, on one thread; a JSON
line for each engine.

    taskset -c 1 python tools/benchmarks/time_grasps.py --engine --batch 256

It makes random attempts in one batch of MJX, and prints how large its program is, how long it
compiles and runs, and how many attempts end as in C.
"""

import argparse
import json
import sys
import time
from typing import Any, NamedTuple

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
    "planar": PlanarSettings(1),
    "planar-fine": PlanarSettings(1, refinement=10),
}
GOAL = 66
"""Number of balls after which a run ends."""
MAX_STEPS = 1200
"""Control steps of a run at most."""
MAX_VOLTAGE = 69.0
"""Largest voltage of an attempt; the ball melts above it [V]."""


class Timed(NamedTuple):
    """A run that was timed."""

    ms_per_step: float
    """Processor time of a control step [ms]."""
    n_attempts: int
    """Number of attempts to lift and to release."""
    n_steps: int


def time_run(engine: str, resolution: str, seed: int) -> Timed:
    """Time a whole run of type 1.

    Args:
        engine: one of `ENGINES`.
        resolution: "dynamic" for trials, "quasi-static" for the balance of forces.
        seed: seed of the run.
    """
    config = SwarmConfig(gripper=GripperConfig(resolution=resolution))
    genome = PRESETS["type1"]
    scenario = Scenario(
        config,
        strategy=genome,
        robots=robots_for(config.arena, genome.density_of_robots),
        engine=ENGINES[engine],
        seed=seed,
        steps=MAX_STEPS,
        goal=GOAL,
    )
    run = Run(scenario, record_worlds=())
    run.advance()  # which compiles

    started = time.process_time()
    while not run.is_over:
        run.advance()
    seconds = time.process_time() - started
    measures = run.measures(0)
    n_attempts = measures.attempts + measures.releases
    return Timed(1e3 * seconds / (run.step - 1), n_attempts, run.step)


def compare(engine: str, n_pairs: int) -> dict[str, Any]:
    """Time pairs of runs of a seed each, by the balance and by trials, and return their medians."""
    time_run(engine, "dynamic", 0)  # which loads everything
    balances = []
    trials = []
    for seed in range(n_pairs):
        balances.append(time_run(engine, "quasi-static", seed))
        trials.append(time_run(engine, "dynamic", seed))
        times = f"{balances[-1].ms_per_step:.2f} ms, {trials[-1].ms_per_step:.2f} ms"
        print(f"{engine}, seed {seed}: {times}", file=sys.stderr)

    ms_of_balances = np.array([run.ms_per_step for run in balances])
    ms_of_trials = np.array([run.ms_per_step for run in trials])
    ratios = ms_of_trials / ms_of_balances
    pairs = zip(balances, trials, strict=True)
    return {
        "engine": engine,
        "ms_per_step_quasi_static": round(float(np.median(ms_of_balances)), 2),
        "ms_per_step_dynamic": round(float(np.median(ms_of_trials)), 2),
        "ratio": round(float(np.median(ratios)), 3),
        "ratios": [round(float(ratio), 3) for ratio in ratios],
        "attempts_and_releases": float(np.median([run.n_attempts for run in trials])),
        "steps": [[balance.n_steps, trial.n_steps] for balance, trial in pairs],
    }


def random_attempts(count: int) -> Attempts:
    """Return attempts to lift and to release, at voltages about the threshold of each."""
    rng = np.random.default_rng(0)
    radius = rng.uniform(15e-6, 25e-6, count)
    lifts = rng.random(count) < 0.5
    work_tool = np.full(count, WORK_TOOL_OBJECT)
    work_floor = np.full(count, WORK_OBJECT_SUBSTRATE)
    threshold = np.where(
        lifts, grasp_voltage(radius, work_tool, work_floor), release_voltage(radius, work_tool)
    )
    voltage = np.minimum(threshold * np.exp(rng.uniform(-0.3, 0.3, count)), MAX_VOLTAGE)
    numbers = (voltage, radius, work_tool, work_floor, np.zeros(count))
    return Attempts(lifts, ~lifts, *(np.asarray(values, np.float32) for values in numbers))


def time_batch(count: int) -> dict[str, Any]:
    """Return size and processor times of a batch's program, and how many outcomes are those in C."""
    attempts = random_attempts(count)
    gripper = GripperConfig(resolution="dynamic", bench_capacity=count)
    jax.config.update("jax_enable_compilation_cache", False)
    lowered = jax.jit(lambda *arrays: by_batch(gripper, Attempts(*arrays))).lower(*attempts)

    times = [time.process_time()]
    program = lowered.compile()
    times.append(time.process_time())
    batch = jax.block_until_ready(program(*attempts))
    times.append(time.process_time())
    s_compiling, s_running = np.diff(times).round(2).tolist()

    in_c = outcomes(gripper.release_gap, attempts)
    are_lifts_same = np.asarray(batch.lifted) == in_c.lifted
    are_releases_same = np.asarray(batch.released) == in_c.released
    return {
        "attempts": count,
        "lines": lowered.as_text().count("\n"),
        "s_compiling": s_compiling,
        "s_running": s_running,
        "as_in_c": int((are_lifts_same & are_releases_same).sum()),
    }


def main() -> None:
    """Print a line for the batch, and one for each engine."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--engine", nargs="*", default=["mujoco"], choices=list(ENGINES))
    parser.add_argument("--pairs", type=int, default=5)
    parser.add_argument("--batch", type=int, help="attempts in one batch of MJX")
    arguments = parser.parse_args()
    if arguments.batch:
        print(json.dumps(time_batch(arguments.batch)), flush=True)
    for engine in arguments.engine:
        print(json.dumps(compare(engine, arguments.pairs)), flush=True)


if __name__ == "__main__":
    main()
