"""Which readings of the rules agree with the paper's numbers: many combinations, each run on all of section 4.6."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import qmc

from iswarm_mj.config import READINGS, SwarmConfig
from iswarm_mj.experiments.analysis.findings import (
    NOT_COMPARABLE,
    NOT_IN_PAPER,
    PREDICTED,
    TOO_FEW,
    Finding,
    Rows,
    number,
    short,
)
from iswarm_mj.experiments.analysis.measures import STEPS, by, select
from iswarm_mj.experiments.analysis.plots_of_searches import draw_support
from iswarm_mj.experiments.analysis.statements import ASKED, penalty_error
from iswarm_mj.experiments.analysis.statistics import Interval
from iswarm_mj.experiments.analysis.support import (
    Combination,
    accepted,
    answers,
    chances,
    counts_alone,
    gives_way,
    support,
)
from iswarm_mj.experiments.runner.experiment import TIME_LIMIT, Entry, Experiment, Plan, run_seed
from iswarm_mj.experiments.runner.jobs import Job
from iswarm_mj.experiments.runner.variation import Values, varied
from iswarm_mj.experiments.studies.plans import DENSITIES
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.tasks.layout import robots_for

COMBINATIONS = 512
LEAST_COMBINATIONS = 20
"""Of which the share `support.ACCEPTED` can be accepted."""
NAMED = ("paper", "initial")
"""Readings that are run beside the sample."""
NAMED_REPEATS = 12
"""Runs of each setting for these, and for the paper's with one value changed."""

FACTORS: Mapping[str, Mapping[str, Values]] = {
    "avoidance_sides": {"front": {}, "all": {"strategy.avoidance_sides": "all"}},
    "avoidance_course": {
        "any": {},
        "crossing": {"strategy.avoidance_course": "crossing"},
        "oncoming": {"strategy.avoidance_course": "oncoming"},
    },
    "priority_repulsion": {"higher": {}, "scaled": {"strategy.priority_repulsion": "scaled"}},
    "avoids_at_dust": {"no": {}, "yes": {"strategy.avoids_at_dust": True}},
    "locations": {"free": {}, "cells": {"drive.locations": "cells"}},
    "stops": {"none": {}, "25 %": {"drive.stop_share": 0.25}, "50 %": {"drive.stop_share": 0.5}},
    "turns": {"none": {}, "half a step": {"drive.turn_share": 0.5}, "a step": {"drive.turn_share": 1.0}},
    "loaded_speed": {"100 %": {}, "50 %": {"drive.loaded_speed": 0.5}},
    "sensing_errors": {"none": {}, "10 %": {"strategy.error_in_sensing": 0.1}},
    "random_turn": {f"{turn:g} deg": {"strategy.random_turn": turn} for turn in (30.0, 90.0, 180.0)},
    "max_turn": {"90 deg": {}, "180 deg": {"drive.max_turn": 180.0, "drive.turn_substeps": 6}},
    "avoidance_gain": {f"{gain:g}": {"strategy.avoidance_gain": gain} for gain in (2.0, 8.0, 32.0)},
    "forget_on_arrival": {"yes": {}, "no": {"strategy.forget_on_arrival": False}},
    "scouts_pick": {"no": {}, "yes": {"strategy.scouts_pick": True}},
    "bit_errors": {
        "one, noticed": {},
        "independent, noticed if odd": {"optics.independent_bit_errors": True},
        "one, not noticed": {"optics.parity_check": False},
    },
    "drops": {"none": {}, "1 % a step": {"gripper.drop_rate": 0.01}},
    "odometry": {
        "exact": {},
        "10 deg, 10 %": {"strategy.odometry_error_turn": 10.0, "strategy.odometry_error_step": 0.1},
    },
    "actuators": {"exact": {}, "10 deg, 10 %": {"drive.error_turn": 10.0, "drive.error_step": 0.1}},
    "dust_offset": {f"{offset:g} rd": {"arena.dust_area_offset": offset} for offset in (12.0, 16.0, 20.0)},
    "dust_size": {f"{size:g} rd": {"arena.dust_area_size": size} for size in (4.0, 6.0, 8.0)},
    "dump_size": {f"{size:g} rd": {"arena.dump_size": size} for size in (4.0, 5.0, 7.0)},
}
"""Readings that are tried, by the names of their columns: labels, and the settings that they stand for."""
DEFAULTS = {
    name: next(label for label, settings in levels.items() if varied(SwarmConfig(), settings) == SwarmConfig())
    for name, levels in FACTORS.items()
}
"""Label of the default."""
ALONE = [(name, label) for name, levels in FACTORS.items() for label in levels if label != DEFAULTS[name]]
"""Values that the paper's reading is run with, one at a time."""


class Setting(NamedTuple):
    """What each combination is run on."""

    study: str
    setting: str
    genome: Genome
    density: float
    steps: int
    all_balls: bool
    """The run ends with the last ball, not with the 66th of 72."""


SETTINGS = (
    *(
        Setting("hop-count", name, Genome(use_hop_count=flag), Genome().density_of_robots, TIME_LIMIT, False)
        for name, flag in (("with", True), ("without", False))
    ),
    *(Setting("density", f"{density:g}", Genome(), density, TIME_LIMIT, False) for density in DENSITIES),
    *(
        Setting("types", name, PRESETS[name], PRESETS[name].density_of_robots, STEPS, True)
        for name in ("type1", "type2")
    ),
)
"""Figs. 15 and 17 and Table 2."""


def design(n: int, seed: int) -> list[dict[str, str]]:
    """Labels of n combinations, a Latin hypercube over the factors: each label comes equally often, but for one.

    Source: McKay, Beckman and Conover (1979), Technometrics 21, 239.
    """
    drawn = qmc.LatinHypercube(len(FACTORS), rng=np.random.default_rng(seed)).random(n)
    return [
        {name: list(levels)[int(u * len(levels))] for (name, levels), u in zip(FACTORS.items(), row, strict=True)}
        for row in drawn
    ]


def entries(plan: Plan) -> list[Entry]:
    """Runs of all combinations; and of the named readings, and of the paper's with one value changed, which are not
    part of the sample and have negative numbers."""
    n, named = (8, 1) if plan.quick else (COMBINATIONS, NAMED_REPEATS)
    listed = []
    for place, name in enumerate(NAMED):
        labels = dict.fromkeys(FACTORS) | {"combination": place - len(NAMED), "reading": name}
        listed += _runs(plan, _named(plan, name), labels, place, named)
    for place, labels in enumerate(design(n, plan.seed)):
        settings = {key: value for label in labels.items() for key, value in settings_of(*label).items()}
        config = varied(plan.config, settings)
        labels = {**labels, "combination": place, "reading": None}
        listed += _runs(plan, config, labels, place + len(NAMED), 1)
    for place, (name, label) in enumerate(ALONE[:2] if plan.quick else ALONE):
        number_of = -1 - len(NAMED) - place
        labels = dict.fromkeys(FACTORS) | {name: label, "combination": number_of, "reading": "paper"}
        paper = NAMED.index("paper")
        listed += _runs(plan, varied(_named(plan, "paper"), FACTORS[name][label]), labels, paper, named)
    return listed


@cache
def settings_of(factor: str, label: str) -> Values:
    """Settings that a label stands for, those that are the default's, too, so that a plan of others is overridden."""
    names = {name for settings in FACTORS[factor].values() for name in settings}
    return {name: attrgetter(name)(SwarmConfig()) for name in names} | dict(FACTORS[factor][label])


def _named(plan: Plan, name: str) -> SwarmConfig:
    """A named reading in the arena of the plan, but for the distance of the dust."""
    offset = READINGS[name].arena.dust_area_offset
    return replace(READINGS[name], arena=replace(plan.config.arena, dust_area_offset=offset))


def _runs(plan: Plan, config: SwarmConfig, labels: Mapping[str, Any], seeds: int, repeats: int) -> list[Entry]:
    """Runs of one configuration on all settings; those with the same number of `seeds` meet the same layouts."""
    listed = []
    for place, (study, setting, genome, density, steps, all_balls) in enumerate(SETTINGS):
        n_robots = robots_for(config.arena, density)
        for repeat in range(repeats):
            seed = run_seed(plan.seed, seeds, place, repeat)
            limit, goal = (100, None) if plan.quick else (steps, None if all_balls else plan.goal)
            row = {**labels, "study": study, "setting": setting, "density": density, "repeat": repeat}
            listed.append(Entry(row, Job(config, genome, n_robots, seed, limit, goal)))
    return listed


def combinations_of(rows: Rows) -> list[Combination]:
    """Combinations, named readings and the paper's with one value changed, with their answers, from the table."""
    listed = []
    for runs in by(rows, "combination").values():
        labels, layouts = {name: runs[0][name] for name in FACTORS}, sorted(by(runs, "repeat").items())
        each = [answers(mine) for _, mine in layouts]
        held = answers(runs) if len(each) > 1 else each[0]
        others = answers(runs, selects=False)
        types = [{**row, "type": row["setting"]} for row in select(runs, study="types")]
        single = [sum(one) for one in each]
        listed.append(Combination(runs[0]["reading"], labels, held, penalty_error(types), single, others))
    return listed


def supported(sample: list[Combination]) -> dict[str, dict[str, Interval]]:
    """Support of the labels of all factors by the accepted combinations of a sample."""
    kept = accepted(sample)
    return {name: support(sample, kept, name, list(levels)) for name, levels in FACTORS.items()}


def findings(rows: Rows) -> list[Finding]:
    """How many statements are reproduced, by how many combinations, and which choices they support."""
    best = Finding("Combinations of readings that reproduce the paper's statements", "section 4.6", "all", PREDICTED)
    if not rows:
        return [best]
    every = combinations_of(rows)
    sample, named = [c for c in every if c.reading is None], [c for c in every if c.is_named]
    kept = accepted(sample)
    counts = [sum(c.answers) for c in sample]
    most, total, others = max(counts), len(sample[0].answers), len(sample[0].held_out)
    said = "; ".join(
        f"{c.reading} {sum(c.answers)} of {total}, and of those held out {sum(c.held_out)} of {others}" for c in named
    )
    apart = [float(np.mean([sum(c.held_out) for c in group])) for group in (kept, sample)]
    rule = (
        f"{len(sample)} combinations drawn from {len(FACTORS)} readings; the {len(kept)} that miss the fewest "
        "statements that select are accepted (approximate Bayesian computation by rejection); of equals those nearer "
        "in the penalties of both types"
    )
    ours = f"at most {most} of {total}, by {counts.count(most)}; median {number(float(np.median(counts)))}; {said}"
    ours += f"; held out, mean of {others}: accepted {number(apart[0])}, all {number(apart[1])}"
    verdict = "" if len(sample) >= LEAST_COMBINATIONS else TOO_FEW
    listed = [best._replace(ours=ours, statistics=rule, verdict=verdict)]
    by_factor = chances(sample, kept, {name: list(levels) for name, levels in FACTORS.items()})
    for name, shares in supported(sample).items():
        text = "; ".join(f"{label}: {short(share, '%')}" for label, share in shares.items())
        alone = counts_alone(every, name, DEFAULTS[name])
        if other := gives_way(DEFAULTS[name], shares, alone):
            text += f"; by the rule, {DEFAULTS[name]} gives way to {other}"
        p, adjusted = by_factor[name]
        prior = (
            f"share of the accepted combinations, of which {number(100 / len(FACTORS[name]))} % without any support; "
            f"Wilson; exact multinomial p = {number(p, 2)}, {number(adjusted, 2)} by Holm for {len(FACTORS)} readings; "
            f"of `paper` with one value hold, of those that select: "
            f"{', '.join(f'{label} {n}' for label, n in alone.items())}"
        )
        claim = f"Support of {name.replace('_', ' ')}"
        listed.append(Finding(claim, NOT_IN_PAPER, "not stated", NOT_COMPARABLE, text, prior, verdict))
    return listed


def draw(rows: Rows, path: Path) -> None:
    """Draw how many statements are reproduced, and the support of each choice."""
    every = [c for c in combinations_of(rows) if c.reading is None or c.is_named]
    texts = sorted(ASKED, key=lambda text: not ASKED[text].selects)  # those that select first
    draw_support(every, supported([c for c in every if c.reading is None]), texts, path)


EXPERIMENT = Experiment(
    name="infer",
    title=f"{COMBINATIONS} combinations of readings on Figs. 15 and 17 and both types",
    source="section 4.6",
    entries=entries,
    findings=findings,
    figure=draw,
)
