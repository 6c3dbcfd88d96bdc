"""Statements on the gripper: of section 3.2.1 by its laws, of sections 3.2.3 and 5 by trials.

The laws decide without runs. Trials are those on the bench (Figs. 6 to 11).

Of the laws only the peak of the force is predicted, by boundary elements. The others repeat what is
put in or compare the paper with its own equations. Of the trials nothing is predicted: the works of
adhesion, their spreads and the electrical gap of a contact are fitted to these very experiments
(`gripper.laws.detachment`), so that what concerns the level of a voltage is fitted. Adhesion and
the electrical force are both proportional to the radius, but for 1 % of the latter, so that flat
voltages are algebra; with roughness they would not be. The rise with humidity is put in. The
voltage at which a ball melts is that at which the tool's oxide breaks down, whose thickness is
fitted to it, if the heat then suffices while the tool touches the ball; the resistances that decide
this are choices. Whether a ball stays where it lands follows from restitution by plastic yield, and
from the voltage after the release, which is a choice: it is cut at once.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cache, partial
from typing import NamedTuple

import numpy as np

from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.trial import Contacts
from iswarm_mj.gripper.laws.adhesion import dmt_pull_off, humidity_factor, jkr_pull_off
from iswarm_mj.gripper.laws.detachment import (
    EQ3_CONSTANT,
    MELTING_VOLTAGE,
    PRINTED_EQ3_CONSTANT,
    PROBE_RADIUS,
    RELEASE_GAP,
    WORK_OBJECT_SUBSTRATE,
    ball_weight,
    detachment_voltage,
)
from iswarm_mj.gripper.laws.electrostatics import asymptotic_force, pick_force, release_force
from iswarm_mj.gripper.laws.melting import melting_time, melts
from iswarm_mj.gripper.reference import (
    PAPER_FIG_6,
    PAPER_GRASP,
    PAPER_HUMIDITY,
    PAPER_NO_CONTACT,
    PAPER_ON_BOARD,
    PAPER_RELEASE,
)
from iswarm_mj.paper.analysis.findings import (
    FAILS,
    HOLDS,
    UNDECIDED,
    Judgement,
    Test,
    number_text,
    paper_statements,
)
from iswarm_mj.paper.analysis.judge import (
    RARE_SHARE,
    Estimate,
    judge_always,
    judge_averages,
    judge_differences,
    judge_estimates,
    judge_shares,
)
from iswarm_mj.paper.analysis.measures import VOLTAGE, values
from iswarm_mj.paper.analysis.statistics import slope
from iswarm_mj.search.rows import Rows, by, select
from iswarm_mj.tasks.measures import Measures, fitness
from iswarm_mj.utils.intervals import Interval, difference

_RADIUS = 20e-6
"""Radius of a ball in the middle of the range [m]."""
_VOLTAGE = 40.0
"""A voltage of the range [V]."""
NEARLY_EQUAL = (0.9, 1.1)
"""A radius of the tool between these multiples of the ball's is nearly the ball's."""
FLAT_SLOPE = 0.2
"""A voltage does not depend on the radius if its slope is less than this, a fifth of the paper's
band from its least to its largest ball [V/um]."""
_MOST = (0.95, np.inf)
"""Limits of the share of the trials that lie within a range that the paper gives."""
TRANSPORT = 50e-6
"""Distance of the target to which balls are carried [m]; at least a ball's diameter."""
_UM = 1e6
"""Micrometres per metre."""
_MELTED_RADIUS = 15e-6
"""Radius of the ball that was seen to melt [m]."""


# --- Laws, which need no results ---


class Fact(NamedTuple):
    """The consequence of the laws for a statement."""

    text: str
    """Numbers that follow from them."""
    holds: bool | np.bool_
    """The statement holds."""


def _is_within(value: float, reference: float, margin: float) -> bool:
    """Return whether a value differs from a reference by less than this share of it."""
    return abs(value / reference - 1) < margin


def _force_grows_with_the_voltage_squared() -> Fact:
    once = release_force(_VOLTAGE, RELEASE_GAP, _RADIUS, PROBE_RADIUS)
    twice = release_force(2 * _VOLTAGE, RELEASE_GAP, _RADIUS, PROBE_RADIUS)
    ratio = float(twice / once)
    return Fact(
        f"twice the voltage gives {number_text(ratio, 6)} times the force", abs(ratio - 4) < 1e-9
    )


def _force_does_not_depend_on_the_size() -> Fact:
    sizes = np.array([RELEASE_GAP, _RADIUS, PROBE_RADIUS])
    changes = []
    for law in (release_force, pick_force):
        ratio = float(law(_VOLTAGE, *(2 * sizes)) / law(_VOLTAGE, *sizes))
        changes.append(abs(ratio - 1))
    change = max(changes)
    return Fact(f"twice the size changes the force by {100 * change:.1g} %", change < 1e-9)


def peak_fact() -> Fact:
    """Return where both forces are largest over the radius of the tool.

    At an end of the range they have no peak.
    """
    ratios = np.linspace(0.65, 2.0, 271)
    texts = []
    is_near = []
    for name, law in (("release", release_force), ("pick", pick_force)):
        forces = np.asarray(law(_VOLTAGE, RELEASE_GAP, _RADIUS, ratios * _RADIUS))
        index = int(forces.argmax())
        ratio = ratios[index]
        has_peak = 0 < index < len(ratios) - 1

        where = "peak" if has_peak else "no peak, largest"
        texts.append(f"{name}: {where} at R_m = {ratio:.2f} R")
        is_near.append(has_peak and NEARLY_EQUAL[0] <= ratio <= NEARLY_EQUAL[1])
    return Fact("; ".join(texts), all(is_near))


def _small_gap_equation_holds_at_the_release() -> Fact:
    limit = asymptotic_force(_VOLTAGE, RELEASE_GAP, _RADIUS)
    release = float(release_force(_VOLTAGE, RELEASE_GAP, _RADIUS, PROBE_RADIUS) / limit)
    pick = float(pick_force(_VOLTAGE, RELEASE_GAP, _RADIUS, PROBE_RADIUS) / limit)
    holds = _is_within(release, 1, 0.1) and _is_within(pick, 1, 0.1)
    return Fact(f"release {release:.3f}, pick {pick:.3f} of it", holds)


def _pull_off_lies_between_jkr_and_dmt() -> Fact:
    low = float(jkr_pull_off(_RADIUS, WORK_OBJECT_SUBSTRATE))
    high = float(dmt_pull_off(_RADIUS, WORK_OBJECT_SUBSTRATE))
    work = f"{1e3 * WORK_OBJECT_SUBSTRATE:g} mJ/m^2"
    return Fact(f"{1e6 * low:.3f} to {1e6 * high:.3f} µN for 20 µm and W of {work}", low < high)


def _constant_of_equation_3_is_the_printed_one() -> Fact:
    return Fact(f"{EQ3_CONSTANT:.3e}", _is_within(EQ3_CONSTANT, PRINTED_EQ3_CONSTANT, 0.01))


def _release_voltages_are_those_of_equation_4() -> Fact:
    works = (0.01, 1.0)
    low, high = (float(detachment_voltage(work, RELEASE_GAP, EQ3_CONSTANT)) for work in works)
    printed_low, printed_high = (
        float(detachment_voltage(work, RELEASE_GAP, PRINTED_EQ3_CONSTANT)) for work in works
    )
    return Fact(
        f"{low:.0f} to {high:.0f} V; {printed_low:.0f} to {printed_high:.0f} V with the printed "
        "constant",
        _is_within(low, 120, 0.05) and _is_within(high, 1200, 0.05),
    )


def _gravity_is_negligible() -> Fact:
    small, large = (
        float(ball_weight(radius) / dmt_pull_off(radius, WORK_OBJECT_SUBSTRATE))
        for radius in (15e-6, 25e-6)
    )
    return Fact(
        f"the weight is {100 * small:.2f} to {100 * large:.2f} % of the pull-off force for 15 to "
        "25 µm",
        max(small, large) < 0.01,
    )


def _adhesion_in_dry_air_is_half() -> Fact:
    at_90, at_70 = (1 / float(humidity_factor(humidity)) for humidity in (90.0, 70.0))
    return Fact(f"{at_90:.2f} to {at_70:.2f} of it", 0.4 < at_90 < at_70 < 0.6)


def _release_voltages_in_drier_air() -> Fact:
    # Voltages that the paper quotes for air, by the root of the ratio of adhesion.
    low = 100 / float(humidity_factor(90.0)) ** 0.5
    high = 500 / float(humidity_factor(70.0)) ** 0.5
    holds = _is_within(low, 70, 0.1) and _is_within(high, 350, 0.1)
    return Fact(f"{low:.0f} to {high:.0f} V", holds)


def _largest_points() -> Fact:
    # All balls picked up but one delivered; and all delivered in 250 steps.
    unfinished = Measures(71, 72, 0, mean_carriage_steps=None, finished_at=None)
    finished = Measures(72, 72, 0, mean_carriage_steps=None, finished_at=250)
    most = fitness(unfinished, 280, 72, 800)
    best = fitness(finished, 280, 72, 800)
    return Fact(f"{most:.0f} and {best:.0f}", most == 2860 and best == 8360)


LAWS: Mapping[str, Callable[[], Fact]] = {
    "voltage squared": _force_grows_with_the_voltage_squared,
    "scale": _force_does_not_depend_on_the_size,
    "peak": peak_fact,
    "small gaps": _small_gap_equation_holds_at_the_release,
    "pull-off bounds": _pull_off_lies_between_jkr_and_dmt,
    "constant": _constant_of_equation_3_is_the_printed_one,
    "release range": _release_voltages_are_those_of_equation_4,
    "gravity": _gravity_is_negligible,
    "half adhesion": _adhesion_in_dry_air_is_half,
    "drier air": _release_voltages_in_drier_air,
    "points": _largest_points,
}
"""Facts of the laws, by the names of their statements in statements.csv."""


def _melting_fact() -> Fact:
    """Return whether the oxide breaks down, and heat melts the ball, while the tool touches it."""
    contacts = Contacts()
    time = Protocol().contact_time
    does_melt = bool(
        melts(MELTING_VOLTAGE, _MELTED_RADIUS, contacts.breaks_at, contacts.supply, time)
    )
    needed = float(melting_time(MELTING_VOLTAGE, _MELTED_RADIUS, contacts.supply))
    return Fact(
        f"breakdown at {contacts.breaks_at:g} V, heat enough after {1e3 * needed:.2f} ms of "
        f"{1e3 * time:.2f}",
        does_melt,
    )


def _test_of_fact(fact: Callable[[], Fact]) -> Test:
    """Return a test that does not depend on results; its fact is worked out once."""
    cached_fact = cache(fact)

    def test(_: object) -> Judgement:
        text, holds = cached_fact()
        return Judgement(text, "", HOLDS if holds else FAILS)

    return test


# --- Trials, those at the paper's humidity in front ---


def _trials(rows: Rows, experiment: str) -> Rows:
    """Return the trials that are not faulty, at the paper's humidity, of releases at its gap."""
    trials = select(rows, experiment=experiment, faulty=False, relative_humidity=PAPER_HUMIDITY)
    if experiment != "release":
        return trials
    return [row for row in trials if np.isclose(row["gap"], RELEASE_GAP)]


def _voltages(rows: Rows, experiment: str) -> np.ndarray:
    """Return the voltages of `_trials` that reached one [V]."""
    return values(_trials(rows, experiment), VOLTAGE)


def _judge_without_contact(rows: Rows) -> Judgement | None:
    """Judge whether no trial without contact lifts a ball.

    It is undecided if trials ended below the paper's voltage.
    """
    trials = _trials(rows, "no_contact")
    if not trials:
        return None

    n_lifted = int((values(trials, VOLTAGE) < PAPER_NO_CONTACT).sum())
    judgement = judge_always(len(trials) - n_lifted, len(trials), " not lifted below 50 V")
    if min(row["limit_voltage"] for row in trials) < PAPER_NO_CONTACT:
        return judgement._replace(verdict=UNDECIDED)
    return judgement


def _judge_always_lifted(rows: Rows) -> Judgement | None:
    """Judge whether all trials lift their ball, at any humidity."""
    trials = select(rows, experiment="grasp", faulty=False)
    if not trials:
        return None
    return judge_always(len(values(trials, VOLTAGE)), len(trials), ", at all humidities")


def _judge_grasp_band(rows: Rows) -> Judgement | None:
    """Judge whether the means at each radius, which the paper plots, lie in its band."""
    groups = sorted(by(_trials(rows, "grasp"), "radius").items())
    samples = {f"{radius * _UM:g} µm": values(runs, VOLTAGE) for radius, runs in groups}
    return judge_averages(samples, PAPER_GRASP, "V")


def _judge_share_within(
    experiments: Sequence[str], band: Sequence[float], limits: tuple[float, float], rows: Rows
) -> Judgement | None:
    """Judge whether the share of single trials whose voltage is in a band lies within limits.

    Args:
        experiments: experiments of the trials.
        band: lowest and highest voltage [V].
        limits: limits of the share of each experiment.
        rows: the trials.
    """
    counts = {}
    for experiment in experiments:
        # Voltages are multiples of a step, of which rounding makes 36.999... V.
        voltages = np.round(_voltages(rows, experiment), 6)
        if len(voltages):
            n_inside = int(((band[0] <= voltages) & (voltages <= band[1])).sum())
            label = experiment if len(experiments) > 1 else ""
            counts[label] = (n_inside, len(voltages))
    return judge_shares(counts, limits)


def _judge_flat(experiment: str, rows: Rows) -> Judgement | None:
    """Judge whether the voltage of an experiment does not depend on the ball's radius."""
    trials = [row for row in _trials(rows, experiment) if row["voltage"] is not None]
    radii = [row["radius"] * _UM for row in trials]
    line_slope = slope(radii, [row["voltage"] for row in trials])
    if np.isnan(line_slope.estimate):
        return None
    estimate = Estimate(line_slope, sizes=(len(trials),), low=-FLAT_SLOPE, high=FLAT_SLOPE)
    return judge_estimates([estimate], "slope", "V/µm")


def _judge_humid(humidity: float, rows: Rows) -> Judgement | None:
    """Judge whether grasps at this humidity [%] take more voltage than at the paper's."""
    trials = select(rows, experiment="grasp", faulty=False, relative_humidity=humidity)
    return judge_differences({"": (trials, _trials(rows, "grasp"))}, VOLTAGE)


def _judge_reliable(rows: Rows) -> Judgement | None:
    """Judge whether all released balls land and stay; report how much the voltages scatter."""
    releases = _trials(rows, "release")
    voltages = values(releases, VOLTAGE)
    if not len(voltages):
        return None

    variation = float(voltages.std(ddof=1) / voltages.mean()) if len(voltages) > 1 else 0.0
    n_landed = sum(bool(row["landed"]) for row in releases)
    remark = f" landed and stayed; coefficient of variation {100 * variation:.1f} %"
    return judge_always(n_landed, len(releases), remark)


def _judge_release_below_theory(rows: Rows) -> Judgement | None:
    """Judge whether releases take less than the theory's 70 V on average."""
    return judge_averages({"": _voltages(rows, "release")}, (-np.inf, 70.0), "V")


def _judge_alike_voltages(rows: Rows) -> Judgement | None:
    """Judge whether releases take half to twice the voltage of grasps on average."""
    grasps = _voltages(rows, "grasp")
    releases = _voltages(rows, "release")
    if not len(grasps) or not len(releases):
        return None

    log_ratio = difference(np.log(releases), np.log(grasps), np.mean)
    estimate = Estimate(
        Interval(*map(float, np.exp(log_ratio))),
        sizes=(len(releases), len(grasps)),
        low=0.5,
        high=2.0,
        prefix=f"release {releases.mean():.1f} V, grasp {grasps.mean():.1f} V on average, ratio ",
    )
    return judge_estimates([estimate], "geometric means")


def _judge_transported(rows: Rows) -> Judgement | None:
    """Judge whether each grasped ball ends within its radius of the target aside."""
    trials = [
        row
        for row in select(rows, relative_humidity=PAPER_HUMIDITY)
        if row["experiment"] != "no_contact"
    ]
    balls = by(trials, "radius", "repeat").values()
    balls_without_fault = [ball for ball in balls if not any(row["faulty"] for row in ball)]

    # Distances from the target, in radii; earlier tables have no transport.
    distances = []
    for ball in balls_without_fault:
        for row in ball:
            if row.get("transport") == TRANSPORT:
                is_lost = not row["landed"]
                distances.append(np.inf if is_lost else row["off_target"] / row["radius"])
    if not distances:
        return None

    n_on_target = sum(distance <= 1 for distance in distances)
    remark = f" balls, at most {number_text(max(distances))} radii from the target"
    return judge_always(n_on_target, len(balls_without_fault), remark)


TRIALS: Mapping[str, Test] = {
    "no contact": _judge_without_contact,
    "always lifts": _judge_always_lifted,
    "grasp band": _judge_grasp_band,
    "grasp flat": partial(_judge_flat, "grasp"),
    "humid 5": partial(_judge_humid, 5.0),
    "humid 30": partial(_judge_humid, 30.0),
    "humid 50": partial(_judge_humid, 50.0),
    # The paper gives no means of its releases.
    "release band": partial(_judge_share_within, ["release"], PAPER_RELEASE, _MOST),
    "reliable": _judge_reliable,
    "below theory": _judge_release_below_theory,
    "release flat": partial(_judge_flat, "release"),
    "alike voltages": _judge_alike_voltages,
    "melting": _test_of_fact(_melting_fact),
    "on board": partial(_judge_share_within, ["grasp", "release"], PAPER_ON_BOARD, _MOST),
    "figure 6": partial(_judge_share_within, ["grasp"], (0.0, PAPER_FIG_6), (RARE_SHARE, np.inf)),
    "transport": _judge_transported,
}
"""Tests of the statements on trials, by their names in statements.csv."""
_TESTS_OF_LAWS = {name: _test_of_fact(fact) for name, fact in LAWS.items()}
STATEMENTS = paper_statements(_TESTS_OF_LAWS | dict(TRIALS))
