"""Measure what a recorded step costs.

    python tools/benchmarks/recording_cost.py DIR ...

It writes recordings again from trajectories, and prints bytes and processor time a step, medians of
several recordings of each run's first world.
"""

import argparse
import statistics
import tempfile
import time
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

from iswarm_mj import load
from iswarm_mj.output.loading import read_trajectory
from iswarm_mj.output.rerun_swarm import Recording
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import ABOUT, SCENE, TRAJECTORY, Scene
from iswarm_mj.workflows.recorder import BLOCK_FRAMES

REPEATS = 7
"""Number of recordings of each run, of which the median is taken."""


class Cost(NamedTuple):
    """Cost of a recording."""

    n_steps: int
    bytes_per_step: float
    ms_per_step: float
    """Processor time of a step [ms]."""


def frames_of(directory: Path) -> Frames:
    """Return the frames of the first recorded world of a run."""
    arrays = read_trajectory(directory / TRAJECTORY)
    frames = {}
    for name, values in arrays.items():
        if name != ABOUT and not name.startswith(SCENE):
            frames[name] = values
    return Frames.from_arrays(frames)


def measure(directory: Path) -> Cost:
    """Return the cost of a run's recording."""
    scene = load(directory / TRAJECTORY).scene
    frames = frames_of(directory)
    n_steps = len(frames)
    with tempfile.TemporaryDirectory() as temporary:
        path = Path(temporary) / "run.rrd"
        seconds = [write(path, scene, frames) for _ in range(REPEATS)]
        n_bytes = path.stat().st_size
    return Cost(n_steps, n_bytes / n_steps, 1e3 * statistics.median(seconds) / n_steps)


def write(path: Path, scene: Scene, frames: Frames) -> float:
    """Write a recording, and return the processor time of its steps [s]."""
    with closing(Recording(path, scene, {}, {})) as recording:
        started = time.process_time()
        for start in range(0, len(frames), BLOCK_FRAMES):
            recording.append(frames[start : start + BLOCK_FRAMES])
        return time.process_time() - started


def main() -> None:
    """Print the cost of the recording of each run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("directories", type=Path, nargs="+", metavar="DIR", help="--out of runs")
    for directory in parser.parse_args().directories:
        cost = measure(directory)
        per_step = f"{cost.bytes_per_step:.0f} bytes and {cost.ms_per_step:.2f} ms a step"
        print(f"{directory}: {cost.n_steps} steps, {per_step}")


if __name__ == "__main__":
    main()
