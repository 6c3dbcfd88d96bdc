"""Measure what a recorded step costs.

`python tools/benchmarks/recording_cost.py DIR ...` writes recordings again from trajectories.

Prints bytes and processor time a step, medians of several recordings of each run's first world.
"""

import statistics
import sys
import tempfile
import time
from contextlib import closing
from pathlib import Path

from iswarm_mj import load
from iswarm_mj.output.loading import read_trajectory
from iswarm_mj.output.rerun_swarm import Recording
from iswarm_mj.output.schema import Frames
from iswarm_mj.output.trajectory import ABOUT, SCENE, TRAJECTORY
from iswarm_mj.workflows.recorder import BLOCK_FRAMES

REPEATS = 7
"""Number of recordings of each run, of which the median is taken."""


def frames_of(directory: Path) -> Frames:
    """Return the frames of the first recorded world of a run."""
    arrays = read_trajectory(directory / TRAJECTORY)
    return Frames.from_arrays(
        {
            name: values
            for name, values in arrays.items()
            if name != ABOUT and not name.startswith(SCENE)
        }
    )


def cost(directory: Path) -> tuple[int, float, float]:
    """Return the number of steps, bytes a step and milliseconds a step of a run's recording."""
    scene = load(directory / TRAJECTORY).scene
    frames = frames_of(directory)
    n_steps = len(frames)
    seconds = []
    with tempfile.TemporaryDirectory() as temporary:
        path = Path(temporary) / "run.rrd"
        for _ in range(REPEATS):
            with closing(Recording(path, scene, {}, {})) as recording:
                started = time.process_time()
                for start in range(0, n_steps, BLOCK_FRAMES):
                    recording.append(frames[start : start + BLOCK_FRAMES])
                seconds.append(time.process_time() - started)
        n_bytes = path.stat().st_size
    return n_steps, n_bytes / n_steps, 1e3 * statistics.median(seconds) / n_steps


if __name__ == "__main__":
    for name in sys.argv[1:]:
        n_steps, size, milliseconds = cost(Path(name))
        print(f"{name}: {n_steps} steps, {size:.0f} bytes and {milliseconds:.2f} ms a step")
