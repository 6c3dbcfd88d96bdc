"""The statements of section 4.6 of the paper on swarms (Figs. 15 to 17, Table 2), and on swarms
beyond the paper: other choices, failed robots, messages, grasps, time steps; each with its test.

Most rules were fixed before the runs that they judge; margins that were widened when first results
had been seen are named in docs/comparison.md.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from iswarm_mj.config.swarm import DriveConfig
from iswarm_mj.paper.analysis import findings as f
from iswarm_mj.paper.analysis import measures as m
from iswarm_mj.paper.analysis.findings import Judged, Statement, Test, added
from iswarm_mj.paper.analysis.judge import (
    EQUAL,
    LEAST,
    RARE,
    Estimate,
    averages,
    differences,
    judged,
    optimum,
    reaching,
    shares,
)
from iswarm_mj.paper.analysis.measures import Measure, finished, values
from iswarm_mj.paper.analysis.statistics import (
    Interval,
    Statistic,
    compare,
    difference,
    holm,
    interval,
)
from iswarm_mj.search.rows import Rows, by, select
from iswarm_mj.utils.errors import ConfigError

NEARLY = 0.05
"""Fitness within this share of the paper's is the same: 39 steps of the finishing time."""
NEAR = 3.5
"""A robot is at a dust area if it is in it or within this distance of it, the sensory radius
[rd]."""
INSTANT, TIMED = (
    "no time",
    ("30000 bit/s", "2000 bit/s", "1000 bit/s", "30000 bit/s, all photodiodes on"),
)
"""How long messages take in the study of message times."""
DEFAULT, BALANCED = "default", ("gripper.relative_humidity", "gripper.grasp_voltage")
"""Choices by which the balance of forces alone decides."""
SWARMS, HUMIDITIES, VOLTAGES = ("type1", "type2"), (10.0, 30.0, 50.0), (30.0, 40.0, 55.0)
"""Of the study of grasps: swarms, relative humidities [%], and voltages of the tool while it lifts
[V]; balls are released at the configuration's voltage."""
BALANCE, TRIALS = "quasi-static", "dynamic"
SUBSTEPS = {2: (1, 1), 5: (2, 3), 10: (4, 6), 20: (8, 12), 50: (20, 30), 100: (40, 60)}
"""Physics steps of the turn and of the walk, by their number in a control step of 1 s; the drive
refuses some."""
NEGLIGIBLE = 0.1
"""Overlap that does not matter: a twentieth of a robot [mm]."""


def _compared(
    measure: Measure,
    column: str,
    first: object,
    second: object,
    better: bool = False,
    margin: Callable | None = None,
    statistic: Statistic = np.median,
    at: Mapping[str, object] = MappingProxyType({}),
) -> Test:
    """A test that runs with the first value of a column, `at` values of others, have more of a
    measure than those with the second; that they are `better`; or, with a margin, that they are
    equal."""

    def test(rows: Rows) -> Judged | None:
        one, other = (select(rows, **at, **{column: value}) for value in (first, second))
        return differences(
            {"": (one, other)}, measure, not better or measure.is_better_larger, margin, statistic
        )

    return test


def _hop_counts(measure: Measure, at: Mapping[str, object] = MappingProxyType({})) -> Test:
    return _compared(measure, "use_hop_count", True, False, better=True, at=at)


def _slowed(setting: str) -> Test:
    return _compared(m.TIME, "setting", setting, INSTANT, at={"use_hop_count": True})


def _densities(rows: Rows, low: float, high: float) -> dict[str, Rows]:
    return {f"{d:g}": runs for d, runs in sorted(by(rows, "density").items()) if low <= d <= high}


def _lowest(measure: Measure, rows: Rows) -> Judged | None:
    return optimum(by(rows, "density"), measure, m.BEST)


def _later(rows: Rows) -> Judged | None:
    best = [row for row in rows if m.BEST[0] <= row["density"] <= m.BEST[1]]
    return differences(
        {density: (runs, best) for density, runs in _densities(rows, *m.DENSE).items()}
    )


def _types(rows: Rows) -> dict[str, Rows]:
    """Runs of both of the paper's types; none if one is not there, as nothing follows from the
    other."""
    types: dict[str, Rows] = {name: select(rows, type=name) for name in SWARMS}
    return types if all(types.values()) else {}


def _as_the_papers(
    measure: Measure, paper: Mapping[str, float], margin: float, statistic: Statistic
) -> Test:
    limits = {name: ((1 - margin) * value, (1 + margin) * value) for name, value in paper.items()}
    return lambda rows: averages(
        {name: values(runs, measure) for name, runs in _types(rows).items()},
        limits,
        measure.unit,
        statistic,
    )


def _early(rows: Rows) -> Judged | None:
    early = {
        k: [(row["finished_at"] or m.STEPS) < m.SHORTEST for row in runs]
        for k, runs in _types(rows).items()
    }
    return shares({name: (sum(each), len(each)) for name, each in early.items()}, (-math.inf, RARE))


class Change(NamedTuple):
    """What another value of a choice, a setting of a group, does to the time to the goal."""

    group: str
    choice: str
    value: str
    reached: str
    """How many of how many runs reached the goal."""
    effect: Interval
    """Difference of the mean time from the default's."""
    p: float
    """Of the Mann-Whitney test; `adjusted` by Holm for the number of choices."""
    adjusted: float


def changes(rows: Rows) -> list[Change]:
    """What each choice does; runs that did not reach the goal count as the time limit."""
    usual = values(select(rows, choice=DEFAULT), m.TIME)
    groups = by([row for row in rows if row["choice"] != DEFAULT], "group", "choice", "value")
    times = [values(runs, m.TIME) for runs in groups.values()]
    p = [compare(found, usual).p for found in times]
    return [
        Change(
            key[0],
            key[1],
            key[2],
            f"{finished(runs)}/{len(runs)}",
            difference(found, usual, np.mean),
            raw,
            adjusted,
        )
        for (key, runs), found, raw, adjusted in zip(groups.items(), times, p, holm(p), strict=True)
    ]


def _changes(rows: Rows) -> Judged | None:
    """The choices that change the time, by the raw p-values and by the adjusted ones; a list
    without a verdict."""
    usual = select(rows, choice=DEFAULT)
    if not usual or len(usual) == len(rows):
        return None
    found = changes(rows)
    raw = [c for c in found if c.p < f.ALPHA]
    named = ", ".join(f"{c.choice.split('.')[1]} = {c.value}" for c in raw)
    clear = sum(c.adjusted < f.ALPHA for c in raw)
    ours = f"{len(raw)} of {len(found)} at p < {f.ALPHA:g}, {clear} of them after Holm's correction: {named}"
    return Judged(ours, f"Mann-Whitney, n = {len(usual)} each")


def _chosen(is_balanced: bool, rows: Rows) -> Judged | None:
    meant = [
        row
        for row in rows
        if row["choice"] != DEFAULT and (row["choice"] in BALANCED) == is_balanced
    ]
    groups = by(meant, "choice", "value").items()
    return reaching({f"{choice.split('.')[1]} = {value}": runs for (choice, value), runs in groups})


def _robust(rows: Rows) -> Judged | None:
    dead = sorted(by(select(rows, kind="dead"), "fraction").items())
    return reaching({f"{100 * part:.0f} %": runs for part, runs in dead}) if len(dead) > 1 else None


def _cost(rows: Rows) -> Judged | None:
    dead, absent = (by(select(rows, kind=kind), "fraction") for kind in ("dead", "absent"))
    return differences(
        {f"{100 * k:.0f} %": (dead[k], absent[k]) for k in sorted(dead.keys() & absent.keys())}
    )


def _same_by_trials(name: str, measure: Measure, voltage: float, rows: Rows) -> Judged | None:
    """At each humidity the ratio of pairs is one; a run that does not reach the goal takes its time
    limit."""
    found = []
    for humidity in HUMIDITIES:
        mine = select(rows, type=name, grasp_voltage=voltage, relative_humidity=humidity)
        pairs = [
            {row["seed"]: row for row in select(mine, resolution=kind)}
            for kind in (BALANCE, TRIALS)
        ]
        seeds = sorted(pairs[0].keys() & pairs[1].keys())
        both = np.array([values([each[seed] for seed in seeds], measure) for each in pairs])
        static, dynamic = both[:, (both > 0).all(axis=0)]
        if len(static):
            value, n = Interval(*np.exp(interval(np.log(dynamic / static)))), len(static)
            least = LEAST if measure is not m.TIME or finished(mine) >= LEAST else n + 1
            found.append(
                Estimate(value, (n,), 1 - EQUAL, 1 + EQUAL, f"{humidity:g} % RH", least=least)
            )
    result = judged(found, "geometric means of pairs of the same seed")
    return result._replace(verdict=f.TOO_FEW) if result and len(found) < len(HUMIDITIES) else result


def _on_grasps(name: str) -> list[Statement]:
    """Statements on the grasps of one swarm; at the lowest voltage and in the dampest air unless
    these vary."""
    same = "At {:g} V trials instead of the balance of the forces leave the {} as it is, {}"
    tests: dict[str, Test] = {
        same.format(voltage, what, name): partial(_same_by_trials, name, measure, voltage)
        for measure, what in (
            (m.TIME, "finishing time"),
            (m.ATTEMPTS, "number of attempts per ball"),
        )
        for voltage in VOLTAGES
    }
    mine: dict[str, object] = {"type": name, "resolution": TRIALS}
    more = _compared(m.FAILED, "relative_humidity", 50.0, 10.0, at=mine | {"grasp_voltage": 30.0})
    later = _compared(m.TIME, "grasp_voltage", 30.0, 55.0, at=mine | {"relative_humidity": 50.0})
    tests[f"At 30 V more grasps fail at 50 % RH than at 10 %, {name}"] = more
    tests[f"At 50 % RH a swarm with 30 V takes longer than one with 55 V, {name}"] = later
    return [added("resolved-grasps", claim, test) for claim, test in tests.items()]


def drive_of(drive: DriveConfig, rate: int) -> DriveConfig:
    """Drive with so many physics steps in a control step; a ConfigError if it refuses them."""
    return replace(drive, turn_substeps=SUBSTEPS[rate][0], walk_substeps=SUBSTEPS[rate][1])


def refusals(drive: DriveConfig) -> dict[int, str]:
    """What a drive says to the numbers of physics steps that it refuses."""
    said = {}
    for rate in SUBSTEPS:
        try:
            drive_of(drive, rate)
        except ConfigError as error:
            said[rate] = str(error)
    return said


def _refused(rows: Rows) -> Judged:
    refused = [
        f"{rate}: {text}"
        for rate, text in refusals(DriveConfig()).items()
        if not select(rows, rate=rate)
    ]
    return Judged("; ".join(refused) or "none", "")


def _same_by_rate(measure: Measure, rows: Rows) -> Judged | None:
    pairs = {}
    for swarm in SWARMS:
        groups = sorted(by(select(rows, type=swarm), "rate").items())
        *coarser, (_, finest) = [item for item in groups if len(values(item[1], measure))] or [
            (0, [])
        ]
        pairs |= {f"{swarm} at {rate}": (runs, finest) for rate, runs in coarser}
    return differences(pairs, measure, margin=lambda a, b: EQUAL * float(np.median(b)))


def _observed(rows: Rows, measure: Measure, statistic: Callable) -> str:
    """Statistic of a measure of the observed runs, by type and number of physics steps."""
    parts = []
    for swarm, mine in by([row for row in rows if measure.value(row) is not None], "type").items():
        found = {
            rate: statistic(values(runs, measure))
            for rate, runs in sorted(by(mine, "rate").items())
        }
        parts.append(
            f"{swarm}, "
            + ", ".join(f"{rate}: {f.number(float(value))}" for rate, value in found.items())
        )
    return f"{'; '.join(parts)} {measure.unit}"


def _overlap(rows: Rows) -> Judged | None:
    finest = values(select(rows, rate=100), m.OVERLAP)
    if not len(finest):
        return None
    verdict = (
        f.TOO_FEW if len(finest) < LEAST else f.HOLDS if finest.max() <= NEGLIGIBLE else f.FAILS
    )
    rule = f"largest of the runs of a type; holds if at most {NEGLIGIBLE:g} mm"
    return Judged(_observed(rows, m.OVERLAP, max), rule, verdict)


_NAMED = dict(zip(("time", "dust", "collisions", "carriage"), m.MEASURES, strict=True))
TESTS: Mapping[str, Test] = {
    **{f"hop {name}": _hop_counts(measure) for name, measure in _NAMED.items()},
    **{
        f"best {name}": partial(_lowest, _NAMED[name])
        for name in ("time", "collisions", "carriage")
    },
    "dense slower": _later,
    "cleans": lambda rows: reaching(_densities(rows, *m.CLEAN)),
    "sparse": lambda rows: reaching(_densities(rows, m.SPARSEST, m.SPARSEST), does=False),
    "dense": lambda rows: reaching(_densities(rows, *m.DENSE), does=False),
    "types clean": lambda rows: reaching(_types(rows)),
    "types time": _as_the_papers(m.TIME, m.PAPER_TIME, EQUAL, np.median),
    "same time": _compared(
        m.TIME, "type", *SWARMS, margin=lambda a, b: EQUAL * float(np.median(a) + np.median(b)) / 2
    ),
    "early": _early,
    "types fitness": _as_the_papers(m.FITNESS, m.PAPER_FITNESS, NEARLY, np.mean),
    "equally fit": _compared(
        *(m.FITNESS, "type", *SWARMS),
        margin=lambda a, b: NEARLY * m.PAPER_FITNESS["type1"],
        statistic=np.mean,
    ),
    "gathering": _compared(m.AGGREGATION, "type", "type2", "type1"),
    # Fitted: an evolution selected it by this fitness, in this simulator, if not with these seeds.
    "evolved type1": _compared(m.FITNESS, "type", "evolved", "type1"),
    "evolved type2": _compared(m.FITNESS, "type", "evolved", "type2"),
    "choices reach": partial(_chosen, False),
    # Whether 55 V release a ball, and a voltage lifts one, is arithmetic with the fitted works of
    # adhesion.
    "grips reach": partial(_chosen, True),
    "choices change": _changes,
    # The paper calls its swarm robust without a run in which robots fail.
    "robust": _robust,
    "cost": _cost,
    "same time to goal": partial(_same_by_rate, m.TIME),
    # Of dust by construction: runs stop at the goal.
    **{
        f"same {name}": partial(_same_by_rate, measure)
        for name, measure in _NAMED.items()
        if name != "time"
    },
    "overlap": _overlap,  # fitted: how fine a step must be was found in such runs
    "step time": lambda rows: Judged(_observed(rows, m.STEP_TIME, np.median), ""),
    "refused": _refused,
}
_STATED = f.stated(TESTS)
STATEMENTS = [
    *_STATED,
    *(
        added(
            "message-time",
            f"Messages at {setting} slow a swarm with hop counts down",
            _slowed(setting),
        )
        for setting in TIMED
    ),
    *(
        added(
            "message-time",
            f"{one.claim}, with messages at {setting}",
            _hop_counts(measure, {"setting": setting}),
        )
        for setting in TIMED
        for one, measure in zip(_STATED, m.MEASURES, strict=False)
    ),
    *(statement for name in SWARMS for statement in _on_grasps(name)),
]
