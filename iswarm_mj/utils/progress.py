"""Progress on stderr, by tqdm: a bar on a terminal, elsewhere a line now and then."""

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
"""Delay before a message about what is waited for [s]."""
_LINE = "{desc}{n_fmt} of {total_fmt} {unit}s, {rate_fmt}, {remaining} left{postfix}"


class _Lines(io.StringIO):
    """Stream that prints what tqdm writes to redraw a bar, as lines of their own."""

    def write(self, text: str) -> int:
        if text.strip():
            print(f"iswarm: {text.strip()}", file=sys.stderr, flush=True)
        return len(text)


class Progress:
    """Counts units of work; use it in a `with` statement.

    Rate and remaining time are those of the work after the first update, which includes the time of
    compilation.
    """

    def __init__(self, total: int, unit: str, name: str = "", done: int = 0, waiting: str = ""):
        """Begin.

        Args:
            total: number of units.
            unit: name of a unit.
            name: of what is done.
            done: number of units that were done before.
            waiting: what the first update waits for, printed after `PATIENCE`.
        """
        self._waiting = waiting
        self._is_first = True
        self._message = ExitStack()
        options: dict[str, Any] = {"total": total, "initial": done, "unit": unit}
        if sys.stderr.isatty():
            options["desc"] = name or None
        else:
            options |= {
                "desc": f"{name}: " if name else "",
                "file": _Lines(),
                "bar_format": _LINE,
                "leave": False,
                "mininterval": INTERVAL,
                "delay": INTERVAL,
                "miniters": 1,
                "smoothing": 0,
            }
        self._bar = tqdm(**options)

    def __enter__(self) -> "Progress":
        if self._waiting:
            self._message.enter_context(waiting(self._waiting))
        return self

    def __exit__(self, *_: Any) -> None:
        self._message.close()
        self._bar.close()

    def update(self, n: int = 1) -> None:
        """Count n more units."""
        if self._is_first:
            self._is_first = False
            self._message.close()
            # The rate is that of the units that follow.
            self._bar.start_t = time.time()
            self._bar.initial = self._bar.n + n
        self._bar.update(n)

    def say(self, text: str) -> None:
        """Show a text after the numbers, in place of an earlier one."""
        self._bar.set_postfix_str(text, refresh=False)


@contextmanager
def waiting(text: str) -> Iterator[None]:
    """Print what is waited for on stderr, if the block takes longer than `PATIENCE`."""
    timer = threading.Timer(PATIENCE, lambda: tqdm.write(f"iswarm: {text}", file=sys.stderr))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
        timer.join()  # so that nothing is printed after what ended the block
