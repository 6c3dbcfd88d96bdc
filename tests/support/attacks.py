"""Attacks: tests of random cases, each drawn by Hypothesis as one seed, and odd values to try."""

import os

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

CASES = int(os.environ.get("CASES", "0"))
"""Random cases of each attack; by default a few, the same in each run."""

NUMBERS = [0, -1, 1, 0.5, 1e308, -1e308, float("nan"), float("inf"), 10**30, 2**31, -(2**63)]
TEXTS = ["", "x", "ä\n|<b>", "9" * 5000, "\x1b[31m"]
COLLECTIONS = [[], [[]], [1], {}, {"a": 1}]
ODD_VALUES = [None, True, False, *NUMBERS, *TEXTS, *COLLECTIONS]
"""Values that few settings allow."""


def attack(n_cases):
    """Return a decorator that calls a test with `seed` of each of n cases, or of `CASES`.

    `hypothesis.event` counts the outcomes.
    """
    attack_settings = settings(
        max_examples=CASES or n_cases,
        derandomize=not CASES,
        deadline=None,
        phases=(Phase.explicit, Phase.reuse, Phase.generate),
        suppress_health_check=list(HealthCheck),
    )
    return lambda test: attack_settings(given(seed=st.integers(0, 2**32 - 1))(test))


def pick(rng, values):
    """Return one of the values at random."""
    return values[rng.integers(len(values))]
