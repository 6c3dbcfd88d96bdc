"""The settings of the studies: what their runs are labelled with, and the place from which their
seeds follow."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import product
from typing import Any

from iswarm_mj.paper.analysis.measures import PAPER_FITNESS
from iswarm_mj.paper.analysis.statements import (
    BALANCE,
    DEFAULT,
    HUMIDITIES,
    INSTANT,
    SUBSTEPS,
    SWARMS,
    TRIALS,
    VOLTAGES,
    drive_of,
    refusals,
)
from iswarm_mj.paper.studies.experiment import Plan, Setting, Values, varied
from iswarm_mj.strategy.genome import PRESETS, Genome
from iswarm_mj.tasks.layout import robots_for

DENSITIES = (0.05, 0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4)
"""Robots per cell; the paper gives the ends."""
FRACTIONS = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
"""Of the robots that fail."""
MESSAGES: dict[str, Values] = {
    INSTANT: {"optics.baud_rate": 0.0},
    "30000 bit/s": {"optics.baud_rate": 30000.0},
    "2000 bit/s": {"optics.baud_rate": 2000.0},
    "1000 bit/s": {"optics.baud_rate": 1000.0},
    "30000 bit/s, all photodiodes on": {
        "optics.baud_rate": 30000.0,
        "optics.photodiodes_while_emitting": "all",
    },
}
"""Light of each setting.

The paper tells no rate of its robots. Kilobots, robots of 33 mm, send at 8 MHz / 269 = 29.7 kbit/s
(kilolib, message_send.S). With the default 8 slots, 427 bit/s leave no time to walk; the rates
between are choices.
"""
COMPARED = 96
"""Runs of each of the paper's types: their times scatter by a fifth, and 24 runs could not show
that two are equal."""
OF_ATTEMPTS: Values = {
    "gripper.tool_error": 4e-6,
    "gripper.grasp_time": 1.0,
    "gripper.release_time": 1.0,
}
"""Of attempts, beside the calibrated spread of adhesion. A robot stays for a control step at a ball
that it lifts or releases, a choice, the paper tells none [s]."""

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
"""Values that are tried one at a time, by groups; those that are the default's are left out. The
paper's own values (Table 1) are varied too where they are noise.

A run's seed follows from its place here: what is added comes last.
"""


def _hop_counts(genome: Genome) -> list[tuple[bool, Genome]]:
    return [(flag, replace(genome, use_hop_count=flag)) for flag in (True, False)]


def hop_count(plan: Plan) -> Iterator[Setting]:
    """Runs with and without hop counts."""
    for flag, genome in _hop_counts(plan.genome):
        yield {"use_hop_count": flag}, (int(flag),), {"genome": genome}


def density(plan: Plan) -> Iterator[Setting]:
    """Runs of all densities."""
    for d in (0.05, 0.1, 0.2, 0.4) if plan.quick else DENSITIES:
        yield {"density": d}, (round(1000 * d),), {"density": d}


def types(plan: Plan) -> Iterator[Setting]:
    """Runs of all presets, each at its own density, until all balls are delivered."""
    for place, (name, genome) in enumerate(PRESETS.items()):
        repeats = {"repeats": COMPARED} if name in PAPER_FITNESS else {}
        yield {"type": name}, (place,), {"genome": genome, "goal": None, **repeats}


def sensitivity(plan: Plan) -> Iterator[Setting]:
    """Runs of the default and of each choice; the number of robots is that of the default."""
    varieties = [({"group": DEFAULT, "choice": DEFAULT, "value": ""}, plan.config)]
    for group, choices in CHOICES.items():
        for name, others in list(choices.items())[: 1 if plan.quick else None]:
            for other in others:
                labels = {"group": group, "choice": name, "value": str(other)}
                varieties.append((labels, varied(plan.config, {name: other})))
    varieties = varieties[:1] + [item for item in varieties[1:] if item[1] != plan.config]
    for n, (labels, config) in enumerate(varieties):
        yield labels, (n,), {"config": config}


def robustness(plan: Plan) -> Iterator[Setting]:
    """Runs with shares of the robots dead, and with the same shares left out."""
    n_robots = robots_for(plan.config.arena, plan.genome.density_of_robots)
    fractions = (0.0, 0.3, 0.5) if plan.quick else FRACTIONS
    for f in fractions:
        yield {"kind": "dead", "fraction": f}, (1, round(1000 * f)), {"failed": f}
    for f in fractions[1:]:
        left = {"n_robots": n_robots - round(f * n_robots)}
        yield {"kind": "absent", "fraction": f}, (0, round(1000 * f)), left


def time_step(plan: Plan) -> Iterator[Setting]:
    """Runs of both types with all numbers of physics steps that the drive allows."""
    refused = refusals(plan.config.drive)
    for place, name in enumerate(SWARMS):
        for rate in (10, 50) if plan.quick else SUBSTEPS:
            if rate not in refused:
                config = replace(plan.config, drive=drive_of(plan.config.drive, rate))
                yield (
                    {"type": name, "rate": rate},
                    (place, rate),
                    {"config": config, "genome": PRESETS[name]},
                )


def message_time(plan: Plan) -> Iterator[Setting]:
    """Runs with and without hop counts where robots stop to emit and disturb each other, at several
    baud rates."""
    for name, own in MESSAGES.items():
        config, number = varied(plan.config, own), int(own["optics.baud_rate"]) + (len(own) - 1)
        for flag, genome in _hop_counts(plan.genome):
            labels = {"setting": name, "use_hop_count": flag}
            yield labels, (number, int(flag)), {"config": config, "genome": genome}


def resolved_grasps(plan: Plan) -> Iterator[Setting]:
    """Pairs of runs of both types with the same seed: grasps are trials on the bench, or decided by
    the balance of the forces; at all humidities and voltages of the tool."""
    humidities, voltages = (
        (HUMIDITIES[-1:], VOLTAGES[::2]) if plan.quick else (HUMIDITIES, VOLTAGES)
    )
    for (number, name), humidity, voltage in product(enumerate(SWARMS), humidities, voltages):
        for resolution in (BALANCE, TRIALS):
            mine = {
                "relative_humidity": humidity,
                "grasp_voltage": voltage,
                "resolution": resolution,
            }
            config = varied(
                plan.config, {**OF_ATTEMPTS, **{f"gripper.{key}": v for key, v in mine.items()}}
            )
            place = (number, round(humidity), round(voltage))
            yield {"type": name, **mine}, place, {"config": config, "genome": PRESETS[name]}
