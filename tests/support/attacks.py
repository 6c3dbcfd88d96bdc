"""Attacks: cases that follow from one number each, which Hypothesis draws; and values that are no
settings."""

import os

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

CASES = int(os.environ.get("CASES", "0"))
"""Cases of each attack, drawn anew each time; by default the same few."""
ODD_VALUES = [
    None, True, False, 0, -1, 1, 0.5, 1e308, -1e308, float("nan"), float("inf"), 10**30, "", "x", "ä\n|<b>", [], [[]],
    [1], {}, {"a": 1}, "9" * 5000, 2**31, -(2**63), "\x1b[31m",
]  # fmt: skip


def attack(n):
    """Call a test with the numbers `seed` of n cases, or of `CASES`; `hypothesis.event` counts what
    became of them."""
    drawn = settings(
        max_examples=CASES or n, derandomize=not CASES, deadline=None,
        phases=(Phase.explicit, Phase.reuse, Phase.generate), suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    return lambda test: drawn(given(seed=st.integers(0, 2**32 - 1))(test))


def pick(rng, values):
    return values[rng.integers(len(values))]
