"""Support of readings by the paper's statements: approximate Bayesian computation by rejection.

Combinations of readings are drawn from a prior in which all labels of a factor are equally probable. Those that
reproduce the most statements are accepted; a label's share among them is its posterior probability, given how many
statements hold. Source: Pritchard et al. (1999), Mol. Biol. Evol. 16, 1791.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from iswarm_mj.experiments.analysis.statistics import Interval, even, holm, share

ACCEPTED = 0.05
"""Share of the combinations that is accepted."""


class Combination(NamedTuple):
    """A combination of readings and what came of it."""

    reading: str | None
    """Name of a reading that is not part of the sample."""
    labels: Mapping[str, str]
    """By factors."""
    answers: Sequence[bool]
    """Which statements it reproduces."""
    time_error: float
    """Decides between combinations that reproduce equally many; the smaller, the better."""


def accepted(sample: Sequence[Combination]) -> list[Combination]:
    """The best `ACCEPTED` of a sample, at least one."""
    ranking = sorted(sample, key=lambda c: (-sum(c.answers), c.time_error))
    return ranking[: max(1, round(ACCEPTED * len(sample)))]


def support(
    sample: Sequence[Combination], kept: Sequence[Combination], factor: str, labels: Sequence[str]
) -> dict[str, Interval]:
    """Share of each label of a factor among those accepted, with Wilson's interval.

    Args:
        sample: all combinations.
        kept: those accepted.
        factor: its name.
        labels: of the factor, in their order; those that the sample lacks are left out.
    """
    tried = {c.labels[factor] for c in sample}
    return {label: share(sum(c.labels[factor] == label for c in kept), len(kept)) for label in labels if label in tried}


def chances(
    sample: Sequence[Combination], kept: Sequence[Combination], factors: Mapping[str, Sequence[str]]
) -> dict[str, tuple[float, float]]:
    """P-value by factor that those accepted are drawn from the sample whatever their label, and the same by Holm."""
    raw = []
    for factor, labels in factors.items():
        tried, taken = ([sum(c.labels[factor] == label for c in group) for label in labels] for group in (sample, kept))
        there = [
            (taken_one, tried_one / len(sample)) for taken_one, tried_one in zip(taken, tried, strict=True) if tried_one
        ]
        raw.append(even(*zip(*there, strict=True)))
    return dict(zip(factors, zip(raw, holm(raw), strict=True), strict=True))
