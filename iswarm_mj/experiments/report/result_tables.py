"""Markdown tables of the numbers in results: medians, means and intervals of each group of runs."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from iswarm_mj.experiments.analysis.evolution_sample import BEST, LAST, evolutions
from iswarm_mj.experiments.analysis.findings import ALPHA, Rows, number, span
from iswarm_mj.experiments.analysis.measures import (
    CARRIAGE,
    COLLISIONS,
    DUST,
    MEASURES,
    TIME,
    finished,
    select,
    values,
)
from iswarm_mj.experiments.analysis.paper import PAPER_FITNESS, PAPER_TIME
from iswarm_mj.experiments.analysis.statistics import Interval, difference, interval, median
from iswarm_mj.experiments.analysis.support import Combination, accepted, chances, counts_alone, more_alone, support
from iswarm_mj.experiments.report.markdown import markdown
from iswarm_mj.experiments.studies import infer, resolved_grasps, robustness, sensitivity
from iswarm_mj.utils.arrays import Array


def _short(value: Interval, digits: int = 3) -> str:
    return f"{number(value.estimate, digits)} ({number(value.low, digits)} to {number(value.high, digits)})"


def _middle(found: Float[Array, "R"]) -> str:
    """Median and, in brackets, third quartile, which are what the paper's figures show."""
    if not len(found):
        return ""
    middle, third = np.quantile(found, [0.5, 0.75])
    return f"{number(middle)} ({number(third)})"


def _hop_count(rows: Rows) -> str:
    with_them, without = (select(rows, use_hop_count=flag) for flag in (True, False))
    lines = []
    for measure in MEASURES:
        groups = [values(group, measure) for group in (with_them, without)]
        apart = _short(difference(*groups)) if all(map(len, groups)) else ""
        lines.append([measure.label, *map(_middle, groups), apart])
    head = ["medians (third quartiles)", f"with hop counts, {len(with_them)} runs", f"without, {len(without)}"]
    return markdown([*head, "difference (95 % interval)"], lines)


def _density(rows: Rows) -> str:
    lines = []
    for density in sorted({row["density"] for row in rows}):
        runs = select(rows, density=density)
        measured = [_middle(values(runs, measure)) for measure in (TIME, DUST, COLLISIONS, CARRIAGE)]
        lines.append([f"{density:g}", runs[0]["n_robots"], f"{finished(runs)} of {len(runs)}", *measured])
    head = ["density", "robots", f"runs that deliver {rows[0]['goal']}", "median (third quartile) of the time [steps]"]
    return markdown([*head, "balls", "collisions a robot", "carriage [steps]"], lines)


def _types(rows: Rows) -> str:
    lines = []
    for name in dict.fromkeys(row["type"] for row in rows):
        runs = select(rows, type=name)
        near = [row["aggregation"] for row in runs if row["aggregation"] is not None]
        lines.append(
            [
                name,
                runs[0]["n_robots"],
                f"{finished(runs)} of {len(runs)}",
                _short(interval(values(runs, TIME), median)),
                PAPER_TIME.get(name, ""),
                _short(interval([row["fitness"] for row in runs]), 4),
                PAPER_FITNESS.get(name, ""),
                f"{100 * np.median(near):.0f} %" if near else "",
            ]
        )
    head = ["type", "robots", "runs that deliver all", "median time [steps]", "the paper", "mean fitness", "the paper"]
    return markdown([*head, "empty workers at dust areas"], lines)


def _robustness(rows: Rows) -> str:
    lines = []
    for fraction in sorted({row["fraction"] for row in rows}):
        dead, absent = (select(rows, kind=kind, fraction=fraction) for kind in (robustness.DEAD, robustness.ABSENT))
        times = [values(group, TIME) for group in (dead, absent)]
        apart = _short(difference(*times)) if len(absent) else ""
        middle = [number(float(np.median(sample))) if len(sample) else "" for sample in times]
        lines.append([f"{100 * fraction:.0f} %", f"{finished(dead)} of {len(dead)}", *middle, apart])
    head = ["robots that fail", "runs that reach the goal", "median time, dead [steps]", "absent"]
    return markdown([*head, "difference (95 % interval)"], lines)


def _sensitivity(rows: Rows) -> str:
    found = sorted((c for c in sensitivity.changes(rows) if c.p < ALPHA), key=lambda c: c.p)
    lines = [
        [
            f"`{c.choice}`",
            c.effect.label.partition(" = ")[2],
            c.effect.note,
            _short(c.effect.value),
            *(number(p, 2) for p in (c.p, c.adjusted)),
        ]
        for c in found
    ]
    head = ["choice", "value", "runs that reach the goal", "change of the mean time [steps]", "p", "p by Holm"]
    return markdown(head, lines)


def _message_time(rows: Rows) -> str:
    lines = []
    for name in dict.fromkeys(row["setting"] for row in rows):
        for flag in (True, False):
            runs = select(rows, setting=name, use_hop_count=flag)
            measured = [_short(interval(values(runs, measure), median)) for measure in (TIME, DUST, COLLISIONS)]
            lines.append([name, "with" if flag else "without", f"{finished(runs)} of {len(runs)}", *measured])
    head = ["messages", "hop counts", f"runs that deliver {rows[0]['goal']}", "median time [steps]", "balls"]
    return markdown([*head, "collisions a robot"], lines)


def _resolved_grasps(rows: Rows) -> str:
    lines = []
    for label in dict.fromkeys((row["type"], row["relative_humidity"], row["grasp_voltage"]) for row in rows):
        name, humidity, voltage = label
        mine = select(rows, type=name, relative_humidity=humidity, grasp_voltage=voltage)
        for kind, told in ((resolved_grasps.BALANCE, "balance"), (resolved_grasps.TRIALS, "trials")):
            runs = select(mine, resolution=kind)
            shown = [_short(interval(values(runs, TIME), median))]
            shown += [_short(interval(values(runs, m))) for m in resolved_grasps.COUNTS]
            static, dynamic = resolved_grasps.pairs(mine, TIME)
            apart = _short(interval(dynamic - static)) if kind == resolved_grasps.TRIALS and len(static) else ""
            lines.append(
                [name, f"{humidity:g} %", f"{voltage:g} V", told, f"{finished(runs)} of {len(runs)}", *shown, apart]
            )
    head = ["type", "humidity", "voltage", "grasps by", f"runs that deliver {rows[0]['goal']}", "median time [steps]"]
    means = ["attempts a ball", "failed grasps a run", "failed releases", "of both, broken off", "time lost [robot s]"]
    return markdown([*head, *means, "longer than by the balance, mean of pairs [steps]"], lines)


def _time_step(rows: Rows) -> str:
    lines = []
    for name in dict.fromkeys(row["type"] for row in rows):
        for rate in sorted({row["rate"] for row in rows}):
            runs = select(rows, type=name, rate=rate)
            overlaps = [row["overlap"] for row in runs if row["overlap"] is not None]
            costs = [row["ms_per_step"] for row in runs if row["ms_per_step"] is not None]
            measured = [_short(interval(values(runs, measure), median)) for measure in (TIME, COLLISIONS)]
            observed = [number(max(overlaps), 2), number(float(np.median(costs)), 2)] if overlaps else ["", ""]
            lines.append([name, rate, f"{finished(runs)} of {len(runs)}", *measured, *observed])
    head = ["type", "physics steps a second", "runs that reach the goal", "median time [steps]", "collisions a robot"]
    return markdown([*head, "deepest overlap [mm]", "ms a control step"], lines)


def _grasp(rows: Rows) -> str:
    sound = [row for row in rows if not row["faulty"]]
    lines = []
    for experiment, label in (("grasp", "grasp"), ("release", "release"), ("no_contact", "lift without contact")):
        for rh in sorted({row["relative_humidity"] for row in sound}):
            runs = select(sound, experiment=experiment, relative_humidity=rh)
            found = np.array([row["voltage"] for row in runs if row["voltage"] is not None])
            spread = (
                [span(interval(found), "V"), f"{found.min():.1f} to {found.max():.1f} V"] if len(found) else ["", ""]
            )
            lines.append([label, f"{rh:g} %", f"{len(found)} of {len(runs)}", *spread])
    return markdown(["", "relative humidity", "trials in which it happened", "mean voltage", "range"], lines)


def evolution(searches: Mapping[str, tuple[Rows, Mapping[str, Any]]]) -> str:
    """What the searches by each method found: medians over their replicates."""
    lines = []
    for method, (rows, settings) in searches.items():
        n_dust = settings["config"]["arena"]["n_dust"]
        found = evolutions(rows, n_dust)
        samples = [np.array([getattr(one, name) for one in found]) for name in ("final", "best_runs")]
        clean = sum(row["delivered"] == n_dust for row in rows)
        told = [_short(interval(values, median), 4) if len(values) > 1 else f"{values[0]:.0f}" for values in samples]
        lines.append([method, len(found), len(rows), clean, *told, f"{max(row['fitness'] for row in rows):.0f}"])
    head = ["method", "replicates", "runs", "deliver all", f"mean fitness, last {LAST} generations"]
    return markdown([*head, f"best {BEST} runs", "best run"], lines)


def _infer(rows: Rows) -> str:
    """What combinations reproduce, and the support of each reading by those that miss the fewest statements."""
    every = infer.combinations_of(rows)
    sample = [one for one in every if one.reading is None]
    kept = accepted(sample)
    runs = select(rows, study=infer.TYPES)
    counted = [_reproduced(f"all {len(sample)}", sample, select(runs, reading=None))]
    for one in every:
        if one.is_named:
            mine = [row for row in select(runs, reading=one.reading) if not any(row[name] for name in infer.FACTORS)]
            counted.append(_reproduced(f"reading `{one.reading}`", [one], mine))
    by_factor = chances(sample, kept, {name: list(levels) for name, levels in infer.FACTORS.items()})
    lines = []
    for name, levels in infer.FACTORS.items():
        shares = support(sample, kept, name, list(levels))
        told = [
            f"{label}: {100 * s.estimate:.0f} ({100 * s.low:.0f} to {100 * s.high:.0f}) %"
            for label, s in shares.items()
        ]
        p = [number(value, 2) for value in by_factor[name]]
        alone = counts_alone(every, name, infer.DEFAULTS[name])
        said = "; ".join(f"{label}: {n}" for label, n in alone.items())
        more = more_alone(every, name, infer.DEFAULTS[name])
        by_run = "; ".join(f"{label}: {_short(change)}" for label, change in more.items())
        lines.append([name.replace("_", " "), f"{100 / len(levels):.0f} %", "; ".join(told), *p, said, by_run])
    head = ["reading", "share without support", f"share of the {len(kept)} accepted of {len(sample)} (95 % interval)"]
    last = ["p", "p by Holm", "statements that `paper` reproduces with this value, the default first"]
    last.append("more than with the default by single runs (95 % interval)")
    first = [
        "combinations",
        f"statements reproduced, of {len(sample[0].answers)}",
        "mean by single runs (95 % interval)",
    ]
    first += [f"runs of {name} that deliver all: median time [steps]" for name in PAPER_TIME]
    return markdown(first, counted) + "\n\n" + markdown([*head, *last], lines)


def _reproduced(label: str, group: Sequence[Combination], runs: Rows) -> list[object]:
    """How many statements combinations reproduce, and how long both types take with them."""
    counts = [sum(one.answers) for one in group]
    most = max(counts)
    told = [f"{np.median(counts):g}; at most {most}, by {counts.count(most)}" if len(group) > 1 else most]
    told.append(_short(interval([count for one in group for count in one.single])))
    for name in PAPER_TIME:
        mine = select(runs, setting=name)
        times = [row["finished_at"] for row in mine if row["finished_at"] is not None]
        told.append(f"{len(times)} of {len(mine)}" + (f": {number(float(np.median(times)))}" if times else ""))
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
