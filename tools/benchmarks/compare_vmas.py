"""Compare environment steps per second on one core: VMAS, environments of this package, its runs.

    python -m venv vmas && vmas/bin/pip install torch vmas    # the CPU's torch will do
    taskset -c 0 python tools/benchmarks/compare_vmas.py --vmas vmas/bin/python

Without VMAS, on an NVIDIA GPU:

    python tools/benchmarks/compare_vmas.py --chunk 25 --agents 20 --worlds 512

Each is a process that is kept, and they take turns, so that other work on the machine slows all
alike; numbers are medians over the rounds. A step is one of all agents of one world. All act at
random: VMAS in `simple_world_comm`, the only one of its scenarios with messages whose number of
agents is free; robots here in cleaning on the planar engine, which speak four bits each; and the
same robots in a run, with a strategy that draws the same motions and messages. With `--chunk`,
programs of so many steps are compiled by JAX and Warp, and actions are drawn in them.
"""

import argparse
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any, ClassVar

from iswarm_mj.strategy.base import Strategy

N_WARM_UP = 3
"""Calls before time is taken, which compile."""
N_BITS = 4
"""Number of bits that a robot says."""

Step = Callable[[], Any]
"""Function that takes a step, or a chunk of them, of all worlds."""


def vmas_stepper(n_agents: int, n_worlds: int, chunk: int) -> Step:
    """Return what takes a step of VMAS."""
    import torch
    import vmas

    torch.set_num_threads(1)
    n_good = n_agents // 5
    env = vmas.make_env(
        "simple_world_comm",
        n_worlds,
        device="cpu",
        num_good_agents=n_good,
        num_adversaries=n_agents - n_good,
        seed=0,
    )
    env.reset()
    return lambda: env.step(env.get_random_actions())


def env_stepper(n_agents: int, n_worlds: int, chunk: int) -> Step:
    """Return what takes a step, or a chunk of them, of an environment of this package."""
    import jax
    import numpy as np

    from iswarm_mj import make_env

    env = make_env(robots=n_agents, engine=engine_for(chunk), worlds=n_worlds, payload=N_BITS)
    state = env.reset(jax.random.split(jax.random.key(0), n_worlds))
    shape = (n_worlds, n_agents, env.action_size)
    if chunk:
        return chunk_stepper(env, state, shape, chunk)

    rng = np.random.default_rng(0)

    def step() -> None:
        nonlocal state
        state = env.step(state, rng.uniform(-1, 1, shape).astype(np.float32))
        jax.block_until_ready(state.obs)

    return step


def chunk_stepper(env: Any, state: Any, shape: tuple[int, ...], chunk: int) -> Step:
    """Return what takes a chunk of steps of an environment, as one program.

    Args:
        env: environment of this package.
        state: state with which it begins.
        shape: shape of the actions of a step.
        chunk: number of steps.
    """
    import jax

    def act(state, key):
        return env.step(state, jax.random.uniform(key, shape, minval=-1.0)), None

    @jax.jit
    def take_steps(state, key):
        return jax.lax.scan(act, state, jax.random.split(key, chunk))[0]

    key = jax.random.key(0)

    def step() -> None:
        nonlocal state, key
        key, key_of_steps = jax.random.split(key)
        state = take_steps(state, key_of_steps)
        jax.block_until_ready(state.obs)

    return step


def engine_for(chunk: int) -> Any:
    """Return settings of the planar engine, on Warp for programs of several steps."""
    from iswarm_mj import PlanarSettings

    return PlanarSettings(impl="warp", chunk=chunk) if chunk else PlanarSettings(1)


def run_stepper(n_agents: int, n_worlds: int, chunk: int) -> Step:
    """Return what takes a step, or a chunk of them, of a run of this package."""
    import jax
    import jax.numpy as jnp

    from iswarm_mj import Run, Scenario
    from iswarm_mj.sensors.fields import Flag
    from iswarm_mj.strategy.interface import Command
    from iswarm_mj.utils.units import mm_from_rd

    class Random(Strategy):
        """Move and speak at random."""

        payload: ClassVar = {f"bit_{number}": Flag() for number in range(N_BITS)}

        def init(self, n_robots, key):
            return jnp.zeros((n_robots, N_BITS), bool)

        def picks(self, memory):
            return jnp.ones(len(memory), bool)

        def say(self, memory, is_loaded):
            return {f"bit_{number}": memory[:, number] for number in range(N_BITS)}

        def act(self, memory, seen, key):
            draws = jax.random.uniform(key, (2 + N_BITS, len(memory)), minval=-1.0)
            turn = draws[0] * jnp.pi / 2
            forward = draws[1] * mm_from_rd(0.5)
            bits = draws[2:].T > 0
            return bits, Command(turn, forward)

    scenario = Scenario(
        strategy=Random(),
        robots=n_agents,
        engine=engine_for(chunk),
        worlds=n_worlds,
        steps=1_000_000,
    )
    return Run(scenario, record_worlds=()).advance


STEPPERS = {"VMAS": vmas_stepper, "environment": env_stepper, "run": run_stepper}


def serve_rates(step: Step, n_steps: int, seconds: float) -> None:
    """Answer each line on standard input with the steps per second.

    Args:
        step: that is measured.
        n_steps: number of steps of one world that a call takes.
        seconds: duration of a measurement [s].
    """
    for _ in range(N_WARM_UP):
        step()
    print("ready", flush=True)
    for _ in sys.stdin:
        n_taken = 0
        started = time.perf_counter()
        while time.perf_counter() - started < seconds:
            step()
            n_taken += n_steps
        print(n_taken / (time.perf_counter() - started), flush=True)


class Contender:
    """A process that measures one of `STEPPERS` when it is asked to."""

    def __init__(self, name: str, python: str, arguments: list[str]):
        self._process = subprocess.Popen(
            [python, __file__, f"--measure={name}", *arguments],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            bufsize=1,
        )
        self.rates: list[float] = []

    def wait(self) -> None:
        """Wait until it is ready.

        Raises:
            SystemExit: it has ended.
        """
        while True:
            line = self._process.stdout.readline()
            if not line:
                raise SystemExit(f"{self._process.args} ended")
            if "ready" in line:
                return

    def measure(self) -> None:
        """Append a rate to `rates` [steps/s]."""
        self._process.stdin.write("go\n")
        self.rates.append(float(self._process.stdout.readline()))

    def close(self) -> None:
        """End the process."""
        self._process.stdin.close()
        self._process.wait()


def compare(args: argparse.Namespace, n_worlds: int) -> str:
    """Return a row of the table, of measurements in turn."""
    shared = [f"--agents={args.agents}", f"--chunk={args.chunk}", f"--seconds={args.seconds}"]
    contenders = {}
    for name in STEPPERS:
        python = args.vmas if name == "VMAS" else sys.executable
        if python:
            contenders[name] = Contender(name, python, [*shared, f"--worlds={n_worlds}"])

    for contender in contenders.values():
        contender.wait()
    for _ in range(args.rounds):
        for contender in contenders.values():
            contender.measure()
    for contender in contenders.values():
        contender.close()

    cells = [str(n_worlds)]
    for name in STEPPERS:
        is_there = name in contenders
        cells.append(f"{statistics.median(contenders[name].rates):.0f}" if is_there else "-")
    pairs = zip(contenders["run"].rates, contenders["environment"].rates, strict=True)
    cells.append(f"{statistics.median(run / env for run, env in pairs):.2f}")
    return f"| {' | '.join(cells)} |"


def main() -> None:
    """Print the table, or measure in a process of the comparison."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--vmas", help="a Python with vmas; without it, this package alone")
    parser.add_argument("--agents", type=int, default=20)
    parser.add_argument("--worlds", type=int, nargs="+", default=[1, 32])
    chunk_help = "steps of a compiled program, on Warp; 0 for the CPU's engine"
    parser.add_argument("--chunk", type=int, default=0, help=chunk_help)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each measurement")
    parser.add_argument("--measure", choices=STEPPERS, help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.measure:
        n_worlds = args.worlds[0]
        step = STEPPERS[args.measure](args.agents, n_worlds, args.chunk)
        serve_rates(step, n_worlds * max(args.chunk, 1), args.seconds)
        return

    titles = ["worlds", *(f"{name} [steps/s]" for name in STEPPERS), "run / environment"]
    print(f"| {' | '.join(titles)} |")
    for n_worlds in args.worlds:
        print(compare(args, n_worlds), flush=True)


if __name__ == "__main__":
    main()
