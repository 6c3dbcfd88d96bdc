"""Stopwatch for the stages of a run."""

import time
from array import array
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Seconds spent in named stages, one entry for each time a stage was entered."""

    def __init__(self):
        self.laps: dict[str, array[float]] = defaultdict(
            lambda: array("d")
        )  # of a million steps, a few MB

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time the block as one lap of `stage`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.laps[stage].append(time.perf_counter() - start)
