"""Attacks: so many cases, drawn one after the other by their numbers, and told at the end."""

import signal
import traceback
from collections import Counter
from contextlib import contextmanager

import numpy as np
import pytest

from iswarm_mj import MujocoSettings, Run, RunSettings
from iswarm_mj.workflows.clean import clean

CASE_S = 1800
"""A case that takes longer hangs, however busy the machine is [s]."""
SHOWN = 12
"""Broken cases that a failure tells."""


class Attack:
    """The cases of one test: their counts by what became of them, and those that were broken."""

    def __init__(self, name, first, number):
        self._name, self._cases = name, range(first, first + number)
        self._now, self.counts, self.broken = first, Counter(), []

    def generators(self):
        """Yield the random generators of the cases."""
        for number in self._cases:
            self._now = number
            yield np.random.default_rng([number, *self._name.encode()])

    @contextmanager
    def case(self, about):
        """Try one case; the block says what became of it by `outcome.append`, or raises."""
        outcome = []
        previous = signal.signal(signal.SIGALRM, _late)
        signal.setitimer(signal.ITIMER_REAL, CASE_S)
        try:
            yield outcome
            self.counts[outcome[0] if outcome else "handled"] += 1
        except Exception as error:
            self.counts["broken"] += 1
            frames = traceback.extract_tb(error.__traceback__)[-3:]
            places = " < ".join(f"{frame.filename}:{frame.lineno}" for frame in reversed(frames))
            self.broken.append(
                f"--first {self._now}: {about}\n  {type(error).__name__}: {str(error)[:400]}\n  {places}"
            )
            print(self.broken[-1], flush=True)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)
            signal.signal(signal.SIGALRM, previous)


def _late(*_):
    raise TimeoutError("it takes too long")


@pytest.fixture
def attack(request):
    """The attack of a test, whose marker `attack` states how many cases it has where `--cases` does not."""
    (number,) = request.node.get_closest_marker("attack").args
    option = request.config.option
    found = Attack(request.node.nodeid, option.first, number if option.cases is None else option.cases)
    yield found
    request.node.user_properties.append(("attack", dict(found.counts)))
    told = "\n".join(found.broken[:SHOWN])
    assert not found.broken, f"{len(found.broken)} broken; repeat one with `pytest NAME --cases 1 --first N`\n{told}"


@pytest.fixture(scope="session")
def recorded_run(small, tmp_path_factory):
    """Directory of a finished run of three steps with two recorded worlds."""
    out, settings = tmp_path_factory.mktemp("recorded"), RunSettings(9, 3, n_worlds=2, record_worlds=(0, 1))
    clean(Run(small, settings=settings, engine=MujocoSettings(1)), out)
    return out


def pytest_terminal_summary(terminalreporter):
    """One line for each attack."""
    for report in (one for reports in terminalreporter.stats.values() for one in reports):
        for name, counts in getattr(report, "user_properties", ()):
            if name == "attack" and report.when == "teardown":
                told = ", ".join(f"{count} {what}" for what, count in sorted(counts.items()))
                terminalreporter.write_line(f"{report.nodeid}: tried {sum(counts.values())}: {told or 'none'}")
