"""Where the time of a run goes."""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager


class Stopwatch:
    """Seconds spent in named stages, one entry for each time a stage was entered."""

    def __init__(self):
        self.laps: dict[str, list[float]] = defaultdict(list)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time the block as one lap of `stage`."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.laps[stage].append(time.perf_counter() - start)
