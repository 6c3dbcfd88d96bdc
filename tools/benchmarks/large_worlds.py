"""Time control steps of large worlds: docs/large-worlds.svg.

    taskset -c 0 python tools/benchmarks/large_worlds.py

It takes one world of each size, at the density of type 1, with the planar engine on one thread and
without recording, in a process of its own. It prints processor time of a control step (median of
blocks) and the process's peak memory.
"""

import argparse
import json
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import matplotlib

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output.plot_style import STYLE, blank
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario

SIZES = (1000, 10_000, 100_000)
"""Numbers of robots."""
OUT = Path(__file__).parents[2] / "docs" / "large-worlds.svg"
WARM_UP = 5
"""Number of control steps before the timing."""
BLOCKS = 5
"""Number of blocks of steps that are timed."""
ROBOT_STEPS = 40_000
"""Number of robots times the number of steps of a block."""
ARENA_SIZE = 92
"""Edge of the arena of 1000 robots [rd]."""


class Cost(NamedTuple):
    """Cost of a world."""

    robots: int
    """Number of robots."""
    ms: float
    """Processor time of a control step [ms]."""
    gb: float
    """Peak memory of the process [GB]."""

    @property
    def us_per_robot(self) -> float:
        """Processor time of a control step for each robot [µs]."""
        return 1e3 * self.ms / self.robots


def measure(n_robots: int) -> Cost:
    """Return the cost of a world in this process."""
    arena = ArenaConfig(size=ARENA_SIZE * (n_robots / 1000) ** 0.5)
    n_steps = max(2, ROBOT_STEPS // n_robots)
    scenario = Scenario(
        SwarmConfig(arena=arena),
        robots=n_robots,
        engine=PlanarSettings(threads=1),
        steps=WARM_UP + BLOCKS * n_steps,
    )
    run = Run(scenario, record_worlds=())
    for _ in range(WARM_UP):
        run.advance()

    seconds = []
    for _ in range(BLOCKS):
        started = time.process_time()
        for _ in range(n_steps):
            run.advance()
        seconds.append((time.process_time() - started) / n_steps)
    run.raise_faults()
    peak_kilobytes = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return Cost(n_robots, ms=1e3 * statistics.median(seconds), gb=1024e-9 * peak_kilobytes)


def measure_apart(n_robots: int) -> Cost:
    """Return the cost of a world in a process of its own."""
    command = [sys.executable, __file__, f"--measure={n_robots}"]
    return Cost(**json.loads(subprocess.check_output(command)))


def draw(costs: list[Cost], out: Path) -> None:
    """Draw time for each robot and memory against the number of robots."""
    robots = [cost.robots for cost in costs]
    with matplotlib.rc_context(STYLE):
        drawing, (left, right) = blank(1, 2, (3.4, 2.6))
        left.semilogx(robots, [cost.us_per_robot for cost in costs], "o-")
        right.semilogx(robots, [cost.gb for cost in costs], "o-")
        for axes, label in ((left, "time a robot and step [µs]"), (right, "peak memory [GB]")):
            axes.set(xlabel="robots in the world", ylabel=label, ylim=(0, None))
            axes.set_xticks(robots, [f"{number:,}" for number in robots])
            axes.minorticks_off()
        drawing.savefig(out, metadata={"Date": None})


def main() -> None:
    """Print the costs of all sizes and draw them, or print that of one for this purpose."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=OUT, help="the picture")
    parser.add_argument("--measure", type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.measure:
        print(json.dumps(measure(arguments.measure)._asdict()))
        return

    costs = [measure_apart(n_robots) for n_robots in SIZES]
    for cost in costs:
        times = f"{cost.ms:.1f} ms, {cost.us_per_robot:.1f} µs each"
        print(f"{cost.robots:7} robots: {times}, {cost.gb:.2f} GB")
    draw(costs, arguments.out)


if __name__ == "__main__":
    main()
