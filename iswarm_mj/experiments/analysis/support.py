"""Support of readings by the paper's statements: approximate Bayesian computation by rejection.

Combinations of readings are drawn from a prior in which all labels of a factor are equally probable. Those that
reproduce the most of the statements that select (`statements.ASKED`) are accepted; a label's share among them is its
posterior probability, given how many of these hold. The other statements are held out.

Source: Pritchard et al. (1999), Mol. Biol. Evol. 16, 1791.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from iswarm_mj.experiments.analysis.findings import Rows
from iswarm_mj.experiments.analysis.measures import by
from iswarm_mj.experiments.analysis.statements import ASKED
from iswarm_mj.experiments.analysis.statistics import Interval, even, holm, interval, share

ACCEPTED = 0.05
"""Share of the combinations that is accepted."""


class Combination(NamedTuple):
    """A combination of readings and what came of it."""

    reading: str | None
    """Name of a reading that is not part of the sample."""
    labels: Mapping[str, str | None]
    """By factors. A named reading has none; with one value changed, it has that one."""
    answers: Sequence[bool]
    """Which of the statements that select it reproduces."""
    penalty_error: float
    """Decides between combinations that reproduce equally many; the smaller, the better."""
    single: Sequence[int] = ()
    """How many of them single runs of each setting reproduce, by layouts."""
    held_out: Sequence[bool] = ()
    """Which of the other statements it reproduces."""

    @property
    def is_named(self) -> bool:
        """Whether it is a named reading as it is."""
        return self.reading is not None and not any(self.labels.values())


def accepted(sample: Sequence[Combination]) -> list[Combination]:
    """The best share `ACCEPTED` of a sample, at least one."""
    ranking = sorted(sample, key=lambda c: (-sum(c.answers), c.penalty_error))
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


def counts_alone(every: Sequence[Combination], factor: str, default: str) -> dict[str, int]:
    """Statements that the reading `paper` reproduces by labels of one factor, all others unchanged, default first."""
    return {label: sum(one.answers) for label, one in _alone(every, factor, default).items()}


def more_alone(every: Sequence[Combination], factor: str, default: str) -> dict[str, Interval]:
    """By labels of one factor, how many statements more than with the default single runs reproduce.

    Mean over layouts of the difference, with its bootstrap interval.
    """
    found = _alone(every, factor, default)
    usual = np.asarray(found.pop(default).single)
    return {label: interval(np.asarray(one.single) - usual) for label, one in found.items()}


def _alone(every: Sequence[Combination], factor: str, default: str) -> dict[str, Combination]:
    """The paper's reading by labels of one factor, while all others stay, its default first."""
    mine = [one for one in every if one.reading == "paper"]
    found = {default: next(one for one in mine if one.is_named)}
    return found | {label: one for one in mine if (label := one.labels[factor])}


def gives_way(default: str, shares: Mapping[str, Interval], counts: Mapping[str, int]) -> str | None:
    """Label to which a default gives way, if any: the one with the largest share of those that are supported.

    Args:
        default: its label.
        shares: support of all labels; a label needs an interval above the share that all have without support.
        counts: of statements by labels alone; a label needs as many as the default.
    """
    able = [
        label
        for label, share in shares.items()
        if label != default and share.low > 1 / len(shares) and counts.get(label, -1) >= counts[default]
    ]
    return max(able, key=lambda label: shares[label].estimate, default=None)


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


def answers(rows: Rows, selects: bool = True) -> list[bool]:
    """Whether each of `ASKED` that selects, or each held out, holds for one set of runs, by `study` and `setting`."""
    listed = [{**row, "use_hop_count": row["setting"] == "with", "type": row["setting"]} for row in rows]
    studies = by(listed, "study")
    return [asked.holds(studies[asked.study]) for asked in ASKED.values() if asked.selects == selects]
