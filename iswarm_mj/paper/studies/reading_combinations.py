"""Combinations of readings of the paper's rules, and their runs on all figures of section 4.6.

The experiment `infer` asks which readings agree with the paper's numbers.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import cache
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import qmc

from iswarm_mj.config.swarm import INTERPRETATIONS, SwarmConfig
from iswarm_mj.paper.analysis.measures import EVOLUTION_STEPS
from iswarm_mj.paper.studies.experiment import (
    TIME_LIMIT,
    Overrides,
    Plan,
    Setting,
    Values,
    varied,
)
from iswarm_mj.paper.studies.settings import DENSITIES, robots_of_figure_17
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.tasks.layout import robots_for

N_COMBINATIONS = 512
"""Number of combinations in the sample."""
N_QUICK_COMBINATIONS = 8
"""Number of combinations in the sample of the quick version."""
NAMED_READINGS = ("paper", "initial")
"""Readings that are run beside the sample."""
NAMED_REPEATS = 12
"""Runs of each setting for the named readings, and for the paper's with one value changed."""

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
    "photodiode_aperture": {"90 deg": {}, "60 deg": {"optics.photodiode_aperture": 60.0}},
}
"""Factors, by the names of their columns: labels of the readings that are tried, and the values of
settings that they stand for."""


def _default_label(labels: Mapping[str, Values]) -> str:
    """Return the label of a factor that stands for the default."""
    default = SwarmConfig()
    return next(label for label, values in labels.items() if varied(default, values) == default)


DEFAULT_LABELS = {factor: _default_label(labels) for factor, labels in FACTORS.items()}
"""Label of the default, by factors."""
SINGLE_CHANGES = [
    (factor, label)
    for factor, labels in FACTORS.items()
    for label in labels
    if label != DEFAULT_LABELS[factor]
]
"""Labels that the paper's reading is run with, one at a time, with their factors."""


class FigureSetting(NamedTuple):
    """A setting of one of the paper's figures or tables."""

    study: str
    """Experiment of the figure."""
    setting: str
    """Name of the setting in it."""
    genome: Genome
    """Genome of the swarm."""
    density: float
    """Density [robots per cell]."""
    limit: int
    """Maximum number of control steps."""


def _figure_settings() -> Iterator[FigureSetting]:
    """Yield the settings of Figs. 15 and 17 and of Table 2."""
    for name in ("with", "without"):
        genome = Genome(use_hop_count=name == "with")
        density = Genome().density_of_robots
        yield FigureSetting("hop-count", name, genome, density, TIME_LIMIT)
    for density in DENSITIES:
        yield FigureSetting("density", f"{density:g}", Genome(), density, TIME_LIMIT)
    for name in ("type1", "type2"):
        genome = PRESETS[name]
        yield FigureSetting("types", name, genome, genome.density_of_robots, EVOLUTION_STEPS)


FIGURE_SETTINGS = tuple(_figure_settings())
"""Settings that each combination is run on, of Figs. 15 and 17 and Table 2."""


def sample_combinations(n: int, seed: int) -> list[dict[str, str]]:
    """Draw combinations by a Latin hypercube: each label comes equally often, but for one.

    Source: McKay, Beckman and Conover (1979), Technometrics 21, 239.

    Args:
        n: number of combinations.
        seed: seed of the random numbers.

    Returns:
        Labels of each combination, by factors.
    """
    points = qmc.LatinHypercube(len(FACTORS), rng=np.random.default_rng(seed)).random(n)
    combinations = []
    for point in points:
        combination = {}
        for (factor, levels), coordinate in zip(FACTORS.items(), point, strict=True):
            labels = list(levels)
            combination[factor] = labels[int(coordinate * len(labels))]
        combinations.append(combination)
    return combinations


def combination_settings(plan: Plan) -> Iterator[Setting]:
    """Yield runs of all combinations, of the named readings, and of single changes.

    The named readings, and the paper's with one value changed, are not part of the sample and have
    negative numbers.
    """
    no_labels = dict.fromkeys(FACTORS)
    repeats: Overrides = {"repeats": NAMED_REPEATS}

    n_named = len(NAMED_READINGS)
    for index, name in enumerate(NAMED_READINGS):
        labels = {**no_labels, "combination": index - n_named, "reading": name}
        config = _named_config(plan, name)
        yield from _on_all_figures(plan, config, labels, layouts=index, overrides=repeats)

    n_combinations = N_QUICK_COMBINATIONS if plan.quick else N_COMBINATIONS
    for index, combination in enumerate(sample_combinations(n_combinations, plan.seed)):
        labels = {**combination, "combination": index, "reading": None}
        config = varied(plan.config, _values_of_combination(combination))
        yield from _on_all_figures(plan, config, labels, layouts=index + n_named, overrides={})

    # The paper's reading is the first of the named ones: these start from its layouts.
    for index, (factor, label) in enumerate(SINGLE_CHANGES[:2] if plan.quick else SINGLE_CHANGES):
        combination_number = -1 - n_named - index
        labels = {
            **no_labels,
            factor: label,
            "combination": combination_number,
            "reading": "paper",
        }
        config = varied(_named_config(plan, "paper"), FACTORS[factor][label])
        yield from _on_all_figures(plan, config, labels, layouts=0, overrides=repeats)


def _values_of_combination(combination: Mapping[str, str]) -> Values:
    """Return the values of settings that the labels of a combination stand for."""
    values: dict[str, Any] = {}
    for factor, label in combination.items():
        values.update(values_of_label(factor, label))
    return values


@cache
def values_of_label(factor: str, label: str) -> Values:
    """Return the values of settings that a label stands for.

    Those that are the default's are among them, so that other values of a plan are overridden.
    """
    names = {name for values in FACTORS[factor].values() for name in values}
    defaults = {name: attrgetter(name)(SwarmConfig()) for name in names}
    return defaults | dict(FACTORS[factor][label])


def _named_config(plan: Plan, name: str) -> SwarmConfig:
    """Return a named reading in the arena of the plan, but with its own distance of the dust."""
    reading = INTERPRETATIONS[name]
    arena = replace(plan.config.arena, dust_area_offset=reading.arena.dust_area_offset)
    return replace(reading, arena=arena)


def _on_all_figures(
    plan: Plan,
    config: SwarmConfig,
    labels: Mapping[str, Any],
    layouts: int,
    overrides: Overrides,
) -> Iterator[Setting]:
    """Yield the runs of one configuration on all `FIGURE_SETTINGS`.

    Args:
        plan: settings of the experiment.
        config: the configuration.
        labels: labels of the combination.
        layouts: number from which the seeds follow; configurations that share it start from the
            same layouts.
        overrides: further overrides of all runs.
    """
    for index, figure in enumerate(FIGURE_SETTINGS):
        if figure.study == "density":
            n_robots = robots_of_figure_17(config.arena, figure.density)
        else:
            n_robots = robots_for(config.arena, figure.density)
        figure_overrides: Overrides = {
            "config": config,
            "genome": figure.genome,
            "n_robots": n_robots,
            "limit": figure.limit,
        }
        if plan.quick or figure.study == "types":
            figure_overrides["goal"] = None

        figure_labels = {
            **labels,
            "study": figure.study,
            "setting": figure.setting,
            "density": figure.density,
        }
        yield Setting(figure_labels, (layouts, index), {**figure_overrides, **overrides})
