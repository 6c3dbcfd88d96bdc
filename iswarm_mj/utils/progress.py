"""What is going on, on stderr, by tqdm: a bar on a terminal; elsewhere a line now and then."""

import io
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from tqdm import tqdm

INTERVAL = 30.0
"""Time between two lines where stderr is no terminal [s]."""
PATIENCE = 2.0
"""Time after which is said what is waited for [s]."""
_LINE = "{desc}{n_fmt} of {total_fmt} {unit}s, {rate_fmt}, {remaining} left{postfix}"


class _Lines(io.StringIO):
    """What tqdm writes to draw a bar anew, as lines of their own."""

    def write(self, text: str) -> int:
        if text.strip():
            print(f"iswarm: {text.strip()}", file=sys.stderr, flush=True)
        return len(text)


class Progress:
    """Counts units of work; use it in a `with` statement.

    Rate and remaining time are those of the work since the first update, which takes the time of compilation with it.
    """

    def __init__(self, total: int, unit: str, name: str = "", done: int = 0, waiting: str = ""):
        """Begin.

        Args:
            total: units in all.
            unit: one of them.
            name: of what is done.
            done: units that were done before.
            waiting: what the first update waits for, said if it takes longer than `PATIENCE`.
        """
        self._waiting, self._is_first = waiting, True
        how: dict[str, Any] = {"total": total, "initial": done, "desc": name or None, "unit": unit}
        if not sys.stderr.isatty():
            how |= {"desc": name and f"{name}: ", "file": _Lines(), "bar_format": _LINE, "leave": False}
            how |= {"mininterval": INTERVAL, "delay": INTERVAL, "miniters": 1, "smoothing": 0}
        self._bar, self._explained = tqdm(**how), ExitStack()

    def __enter__(self) -> "Progress":
        if self._waiting:
            self._explained.enter_context(waiting(self._waiting))
        return self

    def __exit__(self, *_: Any) -> None:
        self._explained.close()
        self._bar.close()

    def update(self, n: int = 1) -> None:
        """Count n more units."""
        if self._is_first:
            self._is_first = False
            self._explained.close()
            self._bar.start_t, self._bar.initial = time.time(), self._bar.n + n  # the rate of what follows
        self._bar.update(n)

    def say(self, text: str) -> None:
        """Add a text, in place of an earlier one."""
        self._bar.set_postfix_str(text, refresh=False)


@contextmanager
def waiting(text: str) -> Iterator[None]:
    """Say what is waited for, on stderr, if the block takes longer than `PATIENCE`."""
    teller = threading.Timer(PATIENCE, lambda: tqdm.write(f"iswarm: {text}", file=sys.stderr))
    teller.daemon = True
    teller.start()
    try:
        yield
    finally:
        teller.cancel()
        teller.join()  # so that nothing is said after what ended the block
