"""The statements on swarms beyond the paper: other choices, failed robots, messages, grasps, time steps."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from iswarm_mj.config import DriveConfig
from iswarm_mj.experiments.analysis.findings import (
    ALPHA,
    FAILS,
    HOLDS,
    NOT_IN_PAPER,
    PREDICTED,
    TOO_FEW,
    Judged,
    Rows,
    Statement,
    Test,
    number,
    stated,
)
from iswarm_mj.experiments.analysis.judge import (
    EQUAL,
    LEAST,
    Estimate,
    differences,
    judged,
    reaching,
)
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


def _slowed(setting: str) -> Statement:
    def test(rows: Rows) -> Judged | None:
        groups = {name: select(rows, setting=name, use_hop_count=True) for name in (setting, *TIMED, INSTANT)}
        instant = groups.pop(INSTANT)
        p = {
            name: compare(values(runs, TIME), values(instant, TIME)).p
            for name, runs in groups.items()
            if runs and instant
        }
        adjusted = dict(zip(p, holm(list(p.values())), strict=True))
        note = f"p = {number(adjusted.get(setting, 1.0), 2)} by Holm for {len(p)} tests"
        names = (f"with messages at {setting}", "where they take no time")
        return differences({"": (groups[setting], instant)}, TIME, names, note=note)

    claim = f"Messages at {setting} slow a swarm with hop counts down"
    return Statement("message-time", claim, NOT_IN_PAPER, "not studied", PREDICTED, test)


def _robust(rows: Rows) -> Judged | None:
    dead = sorted(by(select(rows, kind="dead"), "fraction").items())
    return reaching({f"{100 * f:.0f} %": runs for f, runs in dead}, tell=TIME) if len(dead) > 1 else None


def _cost(rows: Rows) -> Judged | None:
    groups = by(rows, "fraction", "kind")
    pairs = {
        f"{100 * f:.0f} %": (runs, groups[f, "absent"])
        for (f, kind), runs in sorted(groups.items())
        if kind == "dead" and (f, "absent") in groups
    }
    return differences(pairs)


DEFAULT = "default"
BALANCED = ("gripper.relative_humidity", "gripper.grasp_voltage")
"""Choices by which the balance of forces alone decides."""


def _chosen(is_meant: Callable[[str], bool]) -> Callable[[Rows], Judged | None]:
    def test(rows: Rows) -> Judged | None:
        groups = by([row for row in rows if row["choice"] != DEFAULT and is_meant(row["choice"])], "choice", "value")
        named = {f"{choice.split('.')[1]} = {value}": runs for (choice, value), runs in groups.items()}
        return reaching(named, tell=TIME, brief=True)

    return test


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
    raw = sorted((c for c in found if c.p < ALPHA), key=lambda c: -abs(c.effect.estimate))
    named = [
        f"{c.choice.split('.')[1]} = {c.value}: {c.effect.estimate:+.0f} ({c.effect.low:+.0f} to {c.effect.high:+.0f}) "
        f"steps (p = {number(c.p, 2)}, by Holm {number(c.adjusted, 2)})"
        for c in raw
    ]
    clear = sum(c.adjusted < ALPHA for c in raw)
    ours = f"{len(raw)} at p < {ALPHA:g}, {clear} of them after Holm's correction" + ": " * bool(raw) + "; ".join(named)
    said = (
        f"difference of the mean time from the default's {number(float(values(usual, TIME).mean()))} steps with 95 % "
        f"interval, runs that did not reach the goal counted as {usual[0]['max_steps']}; Mann-Whitney, corrected for "
        f"{len(found)} choices, n = {len(usual)} each; all with {usual[0]['n_robots']} robots"
    )
    return Judged(ours, said)


SWARMS, HUMIDITIES, VOLTAGES = ("type1", "type2"), (10.0, 30.0, 50.0), (30.0, 40.0, 55.0)
"""Of the study of grasps: swarms, relative humidities [%], and voltages of the tool while it lifts [V]; balls are
released at the configuration's voltage."""
BALANCE, TRIALS = "quasi-static", "dynamic"


def paired(rows: Rows, measure: Measure) -> np.ndarray:
    """Values of a measure (2, R) by the balance and by trials, of runs with the same seed."""
    found = [{row["seed"]: row for row in select(rows, resolution=kind)} for kind in (BALANCE, TRIALS)]
    both = sorted(found[0].keys() & found[1].keys())
    return np.array([values([mine[seed] for seed in both], measure) for mine in found])


def _same_by_trials(name: str, measure: Measure, voltage: float) -> Statement:
    what = "finishing time" if measure is TIME else "number of attempts per ball"

    def test(rows: Rows) -> Judged | None:
        found = []
        for humidity in HUMIDITIES:
            mine = select(rows, type=name, grasp_voltage=voltage, relative_humidity=humidity)
            both = paired(mine, measure)
            static, dynamic = both[:, (both > 0).all(axis=0)]
            if not len(static):
                continue
            value = Interval(*np.exp(interval(np.log(dynamic / static))))
            told = measure is not TIME or finished(mine) >= LEAST
            found.append(
                Estimate(
                    value,
                    (len(static),),
                    1 - EQUAL,
                    1 + EQUAL,
                    f"{humidity:g} % RH",
                    least=LEAST if told else len(static) + 1,
                )
            )
        note = "geometric means of pairs of the same seed, a run that does not reach the goal with its time limit"
        result = judged(found, "times that by the balance", note=note)
        return result._replace(verdict=TOO_FEW) if result and len(found) < len(HUMIDITIES) else result

    claim = f"At {voltage:g} V trials instead of the balance of the forces leave the {what} as it is, {name}"
    return Statement("resolved-grasps", claim, NOT_IN_PAPER, "not studied", PREDICTED, test)


def _larger_by_trials(name: str, claim: str, measure: Measure, column: str, more: float, less: float) -> Statement:
    """Of a swarm at the lowest voltage and in the dampest air, with another value of one of these."""

    def test(rows: Rows) -> Judged | None:
        at = {"relative_humidity": HUMIDITIES[-1], "grasp_voltage": VOLTAGES[0]}
        groups = [select(rows, type=name, resolution=TRIALS, **at | {column: value}) for value in (more, less)]
        unit = "V" if column == "grasp_voltage" else "% RH"
        names = (f"at {more:g} {unit}", f"at {less:g} {unit}")
        return differences({"": (groups[0], groups[1])}, measure, names)

    return Statement("resolved-grasps", f"{claim}, {name}", NOT_IN_PAPER, "not studied", PREDICTED, test)


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


def _same_by_rate(measure: Measure) -> Test:
    def test(rows: Rows) -> Judged | None:
        pairs = {}
        for swarm in SWARMS:
            groups = sorted(by(select(rows, type=swarm), "rate").items())
            *coarser, (_, finest) = [item for item in groups if len(values(item[1], measure))] or [(0, [])]
            pairs |= {f"{swarm} at {rate}": (runs, finest) for rate, runs in coarser}
        note = f"from the most physics steps a second; equal within {100 * EQUAL:.0f} % of their median"
        return differences(
            pairs, measure, ("with these", "with the most"), margin=lambda a, b: EQUAL * float(np.median(b)), note=note
        )

    return test


def _observed(rows: Rows, column: str, statistic: Callable, unit: str) -> str:
    """Statistic of a column of the observed runs, by type and number of physics steps."""
    seen = [row for row in rows if row[column] is not None]
    parts = []
    for swarm, mine in by(seen, "type").items():
        found = {rate: statistic([row[column] for row in runs]) for rate, runs in sorted(by(mine, "rate").items())}
        parts.append(f"{swarm}, " + ", ".join(f"{rate}: {number(float(value))}" for rate, value in found.items()))
    return f"{'; '.join(parts)} {unit}"


def _how_observed(rows: Rows, what: str) -> str:
    repeats = len({row["repeat"] for row in rows if row["overlap"] is not None})
    return f"{what} of {repeats} runs of each kind in the planar engine, without refinement, on one thread"


def _overlap(rows: Rows) -> Judged | None:
    finest = [row["overlap"] for row in select(rows, rate=100) if row["overlap"] is not None]
    if not finest:
        return None
    rule = f"{_how_observed(rows, 'largest')}; holds if at most {NEGLIGIBLE:g} mm"
    verdict = TOO_FEW if len(finest) < LEAST else HOLDS if max(finest) <= NEGLIGIBLE else FAILS
    return Judged(_observed(rows, "overlap", max, "mm"), rule, verdict)


TESTS: Mapping[str, Test] = {
    "choices reach": _chosen(lambda choice: choice not in BALANCED),
    # Whether 55 V release a ball, and a voltage lifts one, is arithmetic with the fitted works of adhesion.
    "grips reach": _chosen(lambda choice: choice in BALANCED),
    "choices change": _changes,
    # The paper calls its swarm robust without a run in which robots fail.
    "robust": _robust,
    "cost": _cost,
    "same time to goal": _same_by_rate(TIME),
    "same dust": _same_by_rate(DUST),  # by construction: runs stop at the goal
    "same collisions": _same_by_rate(COLLISIONS),
    "same carriage": _same_by_rate(CARRIAGE),
    "overlap": _overlap,  # fitted: the planar engine's default refinement was set by this
    "step time": lambda rows: Judged(
        _observed(rows, "ms_per_step", np.median, "ms"), _how_observed(rows, "median of the medians")
    ),
    "refused": lambda rows: Judged(_refused(rows), "turning and walking steps as 2 : 3, but 1 : 1 of 2"),
}
_HOP_COUNT = {measure: one for measure, one in zip((TIME, DUST, COLLISIONS, CARRIAGE), SWARM_STATEMENTS, strict=False)}
STATEMENTS = [
    *stated(TESTS),
    *map(_slowed, TIMED),
    *(
        Statement(
            "message-time",
            f"{one.claim}, with messages at {setting}",
            NOT_IN_PAPER,
            "not studied",
            PREDICTED,
            hop_counts(measure, setting),
        )
        for setting in TIMED
        for measure, one in _HOP_COUNT.items()
    ),
    *(
        statement
        for name in SWARMS
        for statement in (
            *(_same_by_trials(name, measure, voltage) for measure in (TIME, ATTEMPTS) for voltage in VOLTAGES),
            _larger_by_trials(
                name, "At 30 V more grasps fail at 50 % RH than at 10 %", FAILED, "relative_humidity", 50.0, 10.0
            ),
            _larger_by_trials(
                name, "At 50 % RH a swarm with 30 V takes longer than one with 55 V", TIME, "grasp_voltage", 30.0, 55.0
            ),
        )
    ),
]
