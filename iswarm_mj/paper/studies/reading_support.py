"""Support of readings by the paper's statements: approximate Bayesian computation by rejection.

Combinations of readings are drawn from a prior in which all labels of a factor are equally
probable. Those that reproduce the most of the statements that select are accepted; a label's share
among them is its posterior probability, given how many of these hold. The other statements are held
out.

Source: Pritchard et al. (1999), Mol. Biol. Evol. 16, 1791.
"""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from iswarm_mj.paper.analysis.findings import (
    NOT_COMPARABLE,
    NOT_IN_PAPER,
    PREDICTED,
    TOO_FEW,
    Finding,
    interval_text,
    number_text,
)
from iswarm_mj.paper.analysis.judge import EQUALITY_MARGIN
from iswarm_mj.paper.analysis.measures import (
    BEST_DENSITIES,
    CARRIAGE,
    CLEANING_DENSITIES,
    COLLISIONS,
    DUST,
    HIGH_DENSITIES,
    PAPER_TIME,
    PENALTIES,
    SPARSEST_DENSITY,
    TIME,
    Measure,
    count_finished,
    values,
)
from iswarm_mj.paper.analysis.statistics import holm, multinomial_p, share_interval
from iswarm_mj.paper.studies.reading_combinations import DEFAULT_LABELS, FACTORS
from iswarm_mj.search.rows import Rows, by
from iswarm_mj.utils.intervals import Interval, interval

ACCEPTED_SHARE = 0.05
"""Share of the combinations that is accepted."""
MIN_COMBINATIONS = 20
"""Minimum number of combinations of which this share can be accepted."""
SAME_PENALTY = 2.0
"""Factor within which a penalty agrees."""
POINTS_PER_COLLISION = 0.05
"""Points that a swarm loses by one collision per robot (section 4.6)."""


class Combination(NamedTuple):
    """A combination of readings, and which of the paper's statements it reproduces."""

    reading: str | None
    """Name of a reading that is not part of the sample."""
    labels: Mapping[str, str | None]
    """Labels by factors. A named reading has none; with one value changed, it has that one."""
    answers: Sequence[bool]
    """Which of the statements that select it reproduces."""
    penalty_error: float
    """Error of the penalties, see `penalty_error`; the smaller comes first of combinations that
    reproduce equally many statements."""
    single_run_counts: Sequence[int] = ()
    """Number of the statements that select which single runs of each setting reproduce, by
    layouts."""
    held_out: Sequence[bool] = ()
    """Which of the statements that are held out it reproduces."""

    @property
    def is_named(self) -> bool:
        """It is a named reading without a changed value."""
        return self.reading is not None and not any(self.labels.values())

    @property
    def n_selecting(self) -> int:
        """Number of the statements that select which it reproduces."""
        return sum(self.answers)

    @property
    def n_held_out(self) -> int:
        """Number of the statements that are held out which it reproduces."""
        return sum(self.held_out)


class Sample(NamedTuple):
    """The combinations whose labels were drawn at random, and the best of them."""

    drawn: list[Combination]
    """All combinations that were drawn."""
    accepted: list[Combination]
    """Those that reproduce the most statements, at least one."""


class Support(NamedTuple):
    """Support of a factor's labels by the accepted combinations, and by single changes."""

    shares: Mapping[str, Interval]
    """Shares of the accepted combinations that have the labels, with Wilson's intervals."""
    p: float
    """P-value of the test that those accepted are drawn from the sample whatever their label."""
    adjusted_p: float
    """The p-value adjusted by Holm for the number of factors."""
    counts: Mapping[str, int]
    """Number of the statements that select which the paper's reading reproduces with each label and
    all else unchanged, the default first."""
    gains: Mapping[str, Interval]
    """How many more statements single runs reproduce than with the default: mean over layouts."""
    replacement: str | None
    """Label to which the default gives way, if any."""


class Answers(NamedTuple):
    """Which statements hold, by their names."""

    selecting: dict[str, bool]
    """Statements that select: Fig. 17 and the penalties in Table 2."""
    held_out: dict[str, bool]
    """Statements that are held out: Fig. 15 and the times of both types."""


class _Outcomes(NamedTuple):
    """Outcomes of one set of runs, by the settings of the figures."""

    time: Mapping[str, float]
    """Median time to reach the goal [control steps]."""
    dust: Mapping[str, float]
    """Median number of balls removed."""
    collisions: Mapping[str, float]
    """Median number of collisions per robot."""
    carriage: Mapping[str, float]
    """Median of the mean carriage [control steps]; infinity if no run has one."""
    reaches_goal: Mapping[str, bool]
    """Whether more than half of the runs reach the goal."""


def reproduced_statements(runs: Rows) -> Answers:
    """Return which statements of section 4.6 hold for the medians of one set of runs."""
    groups = by(runs, "setting")
    outcomes = _Outcomes(
        time=_medians(groups, TIME),
        dust=_medians(groups, DUST),
        collisions=_medians(groups, COLLISIONS),
        carriage=_medians(groups, CARRIAGE),
        reaches_goal={name: 2 * count_finished(rows) > len(rows) for name, rows in groups.items()},
    )
    densities = {row["density"]: row["setting"] for row in runs if row["study"] == "density"}
    return Answers(
        selecting=_density_answers(outcomes, densities) | _penalty_answers(outcomes),
        held_out=_hop_count_answers(outcomes) | _time_answers(outcomes),
    )


def _medians(groups: Mapping[str, Rows], measure: Measure) -> dict[str, float]:
    """Return the median of a measure for each setting; infinity without values."""
    medians = {}
    for name, rows in groups.items():
        sample = values(rows, measure)
        medians[name] = float(np.median(sample)) if len(sample) else math.inf
    return medians


def _density_answers(outcomes: _Outcomes, densities: Mapping[float, str]) -> dict[str, bool]:
    """Return which statements of Fig. 17 hold.

    Args:
        outcomes: outcomes by settings.
        densities: settings of Fig. 17 by densities.
    """
    settings = [name for _, name in sorted(densities.items())]

    def settings_within(low: float, high: float) -> set[str]:
        return {name for density, name in densities.items() if low <= density <= high}

    best = settings_within(*BEST_DENSITIES)
    cleaning = settings_within(*CLEANING_DENSITIES)
    sparsest = settings_within(SPARSEST_DENSITY, SPARSEST_DENSITY)
    dense = settings_within(*HIGH_DENSITIES)

    def is_lowest_at_best(medians: Mapping[str, float]) -> bool:
        return min(settings, key=medians.__getitem__) in best

    time = outcomes.time
    reaches_goal = outcomes.reaches_goal
    return {
        "Fastest at 0.1 to 0.15": is_lowest_at_best(time),
        "Fewest collisions at 0.1 to 0.15": is_lowest_at_best(outcomes.collisions),
        "Shortest carriage at 0.1 to 0.15": is_lowest_at_best(outcomes.carriage),
        "Slower above 0.2": min(time[name] for name in dense) > min(time[name] for name in best),
        "0.1 to 0.2 cleans": all(reaches_goal[name] for name in cleaning),
        "0.05 does not clean": not any(reaches_goal[name] for name in sparsest),
        "Above 0.2 does not clean": not any(reaches_goal[name] for name in dense),
    }


def _penalty_answers(outcomes: _Outcomes) -> dict[str, bool]:
    """Return whether the penalties of both types agree with Table 2."""

    def agrees(name: str) -> bool:
        ratio = POINTS_PER_COLLISION * outcomes.collisions[name] / PENALTIES[name]
        return 1 / SAME_PENALTY <= ratio <= SAME_PENALTY

    return {
        "Type 1 loses 9 points by collisions": agrees("type1"),
        "Type 2 loses 4 points by collisions": agrees("type2"),
    }


def _hop_count_answers(outcomes: _Outcomes) -> dict[str, bool]:
    """Return which statements of Fig. 15 hold."""
    time, dust, collisions, carriage, _ = outcomes
    return {
        "Hop counts: faster": time["with"] < time["without"],
        "Hop counts: more dust": dust["with"] > dust["without"],
        "Hop counts: fewer collisions": collisions["with"] < collisions["without"],
        "Hop counts: shorter carriage": carriage["with"] < carriage["without"],
    }


def _time_answers(outcomes: _Outcomes) -> dict[str, bool]:
    """Return which statements on the finishing times of both types hold."""
    type1 = outcomes.time["type1"]
    type2 = outcomes.time["type2"]
    reaches_goal = outcomes.reaches_goal

    def agrees(name: str) -> bool:
        deviation = abs(outcomes.time[name] / PAPER_TIME[name] - 1)
        return reaches_goal[name] and deviation <= EQUALITY_MARGIN

    are_equal = abs(type1 - type2) <= EQUALITY_MARGIN * (type1 + type2) / 2
    return {
        "Type 1 takes 310 steps": agrees("type1"),
        "Type 2 takes 311 steps": agrees("type2"),
        "Both types take the same time": reaches_goal["type1"]
        and reaches_goal["type2"]
        and are_equal,
    }


def penalty_error(runs: Rows) -> float:
    """Return the mean of |log(penalty / the paper's)| by collisions over both types.

    Without any collisions the penalty is as if they were one a robot.
    """
    groups = by(runs, "setting")
    ratios = []
    for name, papers in PENALTIES.items():
        collisions = float(np.median(values(groups[name], COLLISIONS)))
        ratios.append(max(POINTS_PER_COLLISION, POINTS_PER_COLLISION * collisions) / papers)
    return float(np.mean(np.abs(np.log(ratios))))


def combinations_of(rows: Rows) -> list[Combination]:
    """Return the combinations of the table with their answers.

    The named readings, and the paper's with one value changed, are among them.
    """
    return [_combination_of(runs) for runs in by(rows, "combination").values()]


def _combination_of(runs: Rows) -> Combination:
    """Return the combination of these runs with its answers."""
    answers = reproduced_statements(runs)
    single_run_counts = []
    for _, single_runs in sorted(by(runs, "repeat").items()):
        single_answers = reproduced_statements(single_runs).selecting
        single_run_counts.append(sum(single_answers.values()))

    first = runs[0]
    return Combination(
        reading=first["reading"],
        # Tables of earlier versions lack factors that came later.
        labels={factor: first[factor] for factor in FACTORS if factor in first},
        answers=list(answers.selecting.values()),
        penalty_error=penalty_error(runs),
        single_run_counts=single_run_counts,
        held_out=list(answers.held_out.values()),
    )


def accept_best(combinations: Sequence[Combination]) -> Sample:
    """Return the combinations that were drawn, and the best `ACCEPTED_SHARE` of them as accepted.

    The best reproduce the most statements that select; of equal ones, those with the smaller
    `penalty_error`.
    """
    drawn = [combination for combination in combinations if combination.reading is None]
    ranking = sorted(drawn, key=lambda each: (-each.n_selecting, each.penalty_error))
    n_accepted = max(1, round(ACCEPTED_SHARE * len(drawn)))
    return Sample(drawn, ranking[:n_accepted])


def support_of_factors(combinations: Sequence[Combination]) -> dict[str, Support]:
    """Return the support of the labels of the table's factors.

    Labels that the sample lacks are left out.

    Raises:
        ValueError: the unchanged reading of the paper is missing, or is there twice.
    """
    sample = accept_best(combinations)
    papers = [combination for combination in combinations if combination.reading == "paper"]
    (unchanged,) = (combination for combination in papers if combination.is_named)

    # How often labels come in the sample and among those accepted, and whether that is chance.
    label_counts = {factor: _count_labels(factor, sample) for factor in unchanged.labels}
    p_values = [_p_of_labels(counts, sample) for counts in label_counts.values()]
    adjusted = holm(p_values)

    supports = {}
    for factor, p, adjusted_p in zip(label_counts, p_values, adjusted, strict=True):
        shares = _shares_of_labels(label_counts[factor], sample)

        # What each label does alone, the default first.
        default = DEFAULT_LABELS[factor]
        changed = _changed_labels(factor, papers)
        alone = {default: unchanged, **changed}
        counts = {label: combination.n_selecting for label, combination in alone.items()}
        supports[factor] = Support(
            shares=shares,
            p=p,
            adjusted_p=adjusted_p,
            counts=counts,
            gains={label: _gain(changed[label], unchanged) for label in changed},
            replacement=label_instead_of(default, shares, counts),
        )
    return supports


def _count_labels(factor: str, sample: Sample) -> dict[str, tuple[int, int]]:
    """Return how many drawn and how many accepted combinations have each label of a factor.

    Labels that none has are left out.
    """
    drawn = Counter(combination.labels[factor] for combination in sample.drawn)
    accepted = Counter(combination.labels[factor] for combination in sample.accepted)
    return {label: (drawn[label], accepted[label]) for label in FACTORS[factor] if drawn[label]}


def _shares_of_labels(counts: Mapping[str, tuple[int, int]], sample: Sample) -> dict[str, Interval]:
    """Return the share of each label among the accepted combinations."""
    n_all = len(sample.accepted)
    return {label: share_interval(n_accepted, n_all) for label, (_, n_accepted) in counts.items()}


def _p_of_labels(counts: Mapping[str, tuple[int, int]], sample: Sample) -> float:
    """Return the p-value of the test that those accepted are drawn whatever their label."""
    accepted = [n_accepted for _, n_accepted in counts.values()]
    shares_of_drawn = [n_drawn / len(sample.drawn) for n_drawn, _ in counts.values()]
    return multinomial_p(accepted, shares_of_drawn)


def _changed_labels(factor: str, papers: Sequence[Combination]) -> dict[str, Combination]:
    """Return the paper's reading with the value of one factor changed, by the new label."""
    changed = {}
    for combination in papers:
        label = combination.labels[factor]
        if label:
            changed[label] = combination
    return changed


def _gain(changed: Combination, unchanged: Combination) -> Interval:
    """Return how many more statements single runs reproduce with a value changed."""
    return interval(np.subtract(changed.single_run_counts, unchanged.single_run_counts))


def label_instead_of(
    default: str, shares: Mapping[str, Interval], counts: Mapping[str, int]
) -> str | None:
    """Return the label to which a default gives way: the supported one with the largest share.

    A label is supported if the interval of its share lies above the share of all labels without
    support, and if alone it reproduces at least as many statements as the default.

    Args:
        default: label of the default.
        shares: shares of the accepted combinations, by labels.
        counts: number of statements that the paper's reading reproduces with a label, by labels.

    Returns:
        The label; None if no label is supported.
    """
    share_without_support = 1 / len(shares)
    supported = [
        label
        for label, share in shares.items()
        if label != default
        and share.low > share_without_support
        and counts.get(label, -1) >= counts[default]
    ]
    return max(supported, key=lambda label: shares[label].estimate, default=None)


def support_findings(rows: Rows) -> list[Finding]:
    """Return how many statements are reproduced by how many combinations, and what they support."""
    not_run = Finding(
        "Combinations of readings that reproduce the paper's statements",
        "section 4.6",
        "all",
        PREDICTED,
    )
    if not rows:
        return [not_run]

    combinations = combinations_of(rows)
    sample = accept_best(combinations)
    supports = support_of_factors(combinations)
    verdict = "" if len(sample.drawn) >= MIN_COMBINATIONS else TOO_FEW

    rule = (
        f"{len(sample.drawn)} combinations drawn from {len(supports)} readings; the "
        f"{len(sample.accepted)} that miss the fewest statements that select are accepted "
        "(approximate Bayesian computation by rejection); of equals those nearer in the penalties "
        "of both types"
    )
    reproduced = not_run._replace(
        ours=_reproduced_text(combinations, sample), statistics=rule, verdict=verdict
    )
    findings = [reproduced]
    for name, support in supports.items():
        findings.append(_support_finding(name, support, len(supports), verdict))
    return findings


def _reproduced_text(combinations: Sequence[Combination], sample: Sample) -> str:
    """Return how many statements the sample and the named readings reproduce."""
    counts = [combination.n_selecting for combination in sample.drawn]
    n_selecting = len(combinations[0].answers)
    n_held_out = len(combinations[0].held_out)
    named = "; ".join(
        f"{each.reading} {each.n_selecting} of {n_selecting}, and of those held out "
        f"{each.n_held_out} of {n_held_out}"
        for each in combinations
        if each.is_named
    )
    accepted_mean = _mean_held_out_text(sample.accepted)
    drawn_mean = _mean_held_out_text(sample.drawn)
    most = max(counts)
    median = number_text(float(np.median(counts)))
    return (
        f"at most {most} of {n_selecting}, by {counts.count(most)}; median {median}; {named}; "
        f"held out, mean of {n_held_out}: accepted {accepted_mean}, all {drawn_mean}"
    )


def _mean_held_out_text(combinations: Sequence[Combination]) -> str:
    """Return the mean number of held-out statements that combinations reproduce."""
    counts = [combination.n_held_out for combination in combinations]
    return number_text(float(np.mean(counts)))


def _support_finding(factor: str, support: Support, n_factors: int, verdict: str) -> Finding:
    """Return the finding on the support of a factor's labels, one of `n_factors` factors."""
    shares = [f"{label}: {interval_text(share, '%')}" for label, share in support.shares.items()]
    if support.replacement:
        default = DEFAULT_LABELS[factor]
        shares.append(f"by the rule, {default} gives way to {support.replacement}")

    without_support = number_text(100 / len(FACTORS[factor]))
    counts = ", ".join(f"{label} {count}" for label, count in support.counts.items())
    rule = (
        f"share of the accepted combinations, of which {without_support} % without any support; "
        f"Wilson; exact multinomial p = {number_text(support.p, 2)}, "
        f"{number_text(support.adjusted_p, 2)} by Holm for {n_factors} readings; of `paper` "
        f"with one value hold, of those that select: {counts}"
    )
    return Finding(
        claim=f"Support of {factor.replace('_', ' ')}",
        source=NOT_IN_PAPER,
        paper="not stated",
        kind=NOT_COMPARABLE,
        ours="; ".join(shares),
        statistics=rule,
        verdict=verdict,
    )
