"""Where the time of a run goes, and on what machine."""

import os
import platform
import time
from array import array
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any


class Stopwatch:
    """Seconds spent in named stages, one entry for each time a stage was entered."""

    def __init__(self):
        self.laps: dict[str, array[float]] = defaultdict(lambda: array("d"))  # of a million steps, a few MB

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time the block as one lap of `stage`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.laps[stage].append(time.perf_counter() - start)


def processor() -> str:
    """Name of the processor, as reported by the system."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        return platform.processor() or platform.machine()


def hardware() -> dict[str, Any]:
    """Processor, and how many of its cores may be used."""
    return {"cores": len(os.sched_getaffinity(0)), "machine": processor()}
