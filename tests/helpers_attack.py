"""Attacks: cases drawn one after the other by their numbers, and counted."""

import signal
import traceback
from collections import Counter
from contextlib import contextmanager

import numpy as np

CASE_S = 120
"""A case that takes longer hangs [s]."""
SHOWN = 12
"""Broken cases that a failure tells."""
_UNITS = {"s": 1, "m": 60, "h": 3600}


def seconds(text):
    """A time such as 60s, 10m or 2h [s].

    Raises:
        ValueError: it is none.
    """
    number, unit = text[:-1], text[-1:]
    if unit not in _UNITS or not number.isdigit():
        raise ValueError(f"a budget is a whole number and s, m or h, such as 60s, 10m or 2h (got {text})")
    return int(number) * _UNITS[unit]


def numbers(text):
    """Of a case, `7`, or from one on, `7-`: the first one and whether it is all."""
    return int(text.removesuffix("-")), not text.endswith("-")


class Broken(AssertionError):
    """A case that was neither done nor refused as it should be."""


class Attack:
    """The cases of one test.

    Attributes:
        counts: of the cases, by what became of them: `broken`, or what the test calls it.
    """

    def __init__(self, name, n_cases, first=0, alone=False):
        """Begin.

        Args:
            name: of the test, as pytest is given it.
            n_cases: how many.
            first: number of the first case.
            alone: there are no others.
        """
        self._name, self._first, self._next, self._last = name, first, first, first + (1 if alone else n_cases)
        self.counts, self.finds = Counter(), []

    def generators(self, most=None):
        """Yield the random generators of the cases, at most so many."""
        while self._next < self._last and self._next - self._first != most:
            yield np.random.default_rng([self._next, *self._name.encode()])
            self._next += 1

    @contextmanager
    def case(self, about, limit_s=CASE_S):
        """Try one case; the block says what became of it by `outcome.append`, or raises."""
        outcome = []
        previous = signal.signal(signal.SIGALRM, _late)
        signal.setitimer(signal.ITIMER_REAL, limit_s)
        try:
            yield outcome
            self.counts[outcome[0] if outcome else "handled"] += 1
        except Exception as error:
            self.counts["broken"] += 1
            frames = traceback.extract_tb(error.__traceback__)[-3:]
            places = " < ".join(f"{frame.filename}:{frame.lineno}" for frame in reversed(frames))
            self.finds.append(f"case {self._next}: {about}\n  {type(error).__name__}: {str(error)[:400]}\n  {places}")
            print(self.finds[-1], flush=True)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, previous)

    def check(self):
        """Fail with what was broken, and how to see it again."""
        if self.finds:
            number = self.finds[0].partition(":")[0].removeprefix("case ")
            told = "\n".join(self.finds[:SHOWN])
            raise Broken(f"{len(self.finds)} broken; repeat with `pytest {self._name} --case {number}`\n{told}")


def _late(*_):
    raise TimeoutError("it takes too long")
