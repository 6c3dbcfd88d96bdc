"""Markdown tables of the numbers in results: medians and intervals of each group of runs."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from iswarm_mj.paper.analysis import measures as m
from iswarm_mj.paper.analysis.evolution import BEST, Evolutions
from iswarm_mj.paper.analysis.findings import ALPHA, number, short
from iswarm_mj.paper.analysis.judge import EQUAL, Estimate
from iswarm_mj.paper.analysis.measures import finished, values
from iswarm_mj.paper.analysis.statements import changes
from iswarm_mj.paper.analysis.statistics import interval, ratio, trend
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.paper.studies.support import combinations_of, sample_of, supports
from iswarm_mj.search.best import LAST
from iswarm_mj.search.rows import Rows, by, select
from iswarm_mj.utils.arrays import Array

_TRIALS = (("experiment", "relative_humidity"), (m.VOLTAGE,))


def text(value: object) -> str:
    """A value in one line of a page or a cell of a table; tags, links and pictures in it are shown
    as text."""
    line = re.sub(r"<(?=[A-Za-z/!?])", "&lt;", " ".join(str(value).split())).replace("](", "]\\(")
    return re.sub(r"(?<!\\)\|", r"\\|", line)


def table(head: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(text(cell) for cell in line) + " |" for line in lines)


def grouped(name: str, rows: Rows) -> str:
    """A line for each group: how many of its runs reached the goal, and medians with their
    intervals."""
    trials = name not in EXPERIMENTS
    columns, measures = (
        _TRIALS if trials else (EXPERIMENTS[name].columns, EXPERIMENTS[name].measures)
    )
    lines = []
    for key, runs in by(select(rows, faulty=False) if trials else rows, *columns).items():
        reached = len(values(runs, m.VOLTAGE)) if trials else finished(runs)
        found = [values(runs, measure) for measure in measures]
        medians = [short(interval(each, np.median)) if len(each) else "" for each in found]
        labels = map(_label, key if isinstance(key, tuple) else (key,))
        lines.append([*labels, f"{reached} of {len(runs)}", *medians])
    head = [column.replace("_", " ").replace("use hop count", "hop counts") for column in columns]
    head.append("trials in which it happened" if trials else "runs that reach the goal")
    return table([*head, *(f"{one.label}, median" for one in measures)], lines)


def _label(value: Any) -> str:
    if isinstance(value, bool):
        return "with" if value else "without"
    return f"{value:g}" if isinstance(value, float) else str(value).replace("_", " ")


def sensitivity(rows: Rows) -> str:
    """The choices that change the time to the goal."""
    found = sorted((c for c in changes(rows) if c.p < ALPHA), key=lambda c: c.p)
    lines = [
        [
            f"`{c.choice}`",
            c.value,
            c.reached,
            short(c.effect),
            *(number(p, 2) for p in (c.p, c.adjusted)),
        ]
        for c in found
    ]
    head = [
        "choice",
        "value",
        "runs that reach the goal",
        "change of the mean time [steps]",
        "p",
        "p by Holm",
    ]
    return table(head, lines)


def evolution(samples: Mapping[str, Evolutions]) -> str:
    """What the searches by each method found: medians over their replicates."""
    lines = []
    for method, found in samples.items():
        medians = (
            interval([getattr(one, name) for one in found], np.median)
            for name in ("final", "best_runs")
        )
        runs, clean = sum(len(one.rows) for one in found), sum(len(one.good) for one in found)
        best = max(one.bests.max() for one in found)
        lines.append(
            [
                method,
                len(found),
                runs,
                clean,
                *(short(each, digits=4) for each in medians),
                f"{best:.0f}",
            ]
        )
    head = ["method", "replicates", "runs", "deliver all", f"mean fitness, last {LAST} generations"]
    return table([*head, f"best {BEST} runs", "best run"], lines)


def readings(rows: Rows) -> str:
    """What combinations reproduce, and the support of each reading by those that miss the fewest
    statements."""
    every = combinations_of(rows)
    sample, kept = sample_of(every)
    groups = {f"all {len(sample)}": sample, f"the {len(kept)} accepted": kept}
    groups |= {f"reading `{one.reading}`": [one] for one in every if one.is_named}
    counted = []
    for label, group in groups.items():
        counts, others = [sum(one.answers) for one in group], [sum(one.held_out) for one in group]
        most = f"; at most {max(counts)}, by {counts.count(max(counts))}" if len(group) > 1 else ""
        single = short(interval([n for one in group for n in one.single]))
        held_out = short(interval(others)) if len(group) > 1 else others[0]
        counted.append([label, f"{np.median(counts):g}{most}", single, held_out])
    head = [
        "combinations",
        f"statements that select reproduced, of {len(every[0].answers)}",
        "mean by single runs",
    ]
    first = table([*head, f"mean of the {len(every[0].held_out)} held out"], counted)
    lines = [
        [
            name.replace("_", " "),
            "; ".join(f"{label}: {short(share, '%', 2)}" for label, share in one.shares.items()),
            *(number(value, 2) for value in (one.p, one.adjusted)),
            "; ".join(f"{label}: {n}" for label, n in one.counts.items()),
            "; ".join(f"{label}: {short(change)}" for label, change in one.more.items()),
        ]
        for name, one in supports(every).items()
    ]
    head = ["reading", f"share of the {len(kept)} accepted of {len(sample)}", "p", "p by Holm"]
    alone = [
        "statements that select and `paper` reproduces with this value, the default first",
        "more by single runs",
    ]
    return first + "\n\n" + table([*head, *alone], lines)


def engines(found: Mapping[str, Mapping[str, Rows]]) -> str:
    """Table of the finishing times in two directories, and whether they are equal, group by group
    and together.

    The last line tells whether their ratio changes with the density, which the mean of all could
    hide. Swarms without hop counts are left out, since none of their runs need end before the
    limit, and those that only one directory has.
    """
    (one, first), (other, second) = ((place, _times(parts)) for place, parts in found.items())
    both = [swarm for swarm in first if swarm in second]

    def pairs(swarms: Sequence[float | None]) -> tuple[list[Array], list[Array]]:
        return [first[swarm] for swarm in swarms], [second[swarm] for swarm in swarms]

    def judged(swarms: Sequence[float | None]) -> list[str]:
        sizes = tuple(len(values) for group in pairs(swarms) for values in group)
        estimate = Estimate(ratio(*pairs(swarms)), sizes, 1 - EQUAL, 1 + EQUAL)
        return [short(estimate.value), estimate.verdict]

    lines = [
        [
            "Fig. 15, with hop counts" if swarm is None else f"Fig. 17, density {swarm:g}",
            *(number(float(np.median(group[swarm]))) for group in (first, second)),
            *judged([swarm]),
        ]
        for swarm in both
    ]
    densities = [swarm for swarm in both if swarm is not None]
    lines.append(["all", "", "", *judged(both)])
    slope = short(trend(densities, *pairs(densities)))
    lines.append(["slope of the ratio's logarithm over the density", "", "", slope, "no rule"])
    head = [
        "swarm",
        f"`{one}`: median time [steps]",
        f"`{other}`",
        "ratio of the times (95 % interval)",
    ]
    return table([*head, f"equal within {100 * EQUAL:.0f} %"], lines)


def _times(parts: Mapping[str, Rows]) -> dict[float | None, Array]:
    """Times by the density of Fig. 17, and None for Fig. 15."""
    groups = {None: select(parts["hop-count"], use_hop_count=True)}
    groups |= dict(sorted(by(parts["density"], "density").items()))
    return {swarm: values(rows, m.TIME) for swarm, rows in groups.items()}
