"""Whether two engines give the same: finishing times of the same runs, from two directories of results."""

from collections.abc import Mapping, Sequence

from iswarm_mj.experiments.analysis.findings import Rows, number
from iswarm_mj.experiments.analysis.measures import TIME, select, values
from iswarm_mj.experiments.analysis.statistics import Interval, median, ratio
from iswarm_mj.experiments.analysis.verdicts import EQUAL, enough, within
from iswarm_mj.experiments.report.markdown import markdown

PARTS = ("hop-count", "density")
"""Figs. 15 and 17."""


def engines(found: Mapping[str, Mapping[str, Rows]]) -> str:
    """Table of the finishing times in two directories, and whether they are equal, group by group and together.

    Swarms without hop counts are left out, since none of their runs need end before the limit, and those that only one
    directory has.

    Args:
        found: rows by directory and part.
    """
    (one, first), (other, second) = ((place, _groups(parts)) for place, parts in found.items())
    both = [name for name in first if name in second]
    lines = [
        [
            name,
            *(f"{number(float(median(group[name])))}" for group in (first, second)),
            *_judged([first[name]], [second[name]]),
        ]
        for name in both
    ]
    lines.append(["all", "", "", *_judged([first[name] for name in both], [second[name] for name in both])])
    head = ["swarm", f"`{one}`: median time [steps]", f"`{other}`", "ratio of the times (95 % interval)"]
    return markdown([*head, f"equal within {100 * EQUAL:.0f} %"], lines)


def _groups(parts: Mapping[str, Rows]) -> dict[str, Sequence[float]]:
    """Times by the names of swarms."""
    hop_count, density = (parts[name] for name in PARTS)
    groups = {"Fig. 15, with hop counts": select(hop_count, use_hop_count=True)}
    groups |= {
        f"Fig. 17, density {value:g}": select(density, density=value)
        for value in sorted({row["density"] for row in density})
    }
    return {name: values(rows, TIME) for name, rows in groups.items()}


def _judged(first: Sequence[Sequence[float]], second: Sequence[Sequence[float]]) -> list[str]:
    """Ratio of the times, and the verdict that they are equal."""
    found: Interval = ratio(first, second)
    said = f"{number(found.estimate)} ({number(found.low)} to {number(found.high)})"
    return [said, enough(within(found, 1 - EQUAL, 1 + EQUAL), *map(len, [*first, *second]))]
