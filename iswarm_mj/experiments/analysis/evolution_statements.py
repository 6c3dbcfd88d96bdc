"""The statements of section 4.6.1 as quantities of one evolution, with the limits between which they hold."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from iswarm_mj.experiments.analysis import evolution_claims as claims
from iswarm_mj.experiments.analysis import evolution_told as told
from iswarm_mj.experiments.analysis.evolution_sample import (
    FIRST,
    GROUP,
    LAST,
    PLATEAU,
    RISE,
    Evolution,
    share_with,
)
from iswarm_mj.experiments.analysis.findings import Claim
from iswarm_mj.experiments.analysis.paper import NEARLY, PAPER_FITNESS
from iswarm_mj.experiments.analysis.verdicts import RARE
from iswarm_mj.strategy.genome import Genome

NEAR = 0.05
"""Margin of the equivalence tests on parameters of swarms: the largest step of the paper's dependent mutation. Means
that differ by less are within one mutation of each other, so that no evolution of this kind tells them apart. Of shares
of the elites, one in twenty."""
DENSITIES = (0.1, 0.15)
"""Margin of the density to which evolutions converge: the range that section 4.6.2 calls optimal as a whole."""
FEW = (0.02, 0.08)
"""Margin of the share of the swarms without hop counts that clean the arena: half and twice the paper's 4 %."""
FITNESS = max(PAPER_FITNESS.values())
"""Points of the paper's fittest swarm."""


class Quantity(NamedTuple):
    """A statement on the median over evolutions."""

    claim: Claim
    value: Callable[[Evolution], float | None]
    told: told.Told
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
    told: told.Told


def _equal(claim: Claim, name: str) -> Quantity:
    """A parameter is equal in runs that clean the arena and in others."""
    return Quantity(claim, lambda one: one.apart(name), told.groups(name), _BOTH, low=-NEAR, high=NEAR)


def _level(claim: Claim, name: str, paper: float) -> Quantity:
    """A parameter is the paper's in runs that clean the arena."""
    return Quantity(
        claim,
        lambda one: one.level(name),
        told.level(name),
        f"{GROUP} such runs",
        low=paper - NEAR,
        high=paper + NEAR,
    )


_BOTH = f"{GROUP} runs of both groups"
STATEMENTS: tuple[Quantity | Property, ...] = (
    Quantity(
        claims.RISES,
        lambda one: one.rise,
        told.medians(
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
        told.medians(
            "mean fitness {} against {} points; difference",
            lambda one: one.means[-LAST:].mean(),
            lambda one: one.means[:FIRST].mean(),
        ),
        f"{FIRST + LAST} generations",
        low=0.0,
        unit="points",
    ),
    Quantity(
        claims.AS_FIT,
        lambda one: one.best_run,
        lambda sample: (
            f"{100 * np.median([one.best_run for one in sample]) / FITNESS - 100:+.1f} % against the paper's"
        ),
        "",
        low=(1 - NEARLY) * FITNESS,
        high=(1 + NEARLY) * FITNESS,
        unit="points",
    ),
    Quantity(
        claims.SLOW,
        lambda one: one.early,
        lambda sample: f"the earliest at step {min(row['finished_at'] for row in told.runs_of(sample, 'good'))}",
        f"{GROUP} runs that do",
        high=RARE,
        scale=100,
        unit="%",
    ),
    Quantity(
        claims.MANY_FAIL,
        lambda one: len(one.poor) / len(one.rows) if len(one.rows) >= GROUP else None,
        lambda sample: f"{len(told.runs_of(sample, 'poor'))} of {len(told.runs_of(sample, 'rows'))} runs",
        f"{GROUP} runs",
        low=0.2,
        scale=100,
        unit="%",
    ),
    Quantity(
        claims.COUNTED,
        lambda one: share_with(one.good, True),
        told.counted("good", True),
        f"{GROUP} such runs",
        low=0.9,
        scale=100,
        unit="%",
    ),
    Quantity(
        claims.UNCOUNTED,
        lambda one: share_with(one.poor, False),
        told.counted("poor", False),
        f"{GROUP} such runs",
        low=0.5,
        scale=100,
        unit="%",
    ),
    Quantity(
        claims.EXCEPTIONS,
        lambda one: one.exceptions,
        told.exceptions,
        f"{GROUP} such runs",
        *FEW,
        scale=100,
        unit="%",
    ),
    _level(claims.SCOUTS_LEVEL, "fraction_scouts", 0.16),
    _level(claims.FORGET_LEVEL, "p_vector_forget", 0.28),
    _equal(claims.SCOUTS, "fraction_scouts"),
    _equal(claims.FORGET, "p_vector_forget"),
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
        lambda sample: f"{told.best('density_of_robots')(sample)}; median of the last {LAST} generations",
        f"{FIRST + LAST} generations",
        *DENSITIES,
        scale=100,
        unit="%",
    ),
    Property(
        claims.SIGNALS,
        lambda best: best.priority_signal_loaded and not best.priority_signal_scouts,
        told.best("priority_signal_loaded", "priority_signal_scouts"),
    ),
    Quantity(
        claims.WEIGHTS,
        lambda one: one.best.weight_find_dump - one.best.weight_find_dust,
        lambda sample: f"{told.best('weight_find_dump', 'weight_find_dust')(sample)}; difference",
        "",
        low=0.0,
    ),
    Property(
        claims.DISTANCES,
        lambda best: best.empty_coll_avoid_dist > best.priority_coll_avoid_dist > best.loaded_coll_avoid_dist,
        told.best("empty_coll_avoid_dist", "priority_coll_avoid_dist", "loaded_coll_avoid_dist"),
    ),
)
