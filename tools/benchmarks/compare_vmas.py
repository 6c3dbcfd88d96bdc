"""Environment steps per second on one core: VMAS, the environments of this package, and its runs
without these.

    python -m venv vmas && vmas/bin/pip install torch vmas    # the CPU's torch will do
    taskset -c 0 python tools/benchmarks/compare_vmas.py --vmas vmas/bin/python
    python tools/benchmarks/compare_vmas.py --chunk 25 --agents 20 --worlds 512    # without VMAS;
    on an NVIDIA GPU

Each is a process that is kept, and they take turns, so that other work on the machine slows all
alike; numbers are medians over the rounds. A step is one of all agents of one world. All act at
random: VMAS in `simple_world_comm`, the scenario of its own with messages whose number of agents is
    free; robots here in cleaning on the planar engine, which
speak four bits each; and the same robots in a run, with a strategy that draws the same motions and
messages. With `--chunk`, programs of so many steps are compiled by JAX and Warp, and actions are
drawn in them.
"""

import argparse
import statistics
import subprocess
import sys
import time
from typing import ClassVar

from iswarm_mj.strategy.base import Strategy

WARM_UP = 3
"""Steps before time is taken, which compile."""


def vmas_stepper(n_agents, n_worlds, chunk):
    """Return what takes a step of all worlds of VMAS."""
    import torch
    import vmas

    torch.set_num_threads(1)
    good = n_agents // 5
    env = vmas.make_env(
        "simple_world_comm",
        n_worlds,
        device="cpu",
        num_good_agents=good,
        num_adversaries=n_agents - good,
        seed=0,
    )
    env.reset()
    return lambda: env.step(env.get_random_actions())


def env_stepper(n_agents, n_worlds, chunk):
    """Return what takes a step, or a chunk of them, of all worlds of an environment of this
    package."""
    import jax
    import numpy as np

    from iswarm_mj import make_env

    env = make_env(robots=n_agents, engine=engine_for(chunk), worlds=n_worlds, payload=4)
    state, rng = (
        [env.reset(jax.random.split(jax.random.key(0), n_worlds))],
        np.random.default_rng(0),
    )
    shape = (n_worlds, n_agents, env.action_size)
    if chunk:
        return chunk_stepper(env, state[0], shape, chunk)

    def step():
        state[0] = env.step(state[0], rng.uniform(-1, 1, shape).astype(np.float32))
        jax.block_until_ready(state[0].obs)

    return step


def chunk_stepper(env, state, shape, chunk):
    """Return what takes a chunk of steps of an environment, as one program."""
    import jax

    @jax.jit
    def steps(state, key):
        def one(state, key):
            return env.step(state, jax.random.uniform(key, shape, minval=-1.0)), None

        return jax.lax.scan(one, state, jax.random.split(key, chunk))[0]

    latest = [state, jax.random.key(0)]

    def step():
        latest[1], key = jax.random.split(latest[1])
        latest[0] = steps(latest[0], key)
        jax.block_until_ready(latest[0].obs)

    return step


def engine_for(chunk):
    """Return settings of the planar engine."""
    from iswarm_mj import PlanarSettings

    return PlanarSettings(impl="warp", chunk=chunk) if chunk else PlanarSettings(1)


def run_stepper(n_agents, n_worlds, chunk):
    """Return what takes a step, or a chunk of them, of all worlds of a run of this package."""
    import jax
    import jax.numpy as jnp

    from iswarm_mj import Run, Scenario
    from iswarm_mj.sensors.fields import Flag
    from iswarm_mj.strategy.interface import Command
    from iswarm_mj.utils.units import mm_from_rd

    class Random(Strategy):
        payload: ClassVar = {f"bit_{number}": Flag() for number in range(4)}

        def init(self, n_robots, key):
            return jnp.zeros((n_robots, 4), bool)

        def picks(self, memory):
            return jnp.ones(len(memory), bool)

        def say(self, memory, is_loaded):
            return {f"bit_{number}": memory[:, number] for number in range(4)}

        def act(self, memory, seen, key):
            drawn = jax.random.uniform(key, (6, len(memory)), minval=-1.0)
            return drawn[2:].T > 0, Command(drawn[0] * jnp.pi / 2, drawn[1] * mm_from_rd(0.5))

    scenario = Scenario(
        strategy=Random(),
        robots=n_agents,
        engine=engine_for(chunk),
        worlds=n_worlds,
        steps=1_000_000,
    )
    return Run(scenario, record_worlds=()).advance


STEPPERS = {"VMAS": vmas_stepper, "environment": env_stepper, "run": run_stepper}


def measure(name, n_agents, n_worlds, chunk, seconds):
    """Answer each line on standard input with the steps per second."""
    step = STEPPERS[name](n_agents, n_worlds, chunk)
    for _ in range(WARM_UP):
        step()
    print("ready", flush=True)
    for _ in sys.stdin:
        taken, begin = 0, time.perf_counter()
        while time.perf_counter() - begin < seconds:
            step()
            taken += n_worlds * max(chunk, 1)
        print(taken / (time.perf_counter() - begin), flush=True)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--vmas", help="a Python with vmas; without it, environments and runs alone"
    )
    parser.add_argument("--agents", type=int, default=20)
    parser.add_argument("--worlds", type=int, nargs="+", default=[1, 32])
    parser.add_argument(
        "--chunk",
        type=int,
        default=0,
        help="steps of a compiled program, on Warp; 0 for the CPU's engine",
    )
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each measurement")
    parser.add_argument("--measure", choices=STEPPERS, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.measure:
        measure(args.measure, args.agents, args.worlds[0], args.chunk, args.seconds)
        return
    print(
        "| worlds | "
        + " | ".join(f"{name} [steps/s]" for name in STEPPERS)
        + " | run / environment |"
    )
    for n_worlds in args.worlds:
        pythons = {name: args.vmas if name == "VMAS" else sys.executable for name in STEPPERS}
        common = [f"--{name}={getattr(args, name)}" for name in ("agents", "chunk", "seconds")] + [
            f"--worlds={n_worlds}"
        ]
        children = {
            name: subprocess.Popen(
                [python, __file__, f"--measure={name}", *common],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                bufsize=1,
            )
            for name, python in pythons.items()
            if python
        }
        for child in children.values():
            while "ready" not in (line := child.stdout.readline()):
                if not line:
                    raise SystemExit(f"{child.args} ended")
        rates = {name: [] for name in children}
        for _ in range(args.rounds):
            for name, child in children.items():
                child.stdin.write("go\n")
                rates[name].append(float(child.stdout.readline()))
        for child in children.values():
            child.stdin.close()
            child.wait()
        cells = [
            f"{statistics.median(rates[name]):.0f}" if name in rates else "-" for name in STEPPERS
        ]
        ratios = [run / env for run, env in zip(rates["run"], rates["environment"], strict=True)]
        print(
            f"| {n_worlds} | " + " | ".join(cells) + f" | {statistics.median(ratios):.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
