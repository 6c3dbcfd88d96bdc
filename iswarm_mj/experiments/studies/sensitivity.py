"""How the result depends on what the paper leaves open: one choice at a time, about the default."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from iswarm_mj.config import SwarmConfig
from iswarm_mj.experiments.analysis.findings import (
    ALPHA,
    CONSTRUCTED,
    HOLDS,
    NOT_IN_PAPER,
    PREDICTED,
    Claim,
    Finding,
    Rows,
    number,
)
from iswarm_mj.experiments.analysis.measures import TIME, finished, select, values
from iswarm_mj.experiments.analysis.plots import TESTS, Effect, draw_forest
from iswarm_mj.experiments.analysis.statistics import Interval, compare, difference, holm, interval, mean
from iswarm_mj.experiments.analysis.verdicts import all_of, mostly
from iswarm_mj.experiments.runner.experiment import TIME_LIMIT, Entry, Experiment, Plan, run_seed
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.experiments.runner.variation import varied
from iswarm_mj.tasks.layout import robots_for
from iswarm_mj.utils.constraints import constraint_of

REPEATS = 10
DEFAULT = "default"

VARIATIONS: Mapping[str, tuple[tuple[str, tuple[Any, ...]], ...]] = {
    "scene": (
        ("strategy.dust_range", (0.5, 1.0)),
        ("arena.dump_size", (4.0, 7.0)),
        ("arena.dust_area_size", (4.0, 9.0)),
        ("arena.dust_area_offset", (16.0, 20.0)),
    ),
    "light": (
        ("optics.photodiode_aperture", (60.0,)),
        ("optics.communication_radius", (3.0, 4.0)),
        ("optics.line_of_sight", (False,)),
        ("optics.mode", ("power",)),
        ("optics.wall_range", (0.75, 3.0)),
    ),
    "noise": (
        ("optics.error_distance_measure", (0.0, 0.2)),
        ("optics.error_in_communication", (0.0, 0.2)),
        ("optics.independent_bit_errors", (True,)),
        ("optics.p_communication_break", (0.0, 0.2)),
    ),
    "gripper": (
        ("gripper.drop_rate", (0.01, 0.05)),
        ("gripper.relative_humidity", (30.0, 50.0)),
        ("gripper.grasp_voltage", (30.0, 50.0)),
        ("gripper.tool_reach", (0.1e-3, 0.5e-3)),
    ),
    "strategy": (
        ("strategy.scouts_pick", (True,)),
        ("strategy.forget_on_arrival", (False,)),
        ("strategy.random_turn", (10.0, 90.0)),
        ("strategy.avoidance_gain", (2.0, 32.0)),
        ("strategy.priority_factor", (1.0, 4.0)),
        ("strategy.wall_gain", (0.0, 8.0)),
        ("strategy.message_range", (25.0, 98.0)),
    ),
    "motion": (("drive.max_turn", (45.0, 120.0)),),
    "update order": (("strategy.update_order", ("sequential",)),),
    "readings": (
        ("strategy.avoidance_sides", ("front", "all")),
        ("strategy.avoidance_course", ("crossing", "oncoming")),
        ("strategy.priority_repulsion", ("higher", "scaled")),
        ("strategy.avoids_at_dust", (True,)),
        ("strategy.blocked", ("waits",)),
        ("optics.parity_check", (False,)),
        ("strategy.odometry_error_turn", (10.0,)),
        ("strategy.odometry_error_step", (0.1,)),
        ("drive.error_turn", (10.0,)),
        ("drive.error_step", (0.1,)),
    ),
}
"""Values by groups; those that are the default's are left out. The paper's own values (Table 1) are varied too where
they are noise.

A run's seed follows from its place here: what is added comes last.
"""

REACHES = Claim(
    "The goal is reached with each other choice and each other noise", NOT_IN_PAPER, "one setting only", PREDICTED
)
# Whether 55 V release a ball, and a voltage lifts one, is arithmetic with the fitted works of adhesion.
GRIPS = Claim(
    "The goal is reached at each other humidity and grasp voltage", NOT_IN_PAPER, "one setting only", CONSTRUCTED
)
BALANCE = ("gripper.relative_humidity", "gripper.grasp_voltage")
"""Choices by which the balance of forces alone decides."""
CHANGES = Claim("Choices that change the time to the goal", NOT_IN_PAPER, "one setting only", PREDICTED)


def entries(plan: Plan) -> list[Entry]:
    """Runs of the default and of each choice; the number of robots is that of the default."""
    n_robots = robots_for(plan.config.arena, plan.genome.density_of_robots)
    repeats, steps = (3, 300) if plan.quick else (REPEATS, TIME_LIMIT)
    settings: list[tuple[dict[str, str], SwarmConfig]] = [
        ({"group": DEFAULT, "choice": DEFAULT, "value": ""}, plan.config)
    ]
    for group, choices in VARIATIONS.items():
        for name, others in choices[:1] if plan.quick else choices:
            for other in others:
                labels = {"group": group, "choice": name, "value": str(other)}
                settings.append((labels, varied(plan.config, {name: other})))
    settings = settings[:1] + [item for item in settings[1:] if item[1] != plan.config]
    listed = []
    for place, (labels, config) in enumerate(settings):
        for repeat in range(repeats):
            job = Job(config, plan.genome, n_robots, run_seed(plan.seed, place, repeat), steps, plan.goal)
            listed.append(Entry({**labels, "repeat": repeat}, job))
    return listed


class Change(NamedTuple):
    """What another value of a choice does to the time to the goal."""

    choice: str
    """As in `VARIATIONS`."""
    effect: Effect
    """Difference of the mean time from the default's; the note says how many runs reached the goal."""
    reaches: str
    """Verdict on whether most runs reach the goal."""
    p: float
    """Of the Mann-Whitney test."""
    adjusted: float
    """The same by Holm for the number of choices."""


def changes(rows: Rows) -> list[Change]:
    """What each choice does; runs that did not reach the goal count as the time limit."""
    usual = values(select(rows, choice=DEFAULT), TIME)
    listed = []
    for key in dict.fromkeys((row["group"], row["choice"], row["value"]) for row in rows if row["choice"] != DEFAULT):
        group, choice, value = key
        runs = select(rows, choice=choice, value=value)
        times, reached = values(runs, TIME), finished(runs)
        label, note = f"{choice.split('.')[1]} = {value}", f"{reached}/{len(runs)}"
        effect = Effect(group, label, difference(times, usual, mean), note)
        listed.append(Change(choice, effect, mostly(reached, len(runs)), compare(times, usual).p, 1.0))
    adjusted = holm([change.p for change in listed])
    return [change._replace(adjusted=p) for change, p in zip(listed, adjusted, strict=True)]


def findings(rows: Rows) -> list[Finding]:
    """Whether the goal is reached with all choices, and which change the time."""
    usual = select(rows, choice=DEFAULT)
    if not usual or len(rows) == len(usual):
        return [REACHES.not_run(), GRIPS.not_run(), CHANGES.not_run()]
    found = changes(rows)
    grips = [change for change in found if change.choice in BALANCE]
    rule = (
        f"goal of {usual[0]['goal']} balls within {usual[0]['max_steps']} steps, n = {len(usual)} each; holds if the "
        "exact 95 % interval of the share of runs that reach it lies above one half for each choice, does not if one "
        "lies below"
    )
    return [
        _reaches(REACHES, [change for change in found if change not in grips], rule),
        _reaches(GRIPS, grips, rule),
        _changes(found, usual),
    ]


def _reaches(claim: Claim, found: Sequence[Change], rule: str) -> Finding:
    """Whether the goal is reached with each of these choices."""
    if not found:
        return claim.not_run()
    good = sum(change.reaches == HOLDS for change in found)
    named = "; ".join(
        f"{change.effect.label}: {change.effect.note} runs" for change in found if change.reaches != HOLDS
    )
    ours = f"{good} of {len(found)} choices" + (f", not {named}" if named else "")
    return claim.found(ours, rule, all_of(change.reaches for change in found))


def _changes(found: Sequence[Change], usual: Rows) -> Finding:
    """The choices that change the time, by the raw p-values and by the adjusted ones; a list without a verdict."""
    raw = sorted((c for c in found if c.p < ALPHA), key=lambda c: -abs(c.effect.value.estimate))
    named = [
        f"{c.effect.label}: {_signed(c.effect.value)} steps (p = {number(c.p, 2)}, by Holm {number(c.adjusted, 2)})"
        for c in raw
    ]
    clear = sum(c.adjusted < ALPHA for c in raw)
    ours = f"{len(raw)} at p < {ALPHA:g}, {clear} of them after Holm's correction" + (
        f": {'; '.join(named)}" if raw else ""
    )
    default = interval(values(usual, TIME))
    said = (
        f"difference of the mean time from the default's {number(default.estimate)} steps with 95 % interval, runs "
        f"that did not reach the goal counted as {usual[0]['max_steps']}; Mann-Whitney, corrected for {len(found)} "
        f"choices, n = {len(usual)} each; all with {usual[0]['n_robots']} robots"
    )
    return CHANGES.found(ours, said, "")


def draw(rows: Rows, out: Path) -> list[Path]:
    """Draw the effects in the manner of a forest plot."""
    listed = [change.effect._replace(label=f"{change.effect.label}{_unit(change.choice)}") for change in changes(rows)]
    if not listed:
        return []
    label = "mean time minus that of the default [steps], 95 % interval\nat the right edge: runs that reached the goal"
    usual = select(rows, choice=DEFAULT)
    caption = (
        f"n = {len(usual)} runs each; 95 % intervals of the difference of means, by bootstrap.\n"
        f"Runs that did not reach the goal count as {usual[0]['max_steps']} steps. {TESTS}"
    )
    return [draw_forest(listed, label, out / "sensitivity", caption)]


def _unit(choice: str) -> str:
    """Unit of a setting, as `arena.size`, with a space before it; empty without one."""
    group, name = choice.split(".")
    constraint = constraint_of(type(getattr(SwarmConfig(), group)), name)
    return f" {constraint.unit}" if constraint and constraint.unit else ""


def _signed(value: Interval) -> str:
    return f"{value.estimate:+.0f} ({value.low:+.0f} to {value.high:+.0f})"


EXPERIMENT = Experiment(
    name="sensitivity",
    title="each choice that the paper leaves open, one at a time about the default, 10 runs each",
    source=NOT_IN_PAPER,
    entries=entries,
    findings=findings,
    draw=draw,
)
