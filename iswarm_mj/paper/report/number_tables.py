"""Markdown tables of the numbers in results: medians and intervals of each group of runs."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from iswarm_mj.paper.analysis import measures as m
from iswarm_mj.paper.analysis.choice_effects import effects_of_choices
from iswarm_mj.paper.analysis.evolution import N_BEST, Evolutions
from iswarm_mj.paper.analysis.findings import ALPHA, interval_text, number_text
from iswarm_mj.paper.analysis.judge import EQUALITY_MARGIN, Estimate
from iswarm_mj.paper.analysis.measures import Measure, count_finished, values
from iswarm_mj.paper.analysis.statistics import ratio, ratio_trend
from iswarm_mj.paper.report.markdown import markdown_table
from iswarm_mj.paper.studies.reading_support import (
    Combination,
    Sample,
    Support,
    accept_best,
    combinations_of,
    support_of_factors,
)
from iswarm_mj.paper.studies.registry import EXPERIMENTS
from iswarm_mj.search.best import LAST_GENERATIONS
from iswarm_mj.search.rows import Rows, by, select
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.intervals import interval

_TRIAL_COLUMNS = ("experiment", "relative_humidity")
_TRIAL_MEASURES = (m.VOLTAGE,)
_HEADINGS = {"use_hop_count": "hop counts"}
"""Headings of columns that are not the column's name with spaces."""


# --- Groups of runs and of trials ---


def runs_table(experiment: str, rows: Rows) -> str:
    """Return a line for each group of runs of an experiment.

    It has the number of runs that reached the goal, and medians with their intervals.
    """
    return _medians_table(
        rows,
        EXPERIMENTS[experiment].columns,
        EXPERIMENTS[experiment].measures,
        count=count_finished,
        count_heading="runs that reach the goal",
    )


def trials_table(rows: Rows) -> str:
    """Return a line for each group of trials, without those that are faulty.

    It has the number of trials that reached a voltage, and the median voltage with its interval.
    """
    return _medians_table(
        select(rows, faulty=False),
        _TRIAL_COLUMNS,
        _TRIAL_MEASURES,
        count=lambda trials: len(values(trials, m.VOLTAGE)),
        count_heading="trials in which it happened",
    )


def _medians_table(
    rows: Rows,
    columns: Sequence[str],
    measures: Sequence[Measure],
    count: Callable[[Rows], int],
    count_heading: str,
) -> str:
    """Return a table of the medians of measures, a line for each group.

    Args:
        rows: runs or trials.
        columns: columns that tell the groups apart.
        measures: measures of the medians.
        count: returns the number of rows of a group that count.
        count_heading: heading of these numbers.
    """
    lines = []
    for key, group in by(rows, *columns).items():
        labels = key if isinstance(key, tuple) else (key,)
        line = [_label_text(label) for label in labels]
        line.append(f"{count(group)} of {len(group)}")
        line += [_median_text(values(group, measure)) for measure in measures]
        lines.append(line)

    head = [_HEADINGS.get(column, column.replace("_", " ")) for column in columns]
    head.append(count_heading)
    head += [f"{measure.label}, median" for measure in measures]
    return markdown_table(head, lines)


def _median_text(sample: Array) -> str:
    """Return the median of a sample with its interval; nothing without values."""
    return interval_text(interval(sample, np.median)) if len(sample) else ""


def _label_text(value: Any) -> str:
    """Return the label of a group as text."""
    if isinstance(value, bool):
        return "with" if value else "without"
    if isinstance(value, float):
        return f"{value:g}"
    return str(value).replace("_", " ")


# --- Choices ---


def sensitivity_table(rows: Rows) -> str:
    """Return the choices that change the time to the goal, those with the smallest p first."""
    clear = [effect for effect in effects_of_choices(rows) if effect.p < ALPHA]
    lines = [
        [
            f"`{effect.choice}`",
            effect.value,
            effect.reached,
            interval_text(effect.change),
            number_text(effect.p, 2),
            number_text(effect.adjusted_p, 2),
        ]
        for effect in sorted(clear, key=lambda effect: effect.p)
    ]
    head = [
        "choice",
        "value",
        "runs that reach the goal",
        "change of the mean time [steps]",
        "p",
        "p by Holm",
    ]
    return markdown_table(head, lines)


# --- Evolutions ---


def evolution_table(samples: Mapping[str, Evolutions]) -> str:
    """Return what the searches by each method found: medians over their replicates."""
    lines = []
    for method, evolutions in samples.items():
        final = [evolution.final_fitness for evolution in evolutions]
        best_runs = [evolution.best_runs_fitness for evolution in evolutions]
        best = max(evolution.bests.max() for evolution in evolutions)
        line = [
            method,
            len(evolutions),
            sum(len(evolution.rows) for evolution in evolutions),
            sum(len(evolution.cleaning_runs) for evolution in evolutions),
            interval_text(interval(final, np.median), digits=4),
            interval_text(interval(best_runs, np.median), digits=4),
            f"{best:.0f}",
        ]
        lines.append(line)
    head = [
        "method",
        "replicates",
        "runs",
        "deliver all",
        f"mean fitness, last {LAST_GENERATIONS} generations",
        f"best {N_BEST} runs",
        "best run",
    ]
    return markdown_table(head, lines)


# --- Readings ---


def readings_tables(rows: Rows) -> str:
    """Return two tables: how many statements of the paper readings reproduce, and their support.

    A factor is a choice that the paper leaves open, and its labels are the readings that were
    tried. The experiment draws combinations at random, each with a label of each factor, and
    accepts those that reproduce the most statements. See `reading_support` for the method, and
    for the statements by which combinations are selected and those that are held out.

    Args:
        rows: runs of the experiment `infer`.
    """
    combinations = combinations_of(rows)
    sample = accept_best(combinations)
    tables = (
        _reproduction_table(combinations, sample),
        _support_table(combinations, sample),
    )
    return "\n\n".join(tables)


def _reproduction_table(combinations: Sequence[Combination], sample: Sample) -> str:
    """Return a line for all combinations drawn, for those accepted, and for each named reading.

    It has the numbers of statements that they reproduce: of those that select, by all runs of a
    combination and by single runs, and of those that are held out.
    """
    groups = {
        f"all {len(sample.drawn)}": sample.drawn,
        f"the {len(sample.accepted)} accepted": sample.accepted,
    }
    for combination in combinations:
        if combination.is_named:
            groups[f"reading `{combination.reading}`"] = [combination]

    head = [
        "combinations",
        f"statements that select reproduced, of {len(combinations[0].answers)}",
        "mean by single runs",
        f"mean of the {len(combinations[0].held_out)} held out",
    ]
    lines = [_reproduced_line(label, group) for label, group in groups.items()]
    return markdown_table(head, lines)


def _support_table(combinations: Sequence[Combination], sample: Sample) -> str:
    """Return a line for each factor, with the support of each of its labels.

    Support is the label's share of the accepted combinations; the p-value that acceptance does not
    depend on the label; how many of the statements that select the reading `paper` reproduces with
    this label alone changed; and how many more than with the default its single runs reproduce.
    """
    head = [
        "reading",
        f"share of the {len(sample.accepted)} accepted of {len(sample.drawn)}",
        "p",
        "p by Holm",
        "statements that select and `paper` reproduces with this value, the default first",
        "more by single runs",
    ]
    supports = support_of_factors(combinations)
    lines = [_support_line(factor, support) for factor, support in supports.items()]
    return markdown_table(head, lines)


def _reproduced_line(label: str, group: Sequence[Combination]) -> list[object]:
    """Return how many statements a group of combinations reproduces."""
    selecting = [combination.n_selecting for combination in group]
    held_out = [combination.n_held_out for combination in group]
    single_runs = [n for combination in group for n in combination.single_run_counts]

    reproduced = f"{np.median(selecting):g}"
    if len(group) == 1:
        return [label, reproduced, interval_text(interval(single_runs)), held_out[0]]
    most = max(selecting)
    return [
        label,
        f"{reproduced}; at most {most}, by {selecting.count(most)}",
        interval_text(interval(single_runs)),
        interval_text(interval(held_out)),
    ]


def _support_line(factor: str, support: Support) -> list[str]:
    """Return the support of a factor's labels."""
    shares = (f"{label}: {interval_text(share, '%', 2)}" for label, share in support.shares.items())
    counts = (f"{label}: {count}" for label, count in support.counts.items())
    gains = (f"{label}: {interval_text(gain)}" for label, gain in support.gains.items())
    return [
        factor.replace("_", " "),
        "; ".join(shares),
        number_text(support.p, 2),
        number_text(support.adjusted_p, 2),
        "; ".join(counts),
        "; ".join(gains),
    ]


# --- Two engines ---

Swarm = float | None
"""A density of Fig. 17; None for the swarm of Fig. 15 with hop counts."""


class _PairedTimes(NamedTuple):
    """Finishing times of the same swarms in two directories [control steps]."""

    first: Mapping[Swarm, Array]
    """Times in the first directory."""
    second: Mapping[Swarm, Array]
    """Times in the second directory."""

    def of(self, swarms: Sequence[Swarm]) -> tuple[list[Array], list[Array]]:
        """Return the times of these swarms in the first and in the second directory."""
        first = [self.first[swarm] for swarm in swarms]
        second = [self.second[swarm] for swarm in swarms]
        return first, second

    def ratio_cells(self, swarms: Sequence[Swarm]) -> list[str]:
        """Return the ratio of the times of these swarms, and the verdict that it is one."""
        first, second = self.of(swarms)
        sizes = tuple(len(times) for times in (*first, *second))
        estimate = Estimate(
            ratio(first, second), sizes, low=1 - EQUALITY_MARGIN, high=1 + EQUALITY_MARGIN
        )
        return [interval_text(estimate.interval), estimate.verdict]


def engines_table(rows_of_directory: Mapping[str, Mapping[str, Rows]]) -> str:
    """Return the finishing times in two directories, and whether they are equal.

    They are compared group by group and together. The last line has the trend of their ratio over
    the density, which the mean of all could hide. Swarms that only one directory has are left out,
    and those without hop counts, since none of their runs need end before the limit.

    Args:
        rows_of_directory: rows of two directories, by the names of the experiments.
    """
    directories = list(rows_of_directory)
    first, second = (_finishing_times(experiments) for experiments in rows_of_directory.values())
    times = _PairedTimes(first, second)
    common = [swarm for swarm in first if swarm in second]

    lines = []
    for swarm in common:
        name = "Fig. 15, with hop counts" if swarm is None else f"Fig. 17, density {swarm:g}"
        medians = [number_text(float(np.median(each[swarm]))) for each in times]
        lines.append([name, *medians, *times.ratio_cells([swarm])])
    lines.append(["all", "", "", *times.ratio_cells(common)])

    # Whether the ratio changes with the density.
    densities = [swarm for swarm in common if swarm is not None]
    trend = ratio_trend(densities, *times.of(densities))
    name = "slope of the ratio's logarithm over the density"
    lines.append([name, "", "", interval_text(trend), "no rule"])

    head = [
        "swarm",
        f"`{directories[0]}`: median time [steps]",
        f"`{directories[1]}`",
        "ratio of the times (95 % interval)",
        f"equal within {100 * EQUALITY_MARGIN:.0f} %",
    ]
    return markdown_table(head, lines)


def _finishing_times(experiments: Mapping[str, Rows]) -> dict[Swarm, Array]:
    """Return the finishing times of each swarm [control steps].

    Args:
        experiments: rows of the experiments on hop counts and on the density.
    """
    times: dict[Swarm, Array] = {}
    times[None] = values(select(experiments["hop-count"], use_hop_count=True), m.TIME)
    for density, runs in sorted(by(experiments["density"], "density").items()):
        times[density] = values(runs, m.TIME)
    return times
