"""Statements of section 4.6 of the paper on swarms (Figs. 15 to 17, Table 2), and beyond the paper.

Those beyond are on other choices, failed robots, messages, grasps and time steps. Most rules were
fixed before the runs that they judge; margins that were widened when first results had been seen
are named in docs/statements.md.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import MappingProxyType

import numpy as np

from iswarm_mj.config.swarm import DriveConfig
from iswarm_mj.paper.analysis import findings as f
from iswarm_mj.paper.analysis import measures as m
from iswarm_mj.paper.analysis.choice_effects import effects_of_choices, setting_text
from iswarm_mj.paper.analysis.findings import (
    Judgement,
    Statement,
    Test,
    added_statement,
    number_text,
    paper_statements,
)
from iswarm_mj.paper.analysis.judge import (
    EQUALITY_MARGIN,
    FITNESS_MARGIN,
    MIN_RUNS,
    RARE_SHARE,
    Estimate,
    judge_averages,
    judge_differences,
    judge_estimates,
    judge_optimum,
    judge_reaching,
    judge_shares,
)
from iswarm_mj.paper.analysis.measures import Measure, count_finished, values
from iswarm_mj.paper.analysis.varied_values import (
    BALANCE,
    DEFAULT,
    FINEST_RATE,
    HUMIDITIES,
    INSTANT_MESSAGES,
    SWARMS,
    TIMED_MESSAGES,
    TRIALS,
    VOLTAGES,
    refused_rates,
)
from iswarm_mj.search.rows import Rows, by, select
from iswarm_mj.utils.intervals import Interval, Statistic, Values, interval

BALANCE_CHOICES = ("gripper.relative_humidity", "gripper.grasp_voltage")
"""Choices by which the balance of forces alone decides."""
NEGLIGIBLE_OVERLAP = 0.1
"""Overlap that does not matter: a twentieth of a robot [mm]."""


# --- Hop counts, densities and both types: Figs. 15 to 17, Table 2 ---


def _compare_values(
    measure: Measure,
    column: str,
    first: object,
    second: object,
    *,
    first_is_better: bool = False,
    margin: Callable[[Values, Values], float] | None = None,
    statistic: Statistic = np.median,
    at: Mapping[str, object] = MappingProxyType({}),
) -> Test:
    """Return a test that runs with one value of a column have more of a measure than with another.

    Args:
        measure: measure of the runs.
        column: column whose values are compared.
        first: value whose runs are to have more.
        second: value that they are compared with.
        first_is_better: the first are to be better instead, which may mean less.
        margin: the difference that counts as none; if it is given, both are to be equal.
        statistic: what is compared, by default the median.
        at: values of other columns, in all runs.
    """
    more = measure.is_better_larger or not first_is_better

    def test(rows: Rows) -> Judgement | None:
        pair = (
            select(rows, **at, **{column: first}),
            select(rows, **at, **{column: second}),
        )
        return judge_differences({"": pair}, measure, more=more, margin=margin, statistic=statistic)

    return test


def _hop_counts_are_better(
    measure: Measure, at: Mapping[str, object] = MappingProxyType({})
) -> Test:
    """Return a test that hop counts make a measure better."""
    return _compare_values(measure, "use_hop_count", True, False, first_is_better=True, at=at)


def _messages_slow(setting: str) -> Test:
    """Return a test that the messages of a setting slow a swarm with hop counts down."""
    with_hop_counts = {"use_hop_count": True}
    return _compare_values(m.TIME, "setting", setting, INSTANT_MESSAGES, at=with_hop_counts)


def _by_density(rows: Rows, low: float, high: float) -> dict[str, Rows]:
    """Return the runs of each density in a range, by the density as text."""
    groups = sorted(by(rows, "density").items())
    return {f"{density:g}": runs for density, runs in groups if low <= density <= high}


def _judge_best_density(measure: Measure, rows: Rows) -> Judgement | None:
    """Judge whether a measure is lowest at the paper's best densities."""
    return judge_optimum(by(rows, "density"), measure, m.BEST_DENSITIES)


def _judge_dense_slower(rows: Rows) -> Judgement | None:
    """Judge whether each high density takes longer than the best ones together."""
    low, high = m.BEST_DENSITIES
    best = [row for row in rows if low <= row["density"] <= high]
    dense = _by_density(rows, *m.HIGH_DENSITIES)
    return judge_differences({density: (runs, best) for density, runs in dense.items()})


def _judge_cleaning(rows: Rows) -> Judgement | None:
    """Judge whether swarms of the densities at which the paper's clean the arena do so."""
    return judge_reaching(_by_density(rows, *m.CLEANING_DENSITIES))


def _judge_sparse(rows: Rows) -> Judgement | None:
    """Judge whether swarms of the smallest density do not clean the arena."""
    sparsest = _by_density(rows, m.SPARSEST_DENSITY, m.SPARSEST_DENSITY)
    return judge_reaching(sparsest, does=False)


def _judge_dense(rows: Rows) -> Judgement | None:
    """Judge whether swarms of high densities do not clean the arena."""
    return judge_reaching(_by_density(rows, *m.HIGH_DENSITIES), does=False)


def _by_type(rows: Rows) -> dict[str, Rows]:
    """Return the runs of both of the paper's types, by type.

    There are none if a type lacks runs: nothing follows from the other one alone.
    """
    types: dict[str, Rows] = {name: select(rows, type=name) for name in SWARMS}
    return types if all(types.values()) else {}


def _judge_types_cleaning(rows: Rows) -> Judgement | None:
    """Judge whether both types clean the arena."""
    return judge_reaching(_by_type(rows))


def _near_the_papers(
    measure: Measure, paper: Mapping[str, float], margin: float, statistic: Statistic
) -> Test:
    """Return a test that both types have nearly the paper's value of a measure.

    Args:
        measure: measure of the runs.
        paper: the paper's value for each type.
        margin: share of the paper's value by which ours may differ.
        statistic: the mean or the median.
    """
    limits = {name: ((1 - margin) * value, (1 + margin) * value) for name, value in paper.items()}

    def test(rows: Rows) -> Judgement | None:
        samples = {name: values(runs, measure) for name, runs in _by_type(rows).items()}
        return judge_averages(samples, limits, measure.unit, statistic)

    return test


def _equal_time_margin(first: Values, second: Values) -> float:
    """Return the difference of two median times that counts as none."""
    return EQUALITY_MARGIN * float(np.median(first) + np.median(second)) / 2


def _equal_fitness_margin(_first: Values, _second: Values) -> float:
    """Return the difference of two mean fitnesses that counts as none."""
    return FITNESS_MARGIN * m.PAPER_FITNESS["type1"]


def _judge_early(rows: Rows) -> Judgement | None:
    """Judge whether next to no run of either type finishes before the shortest time."""
    counts = {}
    for name, runs in _by_type(rows).items():
        n_early = sum((row["finished_at"] or m.EVOLUTION_STEPS) < m.SHORTEST_TIME for row in runs)
        counts[name] = (n_early, len(runs))
    return judge_shares(counts, (-math.inf, RARE_SHARE))


# --- Choices that the paper leaves open ---


def _list_effects(rows: Rows) -> Judgement | None:
    """List the choices that change the time, without a verdict.

    They are chosen by the raw p-values; how many remain by the adjusted ones is counted.
    """
    default_runs = select(rows, choice=DEFAULT)
    if not default_runs or len(default_runs) == len(rows):
        return None

    effects = effects_of_choices(rows)
    clear = [effect for effect in effects if effect.p < f.ALPHA]
    n_after_holm = sum(effect.adjusted_p < f.ALPHA for effect in clear)
    ours = (
        f"{len(clear)} of {len(effects)} at p < {f.ALPHA:g}, {n_after_holm} of them after Holm's "
        f"correction: {', '.join(effect.setting for effect in clear)}"
    )
    return Judgement(ours, f"Mann-Whitney, n = {len(default_runs)} each")


def _judge_choices_reach(rows: Rows, *, by_balance: bool) -> Judgement | None:
    """Judge whether swarms with other values of choices reach the goal.

    Args:
        rows: the runs.
        by_balance: take the choices by which the balance of forces alone decides, else the others.
    """
    chosen = [
        row
        for row in rows
        if row["choice"] != DEFAULT and (row["choice"] in BALANCE_CHOICES) == by_balance
    ]
    groups = by(chosen, "choice", "value").items()
    return judge_reaching({setting_text(*setting): runs for setting, runs in groups})


# --- Failed robots ---


def _percent(fraction: float) -> str:
    """Return a fraction in per cent."""
    return f"{100 * fraction:.0f} %"


def _judge_robust(rows: Rows) -> Judgement | None:
    """Judge whether swarms reach the goal whatever the fraction of dead robots."""
    dead = sorted(by(select(rows, kind="dead"), "fraction").items())
    if len(dead) < 2:
        return None
    return judge_reaching({_percent(fraction): runs for fraction, runs in dead})


def _judge_cost_of_dead(rows: Rows) -> Judgement | None:
    """Judge whether dead robots cost more time than absent ones."""
    dead = by(select(rows, kind="dead"), "fraction")
    absent = by(select(rows, kind="absent"), "fraction")
    common = sorted(dead.keys() & absent.keys())
    return judge_differences(
        {_percent(fraction): (dead[fraction], absent[fraction]) for fraction in common}
    )


# --- Grasps by trials instead of the balance of forces ---


def _judge_same_by_trials(
    swarm: str, measure: Measure, voltage: float, rows: Rows
) -> Judgement | None:
    """Judge whether trials leave a measure as it is by the balance of forces, at each humidity.

    The ratio of pairs of runs with the same seed is to be one. A run that does not reach the goal
    takes its time limit.
    """
    estimates = []
    for humidity in HUMIDITIES:
        runs = select(rows, type=swarm, grasp_voltage=voltage, relative_humidity=humidity)
        ratios = _ratios_of_pairs(runs, measure)
        if not len(ratios):
            continue

        # Times need enough runs that reach the goal: those that do not all take the time limit.
        n_pairs = len(ratios)
        has_enough = measure is not m.TIME or count_finished(runs) >= MIN_RUNS
        estimate = Estimate(
            Interval(*np.exp(interval(np.log(ratios)))),
            sizes=(n_pairs,),
            low=1 - EQUALITY_MARGIN,
            high=1 + EQUALITY_MARGIN,
            label=f"{humidity:g} % RH",
            min_runs=MIN_RUNS if has_enough else n_pairs + 1,
        )
        estimates.append(estimate)

    judgement = judge_estimates(estimates, "geometric means of pairs of the same seed")
    if judgement is not None and len(estimates) < len(HUMIDITIES):
        return judgement._replace(verdict=f.TOO_FEW)
    return judgement


def _ratios_of_pairs(runs: Rows, measure: Measure) -> np.ndarray:
    """Return the ratio by trials to that by the balance, of pairs of positive values.

    Pairs are runs of the same seed, in the order of the seeds.
    """
    by_balance = {row["seed"]: row for row in select(runs, resolution=BALANCE)}
    by_trials = {row["seed"]: row for row in select(runs, resolution=TRIALS)}
    seeds = sorted(by_balance.keys() & by_trials.keys())
    static = values([by_balance[seed] for seed in seeds], measure)
    dynamic = values([by_trials[seed] for seed in seeds], measure)

    is_positive = (static > 0) & (dynamic > 0)
    return dynamic[is_positive] / static[is_positive]


def _statements_on_grasps(swarm: str) -> list[Statement]:
    """Return the statements on the grasps of one swarm.

    They are at the lowest voltage and in the dampest air unless these vary.
    """
    tests: dict[str, Test] = {}
    judged_measures = ((m.TIME, "finishing time"), (m.ATTEMPTS, "number of attempts per ball"))
    for measure, name in judged_measures:
        for voltage in VOLTAGES:
            claim = (
                f"At {voltage:g} V trials instead of the balance of the forces leave the {name} "
                f"as it is, {swarm}"
            )
            tests[claim] = partial(_judge_same_by_trials, swarm, measure, voltage)

    trials: dict[str, object] = {"type": swarm, "resolution": TRIALS}
    tests[f"At 30 V more grasps fail at 50 % RH than at 10 %, {swarm}"] = _compare_values(
        m.FAILED, "relative_humidity", 50.0, 10.0, at=trials | {"grasp_voltage": 30.0}
    )
    tests[f"At 50 % RH a swarm with 30 V takes longer than one with 55 V, {swarm}"] = (
        _compare_values(
            m.TIME, "grasp_voltage", 30.0, 55.0, at=trials | {"relative_humidity": 50.0}
        )
    )
    return [added_statement("resolved-grasps", claim, test) for claim, test in tests.items()]


# --- Physics steps ---


def _list_refused(rows: Rows) -> Judgement:
    """List the numbers of physics steps that have no runs since the drive refuses them."""
    refused = [
        f"{rate}: {error}"
        for rate, error in refused_rates(DriveConfig()).items()
        if not select(rows, rate=rate)
    ]
    return Judgement("; ".join(refused) or "none", "")


def _judge_same_by_rate(measure: Measure, rows: Rows) -> Judgement | None:
    """Judge whether a measure is the same with fewer physics steps as with the most."""
    pairs: dict[str, tuple[Rows, Rows]] = {}
    for swarm in SWARMS:
        groups = sorted(by(select(rows, type=swarm), "rate").items())
        measured = [(rate, runs) for rate, runs in groups if len(values(runs, measure))]
        if not measured:
            continue

        # Each number of physics steps against the largest.
        _, finest_runs = measured[-1]
        for rate, runs in measured[:-1]:
            pairs[f"{swarm} at {rate}"] = (runs, finest_runs)

    def margin(_coarse: Values, finest: Values) -> float:
        return EQUALITY_MARGIN * float(np.median(finest))

    return judge_differences(pairs, measure, margin=margin)


def _observed_text(rows: Rows, measure: Measure, statistic: Callable) -> str:
    """Return a statistic of a measure of the observed runs, by type and number of physics steps."""
    observed = [row for row in rows if measure.value(row) is not None]
    texts = []
    for swarm, swarm_rows in by(observed, "type").items():
        numbers = []
        for rate, runs in sorted(by(swarm_rows, "rate").items()):
            number = float(statistic(values(runs, measure)))
            numbers.append(f"{rate}: {number_text(number)}")
        texts.append(f"{swarm}, {', '.join(numbers)}")
    return f"{'; '.join(texts)} {measure.unit}"


def _judge_overlap(rows: Rows) -> Judgement | None:
    """Judge whether overlaps are negligible with the most physics steps."""
    finest = values(select(rows, rate=FINEST_RATE), m.OVERLAP)
    if not len(finest):
        return None

    if len(finest) < MIN_RUNS:
        verdict = f.TOO_FEW
    else:
        verdict = f.HOLDS if finest.max() <= NEGLIGIBLE_OVERLAP else f.FAILS
    rule = f"largest of the runs of a type; holds if at most {NEGLIGIBLE_OVERLAP:g} mm"
    return Judgement(_observed_text(rows, m.OVERLAP, max), rule, verdict)


def _list_step_times(rows: Rows) -> Judgement:
    """List the computing times of a control step."""
    return Judgement(_observed_text(rows, m.STEP_TIME, np.median), "")


# --- All statements ---

TESTS: Mapping[str, Test] = {
    # Hop counts, Fig. 15.
    **{f"hop {name}": _hop_counts_are_better(each) for name, each in m.FIGURE_MEASURES.items()},
    # Densities, Fig. 17.
    "best time": partial(_judge_best_density, m.TIME),
    "best collisions": partial(_judge_best_density, m.COLLISIONS),
    "best carriage": partial(_judge_best_density, m.CARRIAGE),
    "dense slower": _judge_dense_slower,
    "cleans": _judge_cleaning,
    "sparse": _judge_sparse,
    "dense": _judge_dense,
    # Both types, Fig. 16 and Table 2.
    "types clean": _judge_types_cleaning,
    "types time": _near_the_papers(m.TIME, m.PAPER_TIME, EQUALITY_MARGIN, np.median),
    "same time": _compare_values(m.TIME, "type", *SWARMS, margin=_equal_time_margin),
    "early": _judge_early,
    "types fitness": _near_the_papers(m.FITNESS, m.PAPER_FITNESS, FITNESS_MARGIN, np.mean),
    "equally fit": _compare_values(
        m.FITNESS, "type", *SWARMS, margin=_equal_fitness_margin, statistic=np.mean
    ),
    "gathering": _compare_values(m.AGGREGATION, "type", "type2", "type1"),
    # Fitted: an evolution selected it by this fitness, in this simulator, if not with these seeds.
    "evolved type1": _compare_values(m.FITNESS, "type", "evolved", "type1"),
    "evolved type2": _compare_values(m.FITNESS, "type", "evolved", "type2"),
    # Choices.
    "choices reach": partial(_judge_choices_reach, by_balance=False),
    # Whether 55 V release a ball, and a voltage lifts one, is arithmetic with the fitted works of
    # adhesion.
    "grips reach": partial(_judge_choices_reach, by_balance=True),
    "choices change": _list_effects,
    # The paper calls its swarm robust without a run in which robots fail.
    "robust": _judge_robust,
    "cost": _judge_cost_of_dead,
    # Physics steps. Dust is the same by construction: runs stop at the goal.
    "same time to goal": partial(_judge_same_by_rate, m.TIME),
    "same dust": partial(_judge_same_by_rate, m.DUST),
    "same collisions": partial(_judge_same_by_rate, m.COLLISIONS),
    "same carriage": partial(_judge_same_by_rate, m.CARRIAGE),
    # Fitted: how fine a step must be was found in such runs.
    "overlap": _judge_overlap,
    "step time": _list_step_times,
    "refused": _list_refused,
}
"""Tests of the paper's statements, and of some beyond it, by their names in statements.csv."""


def _statements_on_messages(hop_count_statements: Sequence[Statement]) -> list[Statement]:
    """Return the statements on messages that take time.

    Args:
        hop_count_statements: the paper's statements on hop counts, one for each measure of
            Fig. 15; each is judged again with messages of each setting.
    """
    statements = []
    for setting in TIMED_MESSAGES:
        claim = f"Messages at {setting} slow a swarm with hop counts down"
        statements.append(added_statement("message-time", claim, _messages_slow(setting)))

    for setting in TIMED_MESSAGES:
        for statement, measure in zip(hop_count_statements, m.MEASURES, strict=True):
            claim = f"{statement.claim}, with messages at {setting}"
            test = _hop_counts_are_better(measure, {"setting": setting})
            statements.append(added_statement("message-time", claim, test))
    return statements


_PAPER_STATEMENTS = paper_statements(TESTS)
STATEMENTS = [
    *_PAPER_STATEMENTS,
    *_statements_on_messages(_PAPER_STATEMENTS[: len(m.MEASURES)]),
    *(statement for swarm in SWARMS for statement in _statements_on_grasps(swarm)),
]
