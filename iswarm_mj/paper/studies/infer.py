"""Which readings of the rules agree with the paper's numbers: the runs of many combinations on all
of section 4.6."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from operator import attrgetter
from typing import Any

import numpy as np
from scipy.stats import qmc

from iswarm_mj.config.swarm import INTERPRETATIONS, SwarmConfig
from iswarm_mj.paper.analysis.measures import STEPS
from iswarm_mj.paper.studies.experiment import TIME_LIMIT, Plan, Setting, Values, varied
from iswarm_mj.paper.studies.plans import DENSITIES
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.tasks.layout import robots_for

COMBINATIONS = 512
NAMED, NAMED_REPEATS = ("paper", "initial"), 12
"""Readings beside the sample, and runs of each setting for these and for the paper's with one value
changed."""

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
    "turns": {
        "none": {},
        "half a step": {"drive.turn_share": 0.5},
        "a step": {"drive.turn_share": 1.0},
    },
    "loaded_speed": {"100 %": {}, "50 %": {"drive.loaded_speed": 0.5}},
    "sensing_errors": {"none": {}, "10 %": {"strategy.error_in_sensing": 0.1}},
    "random_turn": {
        f"{turn:g} deg": {"strategy.random_turn": turn} for turn in (30.0, 90.0, 180.0)
    },
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
    "dust_offset": {
        f"{offset:g} rd": {"arena.dust_area_offset": offset} for offset in (12.0, 16.0, 20.0)
    },
    "dust_size": {f"{size:g} rd": {"arena.dust_area_size": size} for size in (4.0, 6.0, 8.0)},
    "dump_size": {f"{size:g} rd": {"arena.dump_size": size} for size in (4.0, 5.0, 7.0)},
}
"""Readings that are tried, by the names of their columns: labels, and the settings that they stand
for."""
DEFAULTS = {
    name: next(
        label
        for label, settings in levels.items()
        if varied(SwarmConfig(), settings) == SwarmConfig()
    )
    for name, levels in FACTORS.items()
}
"""Label of the default."""
ALONE = [
    (name, label) for name, levels in FACTORS.items() for label in levels if label != DEFAULTS[name]
]
"""Values that the paper's reading is run with, one at a time."""
SETTINGS = (
    *(
        (
            "hop-count",
            name,
            Genome(use_hop_count=name == "with"),
            Genome().density_of_robots,
            TIME_LIMIT,
        )
        for name in ("with", "without")
    ),
    *(("density", f"{density:g}", Genome(), density, TIME_LIMIT) for density in DENSITIES),
    *(
        ("types", name, PRESETS[name], PRESETS[name].density_of_robots, STEPS)
        for name in ("type1", "type2")
    ),
)
"""What each combination is run on, Figs. 15 and 17 and Table 2: study, setting, genome, density,
steps."""


def design(n: int, seed: int) -> list[dict[str, str]]:
    """Labels of n combinations, a Latin hypercube over the factors: each label comes equally often,
    but for one.

    Source: McKay, Beckman and Conover (1979), Technometrics 21, 239.
    """
    drawn = qmc.LatinHypercube(len(FACTORS), rng=np.random.default_rng(seed)).random(n)
    return [
        {
            name: list(levels)[int(u * len(levels))]
            for (name, levels), u in zip(FACTORS.items(), row, strict=True)
        }
        for row in drawn
    ]


def settings(plan: Plan) -> Iterator[Setting]:
    """Runs of all combinations; and of the named readings, and of the paper's with one value
    changed, which are not part of the sample and have negative numbers. Runs in the same place meet
    the same layouts."""
    none, each = dict.fromkeys(FACTORS), {"repeats": NAMED_REPEATS}
    for place, name in enumerate(NAMED):
        labels = {**none, "combination": place - len(NAMED), "reading": name}
        yield from _of(plan, _named(plan, name), labels, place, each)
    for place, labels in enumerate(design(8 if plan.quick else COMBINATIONS, plan.seed)):
        config = varied(
            plan.config, {k: v for label in labels.items() for k, v in settings_of(*label).items()}
        )
        yield from _of(
            plan, config, {**labels, "combination": place, "reading": None}, place + len(NAMED), {}
        )
    for place, (name, label) in enumerate(ALONE[:2] if plan.quick else ALONE):
        labels = {**none, name: label, "combination": -1 - len(NAMED) - place, "reading": "paper"}
        yield from _of(plan, varied(_named(plan, "paper"), FACTORS[name][label]), labels, 0, each)


@cache
def settings_of(factor: str, label: str) -> Values:
    """Settings that a label stands for, those that are the default's, too, so that a plan of others
    is overridden."""
    names = {name for settings in FACTORS[factor].values() for name in settings}
    return {name: attrgetter(name)(SwarmConfig()) for name in names} | dict(FACTORS[factor][label])


def _named(plan: Plan, name: str) -> SwarmConfig:
    """A named reading in the arena of the plan, but for the distance of the dust."""
    offset = INTERPRETATIONS[name].arena.dust_area_offset
    return replace(INTERPRETATIONS[name], arena=replace(plan.config.arena, dust_area_offset=offset))


def _of(
    plan: Plan, config: SwarmConfig, labels: Mapping[str, Any], seeds: int, each: Mapping[str, Any]
) -> Iterator[Setting]:
    """One configuration on all `SETTINGS`."""
    for place, (study, setting, genome, density, limit) in enumerate(SETTINGS):
        own = {
            "config": config,
            "genome": genome,
            "n_robots": robots_for(config.arena, density),
            "limit": limit,
        }
        if plan.quick or study == "types":
            own["goal"] = None
        yield (
            {**labels, "study": study, "setting": setting, "density": density},
            (seeds, place),
            {**own, **each},
        )
