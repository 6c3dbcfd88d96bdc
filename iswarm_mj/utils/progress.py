"""What is going on, on stderr: a bar on a terminal; elsewhere a line now and then with rate and remaining time."""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from tqdm import tqdm

INTERVAL = 30.0
"""Time between two lines where stderr is no terminal [s]."""
PATIENCE = 2.0
"""Time after which is said what is waited for [s]."""


class Progress:
    """Counts units of work; use it in a `with` statement.

    Rate and remaining time are those of the work since the first update, which takes the time of compilation with it.
    """

    def __init__(self, total: int, unit: str, name: str = "", done: int = 0, waiting: str = "", hidden: bool = False):
        """Begin.

        Args:
            total: units in all.
            unit: one of them.
            name: of what is done.
            done: units that were done before.
            waiting: what the first update waits for, said if it takes longer than `PATIENCE`.
            hidden: say nothing.
        """
        self.total, self.unit, self.name, self.done = total, unit, name, done
        self._waiting, self._text, self._said = waiting, "", -1.0
        self._first: tuple[float, int] | None = None
        self._has_ended = threading.Event()
        is_terminal = sys.stderr.isatty()
        self._bar = tqdm(
            total=total, initial=done, desc=name or None, unit=unit, disable=hidden or not is_terminal, leave=True
        )
        self._teller = None
        if not hidden and not is_terminal:
            self._teller = threading.Thread(target=self._tell, daemon=True)

    def __enter__(self) -> "Progress":
        if self._waiting:
            self._bar.set_postfix_str(self._waiting, refresh=True)
        if self._teller is not None:
            self._teller.start()
        return self

    def __exit__(self, *_: Any) -> None:
        self._has_ended.set()
        self._bar.close()
        if self._teller is not None:
            self._teller.join()

    def update(self, n: int = 1) -> None:
        """Count n more units."""
        self.done += n
        if self._first is None:
            self._first = time.perf_counter(), self.done
            if not self._bar.disable:  # the rate of what follows
                self._bar.start_t, self._bar.initial = time.time(), self.done
                self._bar.set_postfix_str("", refresh=False)
        self._bar.update(n)

    def is_due(self) -> bool:
        """Whether the text is so old that another one is worth its cost."""
        now = time.perf_counter()
        if now - self._said < 1.0:
            return False
        self._said = now
        return True

    def say(self, text: str) -> None:
        """Add a text, in place of an earlier one."""
        self._text = text
        self._bar.set_postfix_str(text, refresh=False)

    def line(self) -> str:
        """Return the state in words: how much, how fast, how long still."""
        parts = [f"{self.name}: " * bool(self.name) + f"{self.done} of {self.total} {self.unit}s"]
        if self._first is not None and self.done > self._first[1]:
            rate = (self.done - self._first[1]) / (time.perf_counter() - self._first[0])
            left = (self.total - self.done) / rate
            parts += [f"{rate:.3g} {self.unit}s/s", f"about {duration(left)} left"]
        elif self._first is None and self._waiting:
            parts.append(self._waiting)
        return ", ".join(filter(None, [*parts, self._text]))

    def _tell(self) -> None:
        """Write lines until the work has ended."""
        if self._waiting and not self._has_ended.wait(PATIENCE) and self._first is None:
            print(f"iswarm: {self._waiting}", file=sys.stderr, flush=True)
        while not self._has_ended.wait(INTERVAL):
            print(f"iswarm: {self.line()}", file=sys.stderr, flush=True)


@contextmanager
def waiting(text: str, hidden: bool = False) -> Iterator[None]:
    """Say what is waited for, on stderr, if the block takes longer than `PATIENCE`."""

    def tell() -> None:
        if not has_ended.wait(PATIENCE):
            print(f"iswarm: {text}", file=sys.stderr, flush=True)

    has_ended, teller = threading.Event(), threading.Thread(target=tell, daemon=True)
    if not hidden:
        teller.start()
    try:
        yield
    finally:
        has_ended.set()
        if not hidden:
            teller.join()  # so that nothing is said after what ended the block


def duration(seconds: float) -> str:
    """Return a time in words, as "40 s", "3 min" or "2.5 h"."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
