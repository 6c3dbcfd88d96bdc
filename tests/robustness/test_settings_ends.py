"""Settings at the ends of their ranges: numbers stay finite, nothing is divided by zero or warned
of.

Robots stand at balls, on the dump with balls, and in each other's way, so that each setting is of
use.
"""

import warnings
from contextlib import suppress
from dataclasses import fields, replace

import jax
import numpy as np
import pytest
from hypothesis import event
from support.attacks import attack, pick
from support.worlds import start_of

from iswarm_mj import MujocoSettings, PlanarSettings, Run, SwarmConfig
from iswarm_mj.engines.robot_file import read_robot
from iswarm_mj.sensors.floor import probe_tips
from iswarm_mj.simulation.scenario import Scenario
from iswarm_mj.simulation.shared_settings import PER_WORLD_FIELDS, check_shared_settings
from iswarm_mj.simulation.worlds import World
from iswarm_mj.strategy.genome import Genome
from iswarm_mj.utils.constraints import Above, choices, constraint_of
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import RD

PARTS = ("gripper", "strategy", "energy", "drive", "optics")
SLOW = {"bench": ["auto", "c"], "resolution": ["quasi-static", "quasi-static", "dynamic"]}
"""Choices where others take long: a batch of trials in MJX is compiled anew for each setting."""
N_ROBOTS, N_WORLDS, N_STEPS = 12, 8, 4
PLACES = [(x * RD, y * RD) for x in (-3, -1, 1, 3) for y in (-2, 0, 2)]
ON_DUMP = [number for number, (x, y) in enumerate(PLACES) if abs(x) <= RD and y == 0]


def end(rng, cls, name):
    """One of the last values that a setting may have, or one of its words."""
    limits = constraint_of(cls, name)
    if limits is None:
        words = SLOW.get(name) or list(choices(cls, name)) or [False, True]
        return pick(rng, words)
    if next(f.type for f in fields(cls) if f.name == name) is int or isinstance(
        getattr(cls(), name), int
    ):
        return int(pick(rng, [limits.low, limits.low + 1, limits.high]))
    least = limits.least if isinstance(limits, Above) else limits.low
    values = [least, max(least, 1e-38), np.nextafter(least, limits.high), limits.high]
    return float(pick(rng, values))


def moved(rng, config, names, n):
    """A configuration with `n` of these settings, (part, name), at the ends of their ranges."""
    for index in rng.permutation(len(names))[:n]:
        part, name = names[index]
        mine = getattr(config, part)
        with suppress(ConfigError):  # a value that does not go with the others
            config = replace(config, **{part: replace(mine, **{name: end(rng, type(mine), name)})})
    return config


SETTINGS = [(part, f.name) for part in PARTS for f in fields(getattr(SwarmConfig(), part))]
OF_RUNS = [(part, name) for part, name in SETTINGS if name not in PER_WORLD_FIELDS[part]]
OF_WORLDS = [(part, name) for part, name in SETTINGS if name in PER_WORLD_FIELDS[part]]


def busy_start(config, rng):
    """Robots in a grid: those over the dump hold a ball, most of the others have one at the tip."""
    start = start_of(config, N_ROBOTS, int(rng.integers(1000)), 0)
    poses = np.column_stack([PLACES, rng.uniform(-np.pi, np.pi, N_ROBOTS)])
    tips = np.asarray(
        probe_tips(poses.astype(np.float32), np.asarray(read_robot().probe_tip, np.float32))
    )
    balls = jax.tree.map(np.array, start.task)
    balls.position[:N_ROBOTS] = tips
    balls.holder[ON_DUMP] = ON_DUMP
    balls.is_held[ON_DUMP] = True
    balls.was_picked[ON_DUMP] = True
    return start._replace(poses=poses, task=balls)


def drawn(rng, small):
    """A run whose worlds have settings at their ends."""
    config = moved(
        rng,
        replace(small, energy=replace(small.energy, model="capacitor")),
        OF_RUNS,
        rng.integers(3),
    )
    worlds = []
    for _ in range(N_WORLDS):
        genome = replace(
            Genome(),
            **{f.name: end(rng, Genome, f.name) for f in fields(Genome) if rng.random() < 0.2},
        )
        own = moved(rng, config, OF_WORLDS, rng.integers(1, 4))
        check_shared_settings(config, own)
        worlds.append(World(genome, N_ROBOTS, config=own, start=busy_start(own, rng)))
    engine = PlanarSettings(1) if rng.random() < 0.8 else MujocoSettings(1)
    scenario = Scenario(config, engine=engine, worlds=worlds, steps=N_STEPS)
    return Run(scenario, record_worlds=range(N_WORLDS))


def check(record, faults):
    """Each number of worlds without a fault is finite, and energy is never owed."""
    sound = np.array([fault is None for fault in faults])
    parts = {
        "swarm": record.swarm,
        "poses": record.poses,
        "command": record.command,
        "speed": record.speed,
    }
    for path, values in jax.tree_util.tree_leaves_with_path(
        {**parts, "measured": record.measured_distance}
    ):
        values = np.asarray(values)
        if values.dtype.kind == "f":
            assert np.isfinite(values[:, sound]).all(), (
                f"{jax.tree_util.keystr(path)} is not finite"
            )
    if record.swarm.energy is not None:
        assert (np.asarray(record.swarm.energy) >= 0).all()


@pytest.fixture(scope="module")
def compiled(small):
    """Programs of the engines that are compiled once for all settings, which takes longer than a
    case may."""
    for engine in (PlanarSettings(1), MujocoSettings(1)):
        Run(Scenario(small, robots=N_ROBOTS, engine=engine, steps=1)).advance()


@pytest.mark.slow
@pytest.mark.usefixtures("compiled")
@attack(2)
def test_numbers_stay_finite(small, seed):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = drawn(np.random.default_rng(seed), small)
        while not run.is_over:
            record = run.advance()
            check(record, run.fault_of_each)
        event("with faults" if any(run.faults) else "done")
