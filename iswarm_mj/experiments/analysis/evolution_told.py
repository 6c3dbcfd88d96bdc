"""What is told of all evolutions together beside the number that decides a statement."""

from collections.abc import Callable, Sequence

import numpy as np

from iswarm_mj.experiments.analysis.evolution_sample import EVOLUTIONS, SOME, Evolution
from iswarm_mj.experiments.analysis.findings import Row, number, span
from iswarm_mj.experiments.analysis.statistics import interval, median

Evolutions = Sequence[Evolution]
Told = Callable[[Evolutions], str]


def runs_of(sample: Evolutions, group: str) -> list[Row]:
    """Runs of a group in all evolutions."""
    return [row for one in sample for row in getattr(one, group)]


def counted(group: str, flag: bool) -> Told:
    """How many runs of a group have or lack hop counts."""

    def told(sample: Evolutions) -> str:
        rows = runs_of(sample, group)
        return f"{sum(row['use_hop_count'] is flag for row in rows)} of {len(rows)} runs"

    return told


def exceptions(sample: Evolutions) -> str:
    """How many runs without hop counts clean the arena."""
    clean = sum(not row["use_hop_count"] for row in runs_of(sample, "good"))
    return f"{clean} of {len(runs_of(sample, 'without'))} runs"


def level(name: str) -> Told:
    """Mean and standard deviation of a parameter in runs that clean the arena, the paper's form."""
    return lambda sample: f"{_spread(sample, 'good', name)}; mean"


def groups(name: str) -> Told:
    """Mean and standard deviation of a parameter in both groups, the paper's form; the difference with hop counts."""

    def told(sample: Evolutions) -> str:
        clean, others = (_spread(sample, group, name) for group in ("good", "poor"))
        return f"runs that clean {clean}, others {others}; {_counted(sample, name)}; difference of the means"

    return told


def best(*names: str) -> Told:
    """Medians of parameters of the best genomes, of a Boolean the number of genomes in which it is true."""

    def told(sample: Evolutions) -> str:
        found = [(name, [getattr(one.best, name) for one in sample]) for name in names]
        return "best genomes " + ", ".join(
            f"{name} in {sum(v)} of {len(v)}" if isinstance(v[0], bool) else f"{name} {number(float(np.median(v)))}"
            for name, v in ((name.replace("_", "-"), v) for name, v in found)
        )

    return told


def medians(text: str, *values: Callable[[Evolution], float]) -> Told:
    """A text with the medians over evolutions of these values in its places."""
    return lambda sample: text.format(*(f"{np.median([value(one) for one in sample]):z.0f}" for value in values))


def of(n: int) -> str:
    """Words behind a median over so many evolutions."""
    return " in one evolution" if n == 1 else f", median of {n} evolutions"


def _spread(sample: Evolutions, group: str, name: str) -> str:
    values = np.array([row[name] for row in runs_of(sample, group)])
    return f"{values.mean():.2f} ± {values.std(ddof=1):.2f}"


def _counted(sample: Evolutions, name: str) -> str:
    """Difference of the groups' means among runs with hop counts: those without fail, whatever a parameter is."""
    values = [value for one in sample if (value := one.apart(name, counted=True)) is not None]
    among, enough = "difference of the means with hop counts alone", f"with {SOME} such runs of both groups"
    if not values:
        return f"{among}: no evolution {enough}"
    over = interval(values, median)
    shown = span(over) if len(values) >= EVOLUTIONS else number(over.estimate)
    return f"{among} {shown}{of(len(values))} {enough}"
