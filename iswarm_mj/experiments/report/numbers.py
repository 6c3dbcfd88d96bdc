"""Markdown tables of the numbers in results: medians, means and intervals of each group of runs."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from iswarm_mj.experiments.analysis import measures as m
from iswarm_mj.experiments.analysis.beyond_statements import BALANCE, TRIALS, changes, paired
from iswarm_mj.experiments.analysis.evolution import BEST, LAST, samples_of
from iswarm_mj.experiments.analysis.findings import ALPHA, Rows, number, short, span
from iswarm_mj.experiments.analysis.judge import EQUAL, Estimate
from iswarm_mj.experiments.analysis.measures import by, finished, select, values
from iswarm_mj.experiments.analysis.statistics import difference, interval, ratio
from iswarm_mj.experiments.analysis.support import Combination, accepted, chances, counts_alone, more_alone
from iswarm_mj.experiments.report.markdown import table
from iswarm_mj.experiments.studies import infer
from iswarm_mj.utils.arrays import Array

Cell = Callable[[Rows], object]


def _middle(measure: m.Measure) -> Cell:
    """Median and, in brackets, third quartile, which are what the paper's figures show."""

    def cell(rows: Rows) -> str:
        found = values(rows, measure)
        return "{} ({})".format(*map(number, np.quantile(found, [0.5, 0.75]))) if len(found) else ""

    return cell


def _median(measure: m.Measure) -> Cell:
    return lambda rows: short(interval(values(rows, measure), np.median))


def _reached(rows: Rows) -> str:
    return f"{finished(rows)} of {len(rows)}"


def _apart(first: Rows, second: Rows, measure: m.Measure) -> str:
    groups = [values(group, measure) for group in (first, second)]
    return short(difference(groups[0], groups[1])) if all(map(len, groups)) else ""


def _optional(rows: Rows, column: str, told: Callable[[list[float]], str]) -> str:
    """What is told of the rows that have a value in a column; nothing of none."""
    found = [row[column] for row in rows if row[column] is not None]
    return told(found) if found else ""


def _grouped(groups: Mapping[Any, Rows], labels: Sequence[str], cells: Mapping[str, Cell]) -> str:
    """Table with a line for each group: its labels, then its cells."""
    lines = [
        [*(key if isinstance(key, tuple) else (key,)), *(c(rows) for c in cells.values())]
        for key, rows in groups.items()
    ]
    return table([*labels, *cells], lines)


def _hop_count(rows: Rows) -> str:
    groups = [select(rows, use_hop_count=flag) for flag in (True, False)]
    lines = [[one.label, *map(_middle(one), groups), _apart(groups[0], groups[1], one)] for one in m.MEASURES]
    head = ["medians (third quartiles)", f"with hop counts, {len(groups[0])} runs", f"without, {len(groups[1])}"]
    return table([*head, "difference (95 % interval)"], lines)


def _density(rows: Rows) -> str:
    cells = {
        "robots": lambda runs: runs[0]["n_robots"],
        f"runs that deliver {rows[0]['goal']}": _reached,
        "median (third quartile) of the time [steps]": _middle(m.TIME),
        "balls": _middle(m.DUST),
        "collisions a robot": _middle(m.COLLISIONS),
        "carriage [steps]": _middle(m.CARRIAGE),
    }
    return _grouped({f"{d:g}": runs for d, runs in sorted(by(rows, "density").items())}, ["density"], cells)


def _types(rows: Rows) -> str:
    cells = {
        "robots": lambda runs: runs[0]["n_robots"],
        "runs that deliver all": _reached,
        "median time [steps]": _median(m.TIME),
        "the paper": lambda runs: m.PAPER_TIME.get(runs[0]["type"], ""),
        "mean fitness": lambda runs: short(interval(values(runs, m.FITNESS)), 4),
        "the paper ": lambda runs: m.PAPER_FITNESS.get(runs[0]["type"], ""),
        "empty workers at dust areas": lambda runs: _optional(
            runs, "aggregation", lambda found: f"{100 * np.median(found):.0f} %"
        ),
    }
    return _grouped(by(rows, "type"), ["type"], cells)


def _robustness(rows: Rows) -> str:
    def part(kind: str, told: Cell) -> Cell:
        return lambda runs: told(mine) if (mine := select(runs, kind=kind)) else ""

    def median(runs: Rows) -> str:
        return number(float(np.median(values(runs, m.TIME))))

    cells = {
        "runs that reach the goal": part("dead", _reached),
        "median time, dead [steps]": part("dead", median),
        "absent": part("absent", median),
        "difference (95 % interval)": lambda runs: _apart(
            select(runs, kind="dead"), select(runs, kind="absent"), m.TIME
        ),
    }
    groups = {f"{100 * f:.0f} %": runs for f, runs in sorted(by(rows, "fraction").items())}
    return _grouped(groups, ["robots that fail"], cells)


def _sensitivity(rows: Rows) -> str:
    found = sorted((c for c in changes(rows) if c.p < ALPHA), key=lambda c: c.p)
    lines = [
        [f"`{c.choice}`", c.value, c.reached, short(c.effect), *(number(p, 2) for p in (c.p, c.adjusted))]
        for c in found
    ]
    head = ["choice", "value", "runs that reach the goal", "change of the mean time [steps]", "p", "p by Holm"]
    return table(head, lines)


def _message_time(rows: Rows) -> str:
    cells = {
        f"runs that deliver {rows[0]['goal']}": _reached,
        "median time [steps]": _median(m.TIME),
        "balls": _median(m.DUST),
        "collisions a robot": _median(m.COLLISIONS),
    }
    groups = by(rows, "setting", "use_hop_count")
    named = {(name, "with" if flag else "without"): runs for (name, flag), runs in groups.items()}
    return _grouped(named, ["messages", "hop counts"], cells)


def _resolved_grasps(rows: Rows) -> str:
    lines = []
    for (name, humidity, voltage), mine in by(rows, "type", "relative_humidity", "grasp_voltage").items():
        for kind, told in ((BALANCE, "balance"), (TRIALS, "trials")):
            runs = select(mine, resolution=kind)
            shown = [_reached(runs), _median(m.TIME)(runs)]
            counts = (m.ATTEMPTS, m.FAILED, m.STUCK, m.BROKEN, m.LOST)
            shown += [short(interval(values(runs, measure))) for measure in counts]
            static, dynamic = paired(mine, m.TIME)
            shown.append(short(interval(dynamic - static)) if kind == TRIALS and len(static) else "")
            lines.append([name, f"{humidity:g} %", f"{voltage:g} V", told, *shown])
    head = ["type", "humidity", "voltage", "grasps by", f"runs that deliver {rows[0]['goal']}", "median time [steps]"]
    means = ["attempts a ball", "failed grasps a run", "failed releases", "of both, broken off", "time lost [robot s]"]
    return table([*head, *means, "longer than by the balance, mean of pairs [steps]"], lines)


def _time_step(rows: Rows) -> str:
    cells = {
        "runs that reach the goal": _reached,
        "median time [steps]": _median(m.TIME),
        "collisions a robot": _median(m.COLLISIONS),
        "deepest overlap [mm]": lambda runs: _optional(runs, "overlap", lambda found: number(max(found), 2)),
        "ms a control step": lambda runs: _optional(
            runs, "ms_per_step", lambda found: number(float(np.median(found)), 2)
        ),
    }
    return _grouped(by(rows, "type", "rate"), ["type", "physics steps a second"], cells)


def _grasp(rows: Rows) -> str:
    names = {"grasp": "grasp", "release": "release", "no_contact": "lift without contact"}
    groups = sorted(by(select(rows, faulty=False), "experiment", "relative_humidity").items())
    ordered = {(label, f"{rh:g} %"): runs for name, label in names.items() for (own, rh), runs in groups if own == name}

    def spread(found: list[float]) -> str:
        return f"{min(found):.1f} to {max(found):.1f} V"

    cells = {
        "trials in which it happened": lambda runs: f"{len(values(runs, m.VOLTAGE))} of {len(runs)}",
        "mean voltage": lambda runs: _optional(runs, "voltage", lambda found: span(interval(found), "V")),
        "range": lambda runs: _optional(runs, "voltage", spread),
    }
    return _grouped(ordered, ["", "relative humidity"], cells)


def evolution(searches: Mapping[str, tuple[Rows, Mapping[str, Any]]]) -> str:
    """What the searches by each method found: medians over their replicates."""
    lines = []
    for method, found in samples_of(searches).items():
        rows = searches[method][0]
        samples = [np.array([getattr(one, name) for one in found]) for name in ("final", "best_runs")]
        told = [short(interval(s, np.median), 4) if len(s) > 1 else f"{s[0]:.0f}" for s in samples]
        clean = sum(len(one.good) for one in found)
        lines.append([method, len(found), len(rows), clean, *told, f"{max(row['fitness'] for row in rows):.0f}"])
    head = ["method", "replicates", "runs", "deliver all", f"mean fitness, last {LAST} generations"]
    return table([*head, f"best {BEST} runs", "best run"], lines)


def _infer(rows: Rows) -> str:
    """What combinations reproduce, and the support of each reading by those that miss the fewest statements."""
    every = infer.combinations_of(rows)
    sample = [one for one in every if one.reading is None]
    kept, runs = accepted(sample), select(rows, study="types")
    counted = [_reproduced(f"all {len(sample)}", sample, select(runs, reading=None))]
    for one in every:
        if one.is_named:
            mine = [row for row in select(runs, reading=one.reading) if not any(row[name] for name in infer.FACTORS)]
            counted.append(_reproduced(f"reading `{one.reading}`", [one], mine))
    by_factor = chances(sample, kept, {name: list(levels) for name, levels in infer.FACTORS.items()})
    lines = []
    for name, shares in infer.supported(sample).items():
        told = [f"{label}: {100 * s[0]:.0f} ({100 * s[1]:.0f} to {100 * s[2]:.0f}) %" for label, s in shares.items()]
        p = [number(value, 2) for value in by_factor[name]]
        said = "; ".join(f"{label}: {n}" for label, n in counts_alone(every, name, infer.DEFAULTS[name]).items())
        more = more_alone(every, name, infer.DEFAULTS[name])
        by_run = "; ".join(f"{label}: {short(change)}" for label, change in more.items())
        prior = f"{100 / len(infer.FACTORS[name]):.0f} %"
        lines.append([name.replace("_", " "), prior, "; ".join(told), *p, said, by_run])
    first = [
        "combinations",
        f"statements reproduced, of {len(sample[0].answers)}",
        "mean by single runs (95 % interval)",
        *(f"runs of {name} that deliver all: median time [steps]" for name in m.PAPER_TIME),
    ]
    last = [
        "reading",
        "share without support",
        f"share of the {len(kept)} accepted of {len(sample)} (95 % interval)",
        "p",
        "p by Holm",
        "statements that `paper` reproduces with this value, the default first",
        "more than with the default by single runs (95 % interval)",
    ]
    return table(first, counted) + "\n\n" + table(last, lines)


def _reproduced(label: str, group: Sequence[Combination], runs: Rows) -> list[object]:
    """How many statements combinations reproduce, and how long both types take with them."""
    counts = [sum(one.answers) for one in group]
    most = max(counts)
    told: list[object] = [f"{np.median(counts):g}; at most {most}, by {counts.count(most)}" if len(group) > 1 else most]
    told.append(short(interval([count for one in group for count in one.single])))
    for name in m.PAPER_TIME:
        mine = select(runs, setting=name)
        told.append(_reached(mine) + _optional(mine, "finished_at", lambda t: f": {number(float(np.median(t)))}"))
    return [label, *told]


TABLES: dict[str, Callable[[Rows], str]] = {
    "hop-count": _hop_count,
    "density": _density,
    "types": _types,
    "robustness": _robustness,
    "sensitivity": _sensitivity,
    "time-step": _time_step,
    "resolved-grasps": _resolved_grasps,
    "message-time": _message_time,
    "infer": _infer,
    "grasp": _grasp,
}
"""Tables of the rows of an experiment, or of the trials."""


def engines(found: Mapping[str, Mapping[str, Rows]]) -> str:
    """Table of the finishing times in two directories, and whether they are equal, group by group and together.

    Swarms without hop counts are left out, since none of their runs need end before the limit, and those that only one
    directory has.

    Args:
        found: rows by directory and part, hop-count and density.
    """
    (one, first), (other, second) = ((place, _times(parts)) for place, parts in found.items())
    both = [name for name in first if name in second]

    def judged(names: Sequence[str]) -> list[str]:
        pairs = [first[name] for name in names], [second[name] for name in names]
        sizes = tuple(len(values) for group in pairs for values in group)
        estimate = Estimate(ratio(*pairs), sizes, 1 - EQUAL, 1 + EQUAL)
        return [short(estimate.value), estimate.verdict]

    lines = [[name, *(number(float(np.median(g[name]))) for g in (first, second)), *judged([name])] for name in both]
    lines.append(["all", "", "", *judged(both)])
    head = ["swarm", f"`{one}`: median time [steps]", f"`{other}`", "ratio of the times (95 % interval)"]
    return table([*head, f"equal within {100 * EQUAL:.0f} %"], lines)


def _times(parts: Mapping[str, Rows]) -> dict[str, Array]:
    """Times by the names of swarms."""
    groups = {"Fig. 15, with hop counts": select(parts["hop-count"], use_hop_count=True)}
    groups |= {f"Fig. 17, density {d:g}": runs for d, runs in sorted(by(parts["density"], "density").items())}
    return {name: values(rows, m.TIME) for name, rows in groups.items()}
