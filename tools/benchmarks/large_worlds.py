"""Time control steps of large worlds.

`taskset -c 0 python tools/benchmarks/large_worlds.py` writes docs/large-worlds.svg.

One world of each size in a process of its own, at the density of type 1, with the planar engine on one thread and
without recording. Prints processor time of a control step, the median of blocks, and the process's peak memory.
"""

import json
import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path

from iswarm_mj.config.swarm import ArenaConfig, SwarmConfig
from iswarm_mj.engines.planar.settings import PlanarSettings
from iswarm_mj.output.plot_style import STYLE, blank
from iswarm_mj.simulation.run import Run
from iswarm_mj.simulation.scenario import Scenario

SIZES = 1000, 10_000, 100_000
OUT = Path(__file__).parents[2] / "docs" / "large-worlds.svg"
WARM_UP, BLOCKS, ROBOT_STEPS = 5, 5, 40_000
"""Control steps before the timing; blocks that are timed, and robots times steps in each."""


def one(n_robots: int) -> dict[str, float]:
    """Return the cost of a world's control step in this process."""
    config = SwarmConfig(arena=ArenaConfig(size=92 * (n_robots / 1000) ** 0.5))
    n_steps = max(2, ROBOT_STEPS // n_robots)
    scenario = Scenario(config, robots=n_robots, engine=PlanarSettings(threads=1), steps=WARM_UP + BLOCKS * n_steps)
    run = Run(scenario, record_worlds=())
    times = []
    for _ in range(WARM_UP):
        run.advance()
    for _ in range(BLOCKS):
        started = time.process_time()
        for _ in range(n_steps):
            run.advance()
        times.append((time.process_time() - started) / n_steps)
    run.raise_faults()
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"robots": n_robots, "ms": 1e3 * statistics.median(times), "gb": 1024e-9 * peak}


def draw(rows: list[dict[str, float]]) -> None:
    """Draw time a robot and memory against the number of robots."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        drawing, (left, right) = blank(1, 2, (3.4, 2.6))
        robots = [row["robots"] for row in rows]
        left.semilogx(robots, [1e3 * row["ms"] / row["robots"] for row in rows], "o-")
        right.semilogx(robots, [row["gb"] for row in rows], "o-")
        for axes, label in ((left, "time a robot and step [µs]"), (right, "peak memory [GB]")):
            axes.set(xlabel="robots in the world", ylabel=label, ylim=(0, None))
            axes.set_xticks(robots, [f"{number:,}" for number in robots])
            axes.minorticks_off()
        drawing.savefig(OUT, metadata={"Date": None})


if __name__ == "__main__":
    if len(sys.argv) > 1:
        print(json.dumps(one(int(sys.argv[1]))))
    else:
        outputs = [subprocess.check_output([sys.executable, __file__, str(size)]) for size in SIZES]
        found = [json.loads(output) for output in outputs]
        for row in found:
            each_us = 1e3 * row["ms"] / row["robots"]
            print(f"{row['robots']:7} robots: {row['ms']:.1f} ms, {each_us:.1f} µs each, {row['gb']:.2f} GB")
        draw(found)
