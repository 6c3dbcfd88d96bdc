"""Measure what a recorded step costs.

`python tools/benchmarks/recording_cost.py DIR ...` writes recordings anew from trajectories.

Prints bytes and processor time a step, medians of several recordings of the first world of each run.
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


def cost(directory: Path) -> tuple[int, float, float]:
    """Return the number of steps, bytes a step and milliseconds a step."""
    scene, arrays, times = load(directory / TRAJECTORY).scene, read_trajectory(directory / TRAJECTORY), []
    frames = Frames.from_arrays({name: a for name, a in arrays.items() if name != ABOUT and not name.startswith(SCENE)})
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "run.rrd"
        for _ in range(REPEATS):
            with closing(Recording(path, scene, {}, {})) as recording:
                started = time.process_time()
                for start in range(0, len(frames), BLOCK_FRAMES):
                    recording.append(frames[start : start + BLOCK_FRAMES])
                times.append(time.process_time() - started)
        return len(frames), path.stat().st_size / len(frames), 1e3 * statistics.median(times) / len(frames)


if __name__ == "__main__":
    for name in sys.argv[1:]:
        n_steps, size, milliseconds = cost(Path(name))
        print(f"{name}: {n_steps} steps, {size:.0f} bytes and {milliseconds:.2f} ms a step")
