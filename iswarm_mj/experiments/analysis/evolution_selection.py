"""Selection against drift: do evolutions agree on a trait, or does each end somewhere?

Drift moves the traits of an evolution, but has no direction: mutations and limits are symmetric about the middle of
each range, so that without selection the median over evolutions is that of random search. A median that differs from it
over replicates of both was moved by selection.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.experiments.analysis.evolution_sample import EVOLUTIONS, LAST, Evolution
from iswarm_mj.experiments.analysis.findings import (
    FAILS,
    HOLDS,
    NOT_IN_PAPER,
    PREDICTED,
    TOO_FEW,
    UNDECIDED,
    Claim,
    Finding,
    number,
    span,
)
from iswarm_mj.experiments.analysis.statistics import Interval, compare, holm
from iswarm_mj.experiments.analysis.verdicts import within

SURE = 0.05
"""Level of the p-values adjusted for the number of traits: without, one of 20 that are not moved would seem so."""


class Trait(NamedTuple):
    """What selection may act on."""

    claim: Claim
    label: str
    """For axes."""
    value: Callable[[Evolution], float | None]
    limits: tuple[float, float | None] = (0.0, 1.0)
    """Of axes."""


def _trait(what: str, *fields: Any) -> Trait:
    return Trait(Claim(f"Selection moves {what}", NOT_IN_PAPER, "not studied", PREDICTED), *fields)


def _weights(one: Evolution) -> float | None:
    dump, dust = one.late("weight_find_dump"), one.late("weight_find_dust")
    return None if dump is None or dust is None else dump - dust


TRAITS = (
    _trait("the density of robots", "density", lambda one: one.late("density_of_robots"), (0.0, None)),
    _trait("the fraction of scouts", "fraction of scouts", lambda one: one.late("fraction_scouts")),
    _trait("p(vector-forget)", "p(vector-forget)", lambda one: one.late("p_vector_forget")),
    _trait("the use of hop counts", "with hop counts", lambda one: one.late("use_hop_count")),
    _trait("the priority signal of loaded robots", "loaded signal", lambda one: one.late("priority_signal_loaded")),
    _trait("the priority signal of scouts", "scouts signal", lambda one: one.late("priority_signal_scouts")),
    _trait("weight-find-dump against weight-find-dust", "weights, dump minus dust", _weights, (-1.0, 1.0)),
    _trait(
        "the correlation of p(vector-forget) with scouts among the 250 fittest of generations 35 to 100",
        "r of forgetting and scouts",
        lambda one: one.trade,
        (-1.0, 1.0),
    ),
)
"""Means of the last generations, of Booleans those of the elites; but for the correlation."""


def findings(mine: Sequence[Evolution], random: Sequence[Evolution] | None, near: float) -> list[Finding]:
    """One finding for each trait.

    Args:
        mine: the evolutions.
        random: random searches of as many generations; None without.
        near: difference of the medians that counts as none.
    """
    if random is None:
        return [trait.claim.not_run() for trait in TRAITS]
    samples = [(_values(trait, mine), _values(trait, random)) for trait in TRAITS]
    judged = [min(map(len, pair)) >= EVOLUTIONS for pair in samples]
    results = [compare(*pair) if ok else None for pair, ok in zip(samples, judged, strict=True)]
    every_p = iter(holm([result.p for result in results if result]))
    found = []
    for trait, pair, result in zip(TRAITS, samples, results, strict=True):
        ours = " against ".join(number(float(np.median(values))) if values else "no value" for values in pair)
        ours += f" in random search; medians of {len(pair[0])} and {len(pair[1])} searches"
        if result is None:
            needs = f"one evolution is one sample: needs {EVOLUTIONS} of both searches (--replicates)"
            found.append(trait.claim.found(ours, needs, TOO_FEW))
            continue
        adjusted = next(every_p)
        tested = (
            f"of means of the last {LAST} generations, of shares of their elites, or of correlations; difference "
            f"{span(result.difference)}, Mann-Whitney p = {number(result.p, 2)}, {number(adjusted, 2)} by Holm for "
            f"{sum(judged)} traits; holds if that is below {SURE} and the interval leaves out zero, else does not if "
            f"it lies within {near}"
        )
        found.append(trait.claim.found(ours, tested, _moved(result.difference, adjusted, near)))
    return found


def _values(trait: Trait, sample: Sequence[Evolution]) -> list[float]:
    return [value for value in map(trait.value, sample) if value is not None]


def _moved(value: Interval, p: float, near: float) -> str:
    """HOLDS if the p-value, adjusted, and the interval tell a difference, else FAILS if that is surely near zero."""
    if p < SURE and (value.low > 0 or value.high < 0):
        return HOLDS
    return FAILS if within(value, -near, near) == HOLDS else UNDECIDED
