"""Prints how often the intervals of `iswarm compare` hold no effect, of candidates that are equal.

    python tools/research/effect_coverage.py

Times of finishing are made up: log-normal, correlated where worlds are paired, and cut at the
length of the run, which a fifth of the worlds reaches. `docs/compare.md` has the table.
"""

from itertools import product

import numpy as np

from iswarm_mj.search.effects import effect
from iswarm_mj.utils import intervals

LIMIT = 400.0
"""Length of the run [control steps]."""
N_COMPARISONS = 1000
N_RESAMPLES = 999
"""A tenth of the usual number, with which intervals are nearly as good."""


def made_up_times(rng, n_worlds, of_layouts):
    """Return steps of finishing (n_worlds,), where what layouts have in common is given."""
    noise = rng.normal(size=n_worlds)
    return np.minimum(np.round(300 * np.exp(0.3 * (of_layouts + noise))), LIMIT)


def coverage(n_comparisons, n_worlds, *, statistic, is_paired, seed=0):
    """Return how often intervals of equal candidates hold no effect: difference, ratio, A."""
    rng = np.random.default_rng(seed)
    n_held = np.zeros(3)
    for _ in range(n_comparisons):
        of_layouts = rng.normal(size=n_worlds) if is_paired else 0.0
        first = made_up_times(rng, n_worlds, of_layouts)
        second = made_up_times(rng, n_worlds, of_layouts)
        result = effect(first, second, statistic=statistic, is_paired=is_paired)
        tested = ((result.difference, 0), (result.ratio, 1), (result.superiority, 0.5))
        for place, (interval, value) in enumerate(tested):
            n_held[place] += interval.low <= value <= interval.high
    return n_held / n_comparisons


def main():
    intervals.RESAMPLES = N_RESAMPLES
    print("| worlds | statistic | pairs | difference | ratio | A |\n|---|---|---|---|---|---|")
    for statistic, n_worlds, is_paired in product(
        ("mean", "median"), (6, 8, 16, 32), (True, False)
    ):
        held = coverage(N_COMPARISONS, n_worlds, statistic=statistic, is_paired=is_paired)
        shares = " | ".join(f"{100 * share:.1f} %" for share in held)
        pairs = "yes" if is_paired else "no"
        print(f"| {n_worlds} | {statistic} | {pairs} | {shares} |", flush=True)


if __name__ == "__main__":
    main()
