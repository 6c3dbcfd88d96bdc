"""Settings of the experiments: labels of their runs, seeds, and what differs between the runs."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import Any

from iswarm_mj.config.arena import ArenaConfig
from iswarm_mj.paper.analysis.measures import PAPER_FITNESS
from iswarm_mj.paper.analysis.varied_values import (
    BALANCE,
    DEFAULT,
    HUMIDITIES,
    INSTANT_MESSAGES,
    SUBSTEPS,
    SWARMS,
    TRIALS,
    VOLTAGES,
    drive_with_rate,
    refused_rates,
)
from iswarm_mj.paper.studies.experiment import Overrides, Plan, Setting, Values, varied
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.tasks.layout import robots_for

DENSITIES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4)
"""Densities [robots per cell]; the paper gives the ends."""
QUICK_DENSITIES = (0.05, 0.1, 0.2, 0.4)
"""Densities of the quick version [robots per cell]."""
FRACTIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
"""Fractions of the robots that fail."""
QUICK_FRACTIONS = (0.0, 0.3, 0.5)
"""Fractions of the robots that fail, in the quick version."""
QUICK_RATES = (10, 50)
"""Numbers of physics steps in a control step, in the quick version."""
MESSAGES: dict[str, Values] = {
    INSTANT_MESSAGES: {"optics.baud_rate": 0.0},
    "30000 bit/s": {"optics.baud_rate": 30000.0},
    "2000 bit/s": {"optics.baud_rate": 2000.0},
    "1000 bit/s": {"optics.baud_rate": 1000.0},
    "30000 bit/s, all photodiodes on": {
        "optics.baud_rate": 30000.0,
        "optics.photodiodes_while_emitting": "all",
    },
}
"""Values of the light by the settings of the study of message times.

The paper tells no rate of its robots. Kilobots, robots of 33 mm, send at 8 MHz / 269 = 29.7 kbit/s
(kilolib, message_send.S). With the default 8 slots, 427 bit/s leave no time to walk; the rates
between are choices.
"""
TYPE_REPEATS = 96
"""Runs of each of the paper's types: their times scatter by a fifth, and 24 runs could not show
that two are equal."""
ATTEMPT_VALUES: Values = {
    "gripper.tool_error": 4e-6,
    "gripper.grasp_time": 1.0,
    "gripper.release_time": 1.0,
}
"""Values of the study of grasps, in which adhesion also scatters as calibrated, by default. A robot
stays for a control step at a ball that it lifts or releases: a choice, the paper gives no time."""

CHOICES: Mapping[str, Mapping[str, tuple[Any, ...]]] = {
    "scene": {
        "strategy.dust_range": (0.5, 1.0),
        "arena.dump_size": (4.0, 7.0),
        "arena.dust_area_size": (4.0, 9.0),
        "arena.dust_area_offset": (16.0, 20.0),
    },
    "light": {
        "optics.photodiode_aperture": (60.0,),
        "optics.communication_radius": (3.0, 4.0),
        "optics.line_of_sight": (False,),
        "optics.mode": ("power",),
        "optics.wall_range": (0.75, 3.0),
    },
    "noise": {
        "optics.error_distance_measure": (0.0, 0.2),
        "optics.error_in_communication": (0.0, 0.2),
        "optics.independent_bit_errors": (True,),
        "optics.p_communication_break": (0.0, 0.2),
    },
    "gripper": {
        "gripper.drop_rate": (0.01, 0.05),
        "gripper.relative_humidity": (30.0, 50.0),
        "gripper.grasp_voltage": (30.0, 50.0),
        "gripper.tool_reach": (0.1e-3, 0.5e-3),
    },
    "strategy": {
        "strategy.scouts_pick": (True,),
        "strategy.forget_on_arrival": (False,),
        "strategy.random_turn": (10.0, 90.0),
        "strategy.avoidance_gain": (2.0, 32.0),
        "strategy.priority_factor": (1.0, 4.0),
        "strategy.wall_gain": (0.0, 8.0),
        "strategy.message_range": (25.0, 98.0),
    },
    "motion": {"drive.max_turn": (45.0, 120.0)},
    "update order": {"strategy.update_order": ("sequential",)},
    "readings": {
        "strategy.avoidance_sides": ("front", "all"),
        "strategy.avoidance_course": ("crossing", "oncoming"),
        "strategy.priority_repulsion": ("higher", "scaled"),
        "strategy.avoids_at_dust": (True,),
        "optics.parity_check": (False,),
        "strategy.odometry_error_turn": (10.0,),
        "strategy.odometry_error_step": (0.1,),
        "drive.error_turn": (10.0,),
        "drive.error_step": (0.1,),
        "drive.locations": ("free", "cells"),
        "drive.stop_share": (0.25, 0.5),
        "drive.turn_share": (0.5, 1.0),
        "drive.loaded_speed": (0.5,),
        "strategy.error_in_sensing": (0.1,),
    },
}
"""Values that are tried one at a time, by groups of choices; those that are the default's are left
out. The paper's own values (Table 1) are varied too where they are noise.

A run's seed follows from its place among those that are not left out. So whatever is added comes at
the very end, and a change of a default moves the seeds of the choices that come after it.
"""


def _genomes_by_hop_counts(genome: Genome) -> list[tuple[bool, Genome]]:
    """Return a genome with and without hop counts, and whether it has them."""
    return [(flag, replace(genome, use_hop_count=flag)) for flag in (True, False)]


def hop_count_settings(plan: Plan) -> Iterator[Setting]:
    """Yield runs with and without hop counts."""
    for use_hop_count, genome in _genomes_by_hop_counts(plan.genome):
        labels = {"use_hop_count": use_hop_count}
        yield Setting(labels, (int(use_hop_count),), {"genome": genome})


def density_settings(plan: Plan) -> Iterator[Setting]:
    """Yield runs of all densities."""
    for density in QUICK_DENSITIES if plan.quick else DENSITIES:
        overrides: Overrides = {"n_robots": robots_of_figure_17(plan.config.arena, density)}
        yield Setting({"density": density}, (round(1000 * density),), overrides)


def robots_of_figure_17(arena: ArenaConfig, density: float) -> int:
    """Return the number of robots of Fig. 17: a share of all cells, those of the dump included.

    Section 4.6.2: "49 x 49 = 2401 possible robot locations, 2401 x 0.4 = 960 robots in the swarm".
    The numbers of robots in Table 2 leave the dump out, as `robots_for` does by default.
    """
    return robots_for(arena, density, with_dump=True)


def type_settings(plan: Plan) -> Iterator[Setting]:
    """Yield runs of all presets, each at its genome's density, until all balls are delivered.

    A goal of None stands for all balls, see `Overrides`.
    """
    for index, (name, genome) in enumerate(PRESETS.items()):
        overrides: Overrides = {"genome": genome, "goal": None}
        if name in PAPER_FITNESS:
            overrides["repeats"] = TYPE_REPEATS
        yield Setting({"type": name}, (index,), overrides)


def sensitivity_settings(plan: Plan) -> Iterator[Setting]:
    """Yield runs of the default and of each choice.

    All have the number of robots of the plan's genome in the plan's arena.
    """
    default_labels = {"group": DEFAULT, "choice": DEFAULT, "value": ""}
    variants = [(default_labels, plan.config)]
    for group, choices in CHOICES.items():
        # The quick version takes the first choice of each group.
        names = list(choices)[:1] if plan.quick else list(choices)
        for name in names:
            for value in choices[name]:
                config = varied(plan.config, {name: value})
                if config != plan.config:
                    labels = {"group": group, "choice": name, "value": str(value)}
                    variants.append((labels, config))

    for index, (labels, config) in enumerate(variants):
        yield Setting(labels, (index,), {"config": config})


def robustness_settings(plan: Plan) -> Iterator[Setting]:
    """Yield runs with fractions of the robots dead, and with the same fractions left out."""
    fractions = QUICK_FRACTIONS if plan.quick else FRACTIONS
    for fraction in fractions:
        labels = {"kind": "dead", "fraction": fraction}
        yield Setting(labels, (1, round(1000 * fraction)), {"failed_fraction": fraction})

    # Without any robot left out, the runs would be those without a dead one.
    n_robots = robots_for(plan.config.arena, plan.genome.density_of_robots)
    for fraction in fractions[1:]:
        labels = {"kind": "absent", "fraction": fraction}
        n_present = n_robots - round(fraction * n_robots)
        yield Setting(labels, (0, round(1000 * fraction)), {"n_robots": n_present})


def time_step_settings(plan: Plan) -> Iterator[Setting]:
    """Yield runs of both types with all numbers of physics steps that the drive allows."""
    refused = refused_rates(plan.config.drive)
    rates = [rate for rate in (QUICK_RATES if plan.quick else SUBSTEPS) if rate not in refused]
    for index, swarm in enumerate(SWARMS):
        for rate in rates:
            config = replace(plan.config, drive=drive_with_rate(plan.config.drive, rate))
            labels = {"type": swarm, "rate": rate}
            overrides: Overrides = {"config": config, "genome": PRESETS[swarm]}
            yield Setting(labels, (index, rate), overrides)


def message_time_settings(plan: Plan) -> Iterator[Setting]:
    """Yield runs with and without hop counts at several baud rates.

    Robots stop to emit, and disturb each other.
    """
    for name, values in MESSAGES.items():
        config = varied(plan.config, values)

        # The baud rate, and one more for each value beside it, tells the seeds apart.
        number = int(values["optics.baud_rate"]) + (len(values) - 1)
        for use_hop_count, genome in _genomes_by_hop_counts(plan.genome):
            labels = {"setting": name, "use_hop_count": use_hop_count}
            overrides: Overrides = {"config": config, "genome": genome}
            yield Setting(labels, (number, int(use_hop_count)), overrides)


def resolved_grasps_settings(plan: Plan) -> Iterator[Setting]:
    """Yield pairs of runs with the same seed, of both types at all humidities and voltages.

    Grasps of one are trials on the bench, those of the other are decided by the balance of forces.
    """
    humidities = HUMIDITIES[-1:] if plan.quick else HUMIDITIES
    voltages = VOLTAGES[::2] if plan.quick else VOLTAGES
    conditions = product(enumerate(SWARMS), humidities, voltages)
    for (index, swarm), humidity, voltage in conditions:
        for resolution in (BALANCE, TRIALS):
            gripper = {
                "relative_humidity": humidity,
                "grasp_voltage": voltage,
                "resolution": resolution,
            }
            gripper_values = {f"gripper.{name}": value for name, value in gripper.items()}
            config = varied(plan.config, {**ATTEMPT_VALUES, **gripper_values})
            seed_path = (index, round(humidity), round(voltage))
            overrides: Overrides = {"config": config, "genome": PRESETS[swarm]}
            yield Setting({"type": swarm, **gripper}, seed_path, overrides)
