"""The statements on swarms beyond the paper: other choices, failed robots, messages, grasps, time steps."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np

from iswarm_mj.config import DriveConfig
from iswarm_mj.experiments.analysis.findings import (
    ALPHA,
    FAILS,
    HOLDS,
    TOO_FEW,
    Judged,
    Rows,
    Statement,
    Test,
    added,
    number,
    stated,
)
from iswarm_mj.experiments.analysis.judge import EQUAL, LEAST, Estimate, differences, judged, reaching
from iswarm_mj.experiments.analysis.measures import (
    ATTEMPTS,
    CARRIAGE,
    COLLISIONS,
    DUST,
    FAILED,
    TIME,
    Measure,
    by,
    finished,
    select,
    values,
)
from iswarm_mj.experiments.analysis.statements import STATEMENTS as SWARM_STATEMENTS
from iswarm_mj.experiments.analysis.statements import hop_counts
from iswarm_mj.experiments.analysis.statistics import Interval, compare, difference, holm, interval
from iswarm_mj.utils.errors import ConfigError

INSTANT = "no time"
TIMED = ("30000 bit/s", "2000 bit/s", "1000 bit/s", "30000 bit/s, all photodiodes on")
"""How long messages take in the study of message times."""


def _hop_counts_at(setting: str, measure: Measure, rows: Rows) -> Judged | None:
    return hop_counts(measure, select(rows, setting=setting))


def _slowed(setting: str, rows: Rows) -> Judged | None:
    """Swarms with hop counts take longer than where messages take no time."""
    counted = select(rows, use_hop_count=True)
    return differences({"": (select(counted, setting=setting), select(counted, setting=INSTANT))})


def _robust(rows: Rows) -> Judged | None:
    dead = sorted(by(select(rows, kind="dead"), "fraction").items())
    return reaching({f"{100 * f:.0f} %": runs for f, runs in dead}) if len(dead) > 1 else None


def _cost(rows: Rows) -> Judged | None:
    dead, absent = (by(select(rows, kind=kind), "fraction") for kind in ("dead", "absent"))
    return differences({f"{100 * f:.0f} %": (dead[f], absent[f]) for f in sorted(dead.keys() & absent.keys())})


DEFAULT = "default"
BALANCED = ("gripper.relative_humidity", "gripper.grasp_voltage")
"""Choices by which the balance of forces alone decides."""


def _chosen(is_balanced: bool, rows: Rows) -> Judged | None:
    meant = [row for row in rows if row["choice"] != DEFAULT and (row["choice"] in BALANCED) == is_balanced]
    groups = by(meant, "choice", "value").items()
    return reaching({f"{choice.split('.')[1]} = {value}": runs for (choice, value), runs in groups})


class Change(NamedTuple):
    """What another value of a choice does to the time to the goal."""

    group: str
    choice: str
    """Name of the setting."""
    value: str
    reached: str
    """How many of how many runs reached the goal."""
    effect: Interval
    """Difference of the mean time from the default's."""
    p: float
    """Of the Mann-Whitney test."""
    adjusted: float
    """The same by Holm for the number of choices."""


def changes(rows: Rows) -> list[Change]:
    """What each choice does; runs that did not reach the goal count as the time limit."""
    usual = values(select(rows, choice=DEFAULT), TIME)
    groups = by([row for row in rows if row["choice"] != DEFAULT], "group", "choice", "value")
    times = {key: values(runs, TIME) for key, runs in groups.items()}
    p = [compare(found, usual).p for found in times.values()]
    return [
        Change(
            group,
            choice,
            value,
            f"{finished(groups[group, choice, value])}/{len(found)}",
            difference(found, usual, np.mean),
            raw,
            adjusted,
        )
        for ((group, choice, value), found), raw, adjusted in zip(times.items(), p, holm(p), strict=True)
    ]


def _changes(rows: Rows) -> Judged | None:
    """The choices that change the time, by the raw p-values and by the adjusted ones; a list without a verdict."""
    usual = select(rows, choice=DEFAULT)
    if not usual or len(usual) == len(rows):
        return None
    found = changes(rows)
    raw = [c for c in found if c.p < ALPHA]
    clear = sum(c.adjusted < ALPHA for c in raw)
    named = ", ".join(f"{c.choice.split('.')[1]} = {c.value}" for c in raw)
    ours = f"{len(raw)} of {len(found)} at p < {ALPHA:g}, {clear} of them after Holm's correction: {named}"
    return Judged(ours, f"Mann-Whitney, n = {len(usual)} each")


SWARMS, HUMIDITIES, VOLTAGES = ("type1", "type2"), (10.0, 30.0, 50.0), (30.0, 40.0, 55.0)
"""Of the study of grasps: swarms, relative humidities [%], and voltages of the tool while it lifts [V]; balls are
released at the configuration's voltage."""
BALANCE, TRIALS = "quasi-static", "dynamic"


def paired(rows: Rows, measure: Measure) -> np.ndarray:
    """Values of a measure (2, R) by the balance and by trials, of runs with the same seed."""
    found = [{row["seed"]: row for row in select(rows, resolution=kind)} for kind in (BALANCE, TRIALS)]
    both = sorted(found[0].keys() & found[1].keys())
    return np.array([values([mine[seed] for seed in both], measure) for mine in found])


def _same_by_trials(name: str, measure: Measure, voltage: float, rows: Rows) -> Judged | None:
    """At each humidity the ratio of pairs is one; a run that does not reach the goal takes its time limit."""
    found = []
    for humidity in HUMIDITIES:
        mine = select(rows, type=name, grasp_voltage=voltage, relative_humidity=humidity)
        both = paired(mine, measure)
        static, dynamic = both[:, (both > 0).all(axis=0)]
        if len(static):
            value, n = Interval(*np.exp(interval(np.log(dynamic / static)))), len(static)
            least = LEAST if measure is not TIME or finished(mine) >= LEAST else n + 1
            found.append(Estimate(value, (n,), 1 - EQUAL, 1 + EQUAL, f"{humidity:g} % RH", least=least))
    result = judged(found, "geometric means of pairs of the same seed")
    return result._replace(verdict=TOO_FEW) if result and len(found) < len(HUMIDITIES) else result


def _larger_by_trials(name: str, measure: Measure, column: str, more: float, less: float, rows: Rows) -> Judged | None:
    """Of a swarm at the lowest voltage and in the dampest air, with another value of one of these."""
    at = {"relative_humidity": HUMIDITIES[-1], "grasp_voltage": VOLTAGES[0]}
    groups = [select(rows, type=name, resolution=TRIALS, **at | {column: value}) for value in (more, less)]
    return differences({"": (groups[0], groups[1])}, measure)


SUBSTEPS = {2: (1, 1), 5: (2, 3), 10: (4, 6), 20: (8, 12), 50: (20, 30), 100: (40, 60)}
"""Physics steps of the turn and of the walk, by their number in a control step of 1 s; the drive refuses some."""
NEGLIGIBLE = 0.1
"""Overlap that does not matter: a twentieth of a robot [mm]."""


def drive_of(drive: DriveConfig, rate: int) -> DriveConfig:
    """Drive with so many physics steps in a control step.

    Raises:
        ConfigError: the drive refuses them.
    """
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


def _refused(rows: Rows) -> str:
    refused = {rate: text for rate, text in refusals(DriveConfig()).items() if not select(rows, rate=rate)}
    return "; ".join(f"{rate}: {text}" for rate, text in refused.items()) or "none"


def _same_by_rate(measure: Measure, rows: Rows) -> Judged | None:
    pairs = {}
    for swarm in SWARMS:
        groups = sorted(by(select(rows, type=swarm), "rate").items())
        *coarser, (_, finest) = [item for item in groups if len(values(item[1], measure))] or [(0, [])]
        pairs |= {f"{swarm} at {rate}": (runs, finest) for rate, runs in coarser}
    return differences(pairs, measure, margin=lambda a, b: EQUAL * float(np.median(b)))


def _observed(rows: Rows, column: str, statistic: Callable, unit: str) -> str:
    """Statistic of a column of the observed runs, by type and number of physics steps."""
    seen = [row for row in rows if row[column] is not None]
    parts = []
    for swarm, mine in by(seen, "type").items():
        found = {rate: statistic([row[column] for row in runs]) for rate, runs in sorted(by(mine, "rate").items())}
        parts.append(f"{swarm}, " + ", ".join(f"{rate}: {number(float(value))}" for rate, value in found.items()))
    return f"{'; '.join(parts)} {unit}"


def _overlap(rows: Rows) -> Judged | None:
    finest = [row["overlap"] for row in select(rows, rate=100) if row["overlap"] is not None]
    if not finest:
        return None
    verdict = TOO_FEW if len(finest) < LEAST else HOLDS if max(finest) <= NEGLIGIBLE else FAILS
    rule = f"largest of the runs of a type; holds if at most {NEGLIGIBLE:g} mm"
    return Judged(_observed(rows, "overlap", max, "mm"), rule, verdict)


TESTS: Mapping[str, Test] = {
    "choices reach": partial(_chosen, False),
    # Whether 55 V release a ball, and a voltage lifts one, is arithmetic with the fitted works of adhesion.
    "grips reach": partial(_chosen, True),
    "choices change": _changes,
    # The paper calls its swarm robust without a run in which robots fail.
    "robust": _robust,
    "cost": _cost,
    "same time to goal": partial(_same_by_rate, TIME),
    "same dust": partial(_same_by_rate, DUST),  # by construction: runs stop at the goal
    "same collisions": partial(_same_by_rate, COLLISIONS),
    "same carriage": partial(_same_by_rate, CARRIAGE),
    "overlap": _overlap,  # fitted: how fine a step must be was found in such runs
    "step time": lambda rows: Judged(_observed(rows, "ms_per_step", np.median, "ms"), ""),
    "refused": lambda rows: Judged(_refused(rows), ""),
}
_HOP_COUNT = {measure: one for measure, one in zip((TIME, DUST, COLLISIONS, CARRIAGE), SWARM_STATEMENTS, strict=False)}


def _on_grasps(name: str) -> list[Statement]:
    """Statements on the grasps of one swarm."""
    same = "At {:g} V trials instead of the balance of the forces leave the {} as it is, {}"
    fail = f"At 30 V more grasps fail at 50 % RH than at 10 %, {name}"
    slow = f"At 50 % RH a swarm with 30 V takes longer than one with 55 V, {name}"
    tests = {
        same.format(voltage, what, name): partial(_same_by_trials, name, measure, voltage)
        for measure, what in ((TIME, "finishing time"), (ATTEMPTS, "number of attempts per ball"))
        for voltage in VOLTAGES
    }
    tests[fail] = partial(_larger_by_trials, name, FAILED, "relative_humidity", 50.0, 10.0)
    tests[slow] = partial(_larger_by_trials, name, TIME, "grasp_voltage", 30.0, 55.0)
    return [added("resolved-grasps", claim, test) for claim, test in tests.items()]


STATEMENTS = [
    *stated(TESTS),
    *(
        added("message-time", f"Messages at {setting} slow a swarm with hop counts down", partial(_slowed, setting))
        for setting in TIMED
    ),
    *(
        added("message-time", f"{one.claim}, with messages at {setting}", partial(_hop_counts_at, setting, measure))
        for setting in TIMED
        for measure, one in _HOP_COUNT.items()
    ),
    *(statement for name in SWARMS for statement in _on_grasps(name)),
]
