"""The statements on swarms, each with its judge: of section 4.6 of the paper (Figs. 15 to 17, Table 2), and beyond it.

Most rules were fixed before the runs that they judge; margins that were widened when first results had been seen are
named in docs/comparison.md. `asks` has what `iswarm infer` asks of single sets of runs.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from iswarm_mj.config import DriveConfig
from iswarm_mj.experiments.analysis.findings import (
    ALPHA,
    CONSTRUCTED,
    FAILS,
    FITTED,
    HOLDS,
    NOT_COMPARABLE,
    NOT_IN_PAPER,
    PREDICTED,
    TOO_FEW,
    Judged,
    Rows,
    Statement,
    number,
)
from iswarm_mj.experiments.analysis.judge import (
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
from iswarm_mj.experiments.analysis.measures import (
    AGGREGATION,
    ATTEMPTS,
    BEST,
    CARRIAGE,
    CLEAN,
    COLLISIONS,
    DUST,
    FAILED,
    FITNESS,
    PAPER_FITNESS,
    PAPER_TIME,
    PENALTIES,
    SHORTEST,
    SPARSEST,
    STEPS,
    TIME,
    Measure,
    by,
    finished,
    select,
    values,
)
from iswarm_mj.experiments.analysis.statistics import Interval, compare, difference, holm, interval
from iswarm_mj.utils.errors import ConfigError

Groups = Callable[[Rows], Mapping[str, Rows]]
NEARLY = 0.05
"""Fitness within this share of the paper's is the same: 39 steps of the finishing time."""
SAME_PENALTY = 2.0
"""A penalty agrees within this factor."""
NEAR = 3.5
"""A robot is at a dust area if it is in it or within this distance of it, the sensory radius [rd]."""


# --- One set of runs, a run or a few of each setting: yes or no ---


def _middle(rows: Rows, measure: Measure) -> float:
    """Median of a measure; infinite where no run has a value."""
    found = values(rows, measure)
    return float(np.median(found)) if len(found) else math.inf


def _reaches(rows: Rows) -> bool:
    return 2 * finished(rows) > len(rows)


def _medians(rows: Rows, measure: Measure) -> dict[float, float]:
    return {density: _middle(runs, measure) for density, runs in sorted(by(rows, "density").items())}


def _with_is_better(measure: Measure) -> Callable[[Rows], bool]:
    def holds(rows: Rows) -> bool:
        there, absent = (_middle(select(rows, use_hop_count=flag), measure) for flag in (True, False))
        return there > absent if measure.is_better_larger else there < absent

    return holds


def _is_best(measure: Measure) -> Callable[[Rows], bool]:
    def holds(rows: Rows) -> bool:
        found = _medians(rows, measure)
        return BEST[0] <= min(found, key=found.__getitem__) <= BEST[1]

    return holds


def _dense_are_slower(rows: Rows) -> bool:
    found = _medians(rows, TIME)
    best = min(time for density, time in found.items() if BEST[0] <= density <= BEST[1])
    return all(time > best for density, time in found.items() if density > CLEAN[1])


def _time_agrees(name: str) -> Callable[[Rows], bool]:
    def holds(rows: Rows) -> bool:
        runs = select(rows, type=name)
        return _reaches(runs) and abs(_middle(runs, TIME) / PAPER_TIME[name] - 1) <= EQUAL

    return holds


def _penalty_agrees(name: str) -> Callable[[Rows], bool]:
    def holds(rows: Rows) -> bool:
        ratio = 0.05 * _middle(select(rows, type=name), COLLISIONS) / PENALTIES[name]
        return 1 / SAME_PENALTY <= ratio <= SAME_PENALTY

    return holds


def _same_time(rows: Rows) -> bool:
    runs = [select(rows, type=name) for name in PAPER_TIME]
    one, two = (_middle(each, TIME) for each in runs)
    return all(map(_reaches, runs)) and abs(one - two) <= EQUAL * (one + two) / 2


def time_error(rows: Rows) -> float:
    """Mean of |log(time / the paper's)| of both types; runs that did not finish count as the time limit."""
    found = [_middle(select(rows, type=name), TIME) / time for name, time in PAPER_TIME.items()]
    return float(np.mean(np.abs(np.log(found))))


# --- Fig. 15 ---


def _hop_count(
    claim: str, figure: str, paper: str, measure: Measure, ask: str, setting: str | None = None
) -> Statement:
    def test(rows: Rows) -> Judged | None:
        mine = rows if setting is None else select(rows, setting=setting)
        groups = select(mine, use_hop_count=True), select(mine, use_hop_count=False)
        return differences({"": groups}, measure, ("with", "without"), measure.is_better_larger)

    if setting is not None:
        claim = f"{claim}, with messages at {setting}"
        return Statement("message-time", claim, NOT_IN_PAPER, "not studied", PREDICTED, test)
    return Statement("hop-count", claim, f"Fig. 15({figure})", paper, PREDICTED, test, {ask: _with_is_better(measure)})


_HOP_COUNT = (
    ("With hop counts the goal is achieved more quickly", "a", "much more quickly", TIME, "Hop counts: faster"),
    ("With hop counts more dust is removed", "b", "more", DUST, "Hop counts: more dust"),
    ("With hop counts fewer collisions happen", "c", "fewer", COLLISIONS, "Hop counts: fewer collisions"),
    ("With hop counts dust is carried on a shorter way", "d", "shorter", CARRIAGE, "Hop counts: shorter carriage"),
)

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


# --- Fig. 17 ---


def _lowest(claim: str, figure: str, measure: Measure, ask: str) -> Statement:
    claim, source = f"Swarms of density 0.1 to 0.15 {claim}", f"section 4.6.2, Fig. 17({figure})"
    return Statement(
        "density",
        claim,
        source,
        "0.1 to 0.15",
        PREDICTED,
        lambda rows: optimum(by(rows, "density"), measure, BEST),
        {ask: _is_best(measure)},
    )


def _later(rows: Rows) -> Judged | None:
    best = [row for row in rows if BEST[0] <= row["density"] <= BEST[1]]
    dense = {d: runs for d, runs in sorted(by(rows, "density").items()) if d > CLEAN[1]}
    note = f"from all of 0.1 to 0.15, late runs counted as {rows[0]['max_steps']} steps"
    return differences({f"{d:g}": (runs, best) for d, runs in dense.items()}, note=note)


def _cleaned(claim: str, source: str, paper: str, low: float, high: float, cleans: bool, ask: str) -> Statement:
    """More than half of the swarms of each of these densities reach the goal, or do not."""

    def groups(rows: Rows) -> Mapping[str, Rows]:
        return {f"{d:g}": runs for d, runs in sorted(by(rows, "density").items()) if low <= d <= high}

    return Statement(
        "density",
        claim,
        f"{source}section 4.6.2, Fig. 17(b)",
        paper,
        PREDICTED,
        lambda rows: reaching(groups(rows), cleans),
        {ask: lambda rows: all(_reaches(runs) == cleans for runs in groups(rows).values())},
    )


# --- Table 2 ---


def _types(rows: Rows) -> dict[str, Rows]:
    return {name: select(rows, type=name) for name in PAPER_FITNESS}


def _of_types(test: Callable[[dict[str, Rows]], Judged | None]) -> Callable[[Rows], Judged | None]:
    """A test of both of the paper's types; nothing follows from one."""
    return lambda rows: test(types) if all((types := _types(rows)).values()) else None


def _as_the_papers(measure: Measure, paper: Mapping[str, float], margin: float, statistic: Callable) -> Callable:
    def test(types: dict[str, Rows]) -> Judged | None:
        samples = {name: values(runs, measure) for name, runs in types.items()}
        said = {
            name: f"{100 * (statistic(sample) / paper[name] - 1):+.1f} %, from {number(min(sample), 4)} to "
            f"{number(max(sample), 4)}"
            for name, sample in samples.items()
        }
        limits = {name: ((1 - margin) * value, (1 + margin) * value) for name, value in paper.items()}
        note = (
            f"within {100 * margin:.0f} % of the paper's, which are of the fittest run of each type among the 1200 of "
            f"an evolution, ours of fresh runs of its parameters; those that do not finish take {STEPS} steps"
        )
        return averages(samples, limits, measure.unit, statistic, said, note)

    return _of_types(test)


def _early(types: dict[str, Rows]) -> Judged | None:
    early = {name: sum((row["finished_at"] or STEPS) < SHORTEST for row in runs) for name, runs in types.items()}
    return shares({name: (count, len(types[name])) for name, count in early.items()}, high=RARE)


def _pair(rows: Mapping[str, Rows]) -> dict[str, tuple[Rows, Rows]]:
    return {"": (rows["type1"], rows["type2"])}


def _fitter(preset: str, rival: str) -> Statement:
    # Fitted: an evolution selected it by this fitness, in this simulator, if not with these seeds.
    def test(rows: Rows) -> Judged | None:
        groups = select(rows, type=preset), select(rows, type=rival)
        return differences({"": groups}, FITNESS, (f"of {preset}", f"of {rival}"))

    return Statement("types", f"The preset {preset} is fitter than {rival}", NOT_IN_PAPER, "-", FITTED, test)


# --- Beyond the paper ---


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


def _same_by_rate(measure: Measure, name: str, kind: str) -> Statement:
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

    claim = f"The {name} does not depend on the physics time step"
    return Statement("time-step", claim, NOT_IN_PAPER, "not studied", kind, test)


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


_ABSENT = (NOT_IN_PAPER, "not studied")
STATEMENTS = (
    *(_hop_count(*one) for one in _HOP_COUNT),
    _lowest("finish in the shortest time", "a", TIME, "Fastest at 0.1 to 0.15"),
    _lowest("have the fewest collisions per robot", "c", COLLISIONS, "Fewest collisions at 0.1 to 0.15"),
    _lowest("have the shortest mean carriage", "d", CARRIAGE, "Shortest carriage at 0.1 to 0.15"),
    Statement(
        "density",
        "Swarms of density above 0.2 finish later than those of 0.1 to 0.15",
        "section 4.6.2, Fig. 17(a)",
        "shortest from 0.1 to 0.15",
        PREDICTED,
        _later,
        {"Slower above 0.2": _dense_are_slower},
    ),
    _cleaned("Swarms of density 0.1 to 0.2 clean the whole arena", "", "0.1 to 0.2", *CLEAN, True, "0.1 to 0.2 cleans"),
    _cleaned(
        "Swarms of density 0.05 do not clean the whole arena",
        "",
        "0.05 is outside of 0.1 to 0.2",
        SPARSEST,
        SPARSEST,
        False,
        "0.05 does not clean",
    ),
    _cleaned(
        "Swarms of density above 0.2 do not clean the whole arena",
        "by implication of ",
        "0.25 to 0.4 are outside of 0.1 to 0.2",
        float(np.nextafter(CLEAN[1], 1)),
        math.inf,
        False,
        "Above 0.2 does not clean",
    ),
    Statement(
        "types",
        "Both types clean the whole arena within 800 steps",
        "Table 2, section 4.6",
        "fitness above 2860: yes",
        PREDICTED,
        _of_types(reaching),
    ),
    Statement(
        "types",
        "Both types take as long as the paper's to clean the arena",
        "Table 2, section 4.6",
        f"{PAPER_TIME['type1']} and {PAPER_TIME['type2']} steps at most, by their fitness",
        NOT_COMPARABLE,
        _as_the_papers(TIME, PAPER_TIME, EQUAL, np.median),
        {"Type 1 takes 310 steps": _time_agrees("type1"), "Type 2 takes 311 steps": _time_agrees("type2")},
    ),
    Statement(
        "types",
        "Both types take equally long to clean the arena",
        "Table 2, Fig. 16",
        "equivalent: 310 and 311 steps",
        PREDICTED,
        _of_types(
            lambda types: differences(
                _pair(types),
                TIME,
                ("of type1", "of type2"),
                margin=lambda a, b: EQUAL * float(np.median(a) + np.median(b)) / 2,
                note=f"equal within {100 * EQUAL:.0f} % of the medians",
            )
        ),
        {"Both types take the same time": _same_time},
    ),
    Statement(
        "types",
        f"No run of both types finishes in less than {SHORTEST} steps",
        "section 4.6",
        "shortest in theory: 250",
        PREDICTED,
        _of_types(_early),
    ),
    Statement(
        "types",
        "Both types have the paper's fitness",
        "Table 2, Fig. 16",
        "7771 (type 1) and 7766 (type 2) points",
        NOT_COMPARABLE,
        _as_the_papers(FITNESS, PAPER_FITNESS, NEARLY, np.mean),
        {
            "Type 1 loses 9 points by collisions": _penalty_agrees("type1"),
            "Type 2 loses 4 points by collisions": _penalty_agrees("type2"),
        },
    ),
    Statement(
        "types",
        "Both types are equally fit",
        "section 4.6.1, Table 2",
        "equivalent: 7771 and 7766 points",
        PREDICTED,
        _of_types(
            lambda types: differences(
                _pair(types),
                FITNESS,
                ("of type1", "of type2"),
                margin=lambda a, b: NEARLY * PAPER_FITNESS["type1"],
                statistic=np.mean,
                note=f"equal within {100 * NEARLY:.0f} % of the paper's {PAPER_FITNESS['type1']}",
            )
        ),
    ),
    Statement(
        "types",
        "Empty robots gather around the dust areas more in type 2 than in type 1",
        "Fig. 16",
        "more intensive in type 2",
        PREDICTED,
        _of_types(
            lambda types: differences(
                {"": (types["type2"], types["type1"])},
                AGGREGATION,
                ("of the empty workers of type2", "of type1"),
                note=f"within {NEAR:g} rd of a dust area until half of the balls are delivered",
            )
        ),
    ),
    *(_fitter("evolved", rival) for rival in PAPER_FITNESS),
    *(_slowed(setting) for setting in TIMED),
    *(_hop_count(*one, setting) for setting in TIMED for one in _HOP_COUNT),
    Statement(
        "sensitivity",
        "The goal is reached with each other choice and each other noise",
        NOT_IN_PAPER,
        "one setting only",
        PREDICTED,
        _chosen(lambda choice: choice not in BALANCED),
    ),
    # Whether 55 V release a ball, and a voltage lifts one, is arithmetic with the fitted works of adhesion.
    Statement(
        "sensitivity",
        "The goal is reached at each other humidity and grasp voltage",
        NOT_IN_PAPER,
        "one setting only",
        CONSTRUCTED,
        _chosen(lambda choice: choice in BALANCED),
    ),
    Statement(
        "sensitivity",
        "Choices that change the time to the goal",
        NOT_IN_PAPER,
        "one setting only",
        PREDICTED,
        _changes,
    ),
    # The paper calls its swarm robust without a run in which robots fail.
    Statement(
        "robustness",
        "The swarm is robust: it reaches the goal with up to half of its robots dead",
        "section 5",
        "robust",
        NOT_COMPARABLE,
        _robust,
    ),
    Statement("robustness", "Dead robots cost more time than absent ones", *_ABSENT, PREDICTED, _cost),
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
    _same_by_rate(TIME, "time to the goal", PREDICTED),
    _same_by_rate(DUST, "number of delivered balls", CONSTRUCTED),  # runs stop at the goal
    _same_by_rate(COLLISIONS, "number of collisions", PREDICTED),
    _same_by_rate(CARRIAGE, "mean carriage", PREDICTED),
    # The planar engine's default refinement was set by this.
    Statement(
        "time-step",
        "At 100 physics steps a second robots overlap by at most 0.1 mm",
        *_ABSENT,
        FITTED,
        _overlap,
    ),
    Statement(
        "time-step",
        "Time of a control step in the planar engine",
        *_ABSENT,
        NOT_COMPARABLE,
        lambda rows: Judged(
            _observed(rows, "ms_per_step", np.median, "ms"), _how_observed(rows, "median of the medians")
        ),
    ),
    Statement(
        "time-step",
        "Numbers of physics steps a second that are refused",
        *_ABSENT,
        CONSTRUCTED,
        lambda rows: Judged(_refused(rows), "turning and walking steps as 2 : 3, but 1 : 1 of 2"),
    ),
)
ASKED = {text: (statement.study, holds) for statement in STATEMENTS for text, holds in statement.asks.items()}
"""All that section 4.6 says of runs of given swarms, as yes or no: texts, the study whose rows they are on, answers."""
