"""The statements of section 4.6.1 as quantities of one evolution, with the limits between which they hold."""

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.experiments.analysis import evolution_claims as claims
from iswarm_mj.experiments.analysis.evolution_sample import (
    FIRST,
    GROUP,
    LAST,
    PLATEAU,
    RISE,
    Evolution,
    share_with,
)
from iswarm_mj.experiments.analysis.findings import Claim, number
from iswarm_mj.strategy.genome import Genome

NEAR = 0.05
"""Margin of the equivalence tests on parameters of swarms: the largest step of the paper's dependent mutation. Means
that differ by less are within one mutation of each other, so that no evolution of this kind tells them apart."""
DENSITIES = (0.1, 0.15)
"""Margin of the density to which evolutions converge: the range that section 4.6.2 calls optimal as a whole."""

Evolutions = Sequence[Evolution]


class Quantity(NamedTuple):
    """A statement on the median over evolutions."""

    claim: Claim
    value: Callable[[Evolution], float | None]
    told: Callable[[Evolutions], str]
    """What else is told of all evolutions together."""
    needs: str
    """What an evolution without a value lacks."""
    low: float = -math.inf
    high: float = math.inf
    """The statement holds between the limits."""
    scale: float = 1.0
    unit: str = ""
    """Values are shown times `scale`, in this unit."""


class Property(NamedTuple):
    """A statement that most of the evolutions have a property of their best genome."""

    claim: Claim
    has: Callable[[Genome], bool]
    told: Callable[[Evolutions], str]


def _all(sample: Evolutions, group: str) -> list[Any]:
    return [row for one in sample for row in getattr(one, group)]


def _runs(group: str, flag: bool) -> Callable[[Evolutions], str]:
    """How many runs of a group have or lack hop counts."""

    def told(sample: Evolutions) -> str:
        rows = _all(sample, group)
        return f"{sum(row['use_hop_count'] is flag for row in rows)} of {len(rows)} runs"

    return told


def _groups(name: str) -> Callable[[Evolutions], str]:
    """Mean and standard deviation of a parameter in both groups, the paper's form."""

    def told(sample: Evolutions) -> str:
        both = [np.array([row[name] for row in _all(sample, group)]) for group in ("good", "poor")]
        clean, others = (f"{values.mean():.2f} ± {values.std(ddof=1):.2f}" for values in both)
        return f"runs that clean {clean}, others {others}; difference of the means"

    return told


def _best(*names: str) -> Callable[[Evolutions], str]:
    """Medians of parameters of the best genomes, of a Boolean the number of genomes in which it is true."""

    def told(sample: Evolutions) -> str:
        found = [(name, [getattr(one.best, name) for one in sample]) for name in names]
        return "best genomes " + ", ".join(
            f"{name} in {sum(v)} of {len(v)}" if isinstance(v[0], bool) else f"{name} {number(float(np.median(v)))}"
            for name, v in ((name.replace("_", "-"), v) for name, v in found)
        )

    return told


def _medians(text: str, *values: Callable[[Evolution], float]) -> Callable[[Evolutions], str]:
    return lambda sample: text.format(*(f"{np.median([value(one) for one in sample]):z.0f}" for value in values))


_BOTH = f"{GROUP} runs of both groups"
STATEMENTS: tuple[Quantity | Property, ...] = (
    Quantity(
        claims.RISES,
        lambda one: one.rise,
        _medians(
            f"best of a generation {{}} in the first, {{}} in the {RISE}th, {{}} at most; "
            "correlation with the generation",
            lambda one: one.bests[0],
            lambda one: one.bests[RISE - 1],
            lambda one: one.bests.max(),
        ),
        f"{RISE} generations",
        low=0.5,
    ),
    Quantity(
        claims.LEARNS,
        lambda one: one.gain,
        _medians(
            "mean fitness {} against {} points; difference",
            lambda one: one.means[-LAST:].mean(),
            lambda one: one.means[:FIRST].mean(),
        ),
        f"{FIRST + LAST} generations",
        low=0.0,
        unit="points",
    ),
    Quantity(
        claims.MANY_FAIL,
        lambda one: len(one.poor) / len(one.rows) if len(one.rows) >= GROUP else None,
        lambda sample: f"{len(_all(sample, 'poor'))} of {len(_all(sample, 'rows'))} runs",
        f"{GROUP} runs",
        low=0.2,
        scale=100,
        unit="%",
    ),
    Quantity(
        claims.COUNTED,
        lambda one: share_with(one.good, True),
        _runs("good", True),
        f"{GROUP} such runs",
        low=0.9,
        scale=100,
        unit="%",
    ),
    Quantity(
        claims.UNCOUNTED,
        lambda one: share_with(one.poor, False),
        _runs("poor", False),
        f"{GROUP} such runs",
        low=0.5,
        scale=100,
        unit="%",
    ),
    Quantity(
        claims.SCOUTS, lambda one: one.apart("fraction_scouts"), _groups("fraction_scouts"), _BOTH, low=-NEAR, high=NEAR
    ),
    Quantity(
        claims.FORGET, lambda one: one.apart("p_vector_forget"), _groups("p_vector_forget"), _BOTH, low=-NEAR, high=NEAR
    ),
    Quantity(
        claims.TRADE,
        lambda one: one.trade,
        lambda sample: f"{sum(len(one.top) for one in sample)} runs; r",
        f"{PLATEAU[1]} generations",
        high=0.0,
    ),
    Quantity(
        claims.DENSITY,
        lambda one: one.density,
        lambda sample: f"{_best('density_of_robots')(sample)}; median of the last {LAST} generations",
        f"{FIRST + LAST} generations",
        *DENSITIES,
        scale=100,
        unit="%",
    ),
    Property(
        claims.SIGNALS,
        lambda best: best.priority_signal_loaded and not best.priority_signal_scouts,
        _best("priority_signal_loaded", "priority_signal_scouts"),
    ),
    Quantity(
        claims.WEIGHTS,
        lambda one: one.best.weight_find_dump - one.best.weight_find_dust,
        lambda sample: f"{_best('weight_find_dump', 'weight_find_dust')(sample)}; difference",
        "",
        low=0.0,
    ),
    Property(
        claims.DISTANCES,
        lambda best: best.empty_coll_avoid_dist > best.priority_coll_avoid_dist > best.loaded_coll_avoid_dist,
        _best("empty_coll_avoid_dist", "priority_coll_avoid_dist", "loaded_coll_avoid_dist"),
    ),
)
