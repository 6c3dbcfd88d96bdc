"""Settings at the ends of their ranges: all numbers stay finite, and nothing warns.

Robots stand at balls, on the dump with balls, and in each other's way, so that each setting is of
use.
"""

import warnings
from contextlib import suppress
from dataclasses import fields, replace
from pathlib import Path

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
from iswarm_mj.utils.constraints import Above, choices, constraint_of, type_of
from iswarm_mj.utils.errors import ConfigError
from iswarm_mj.utils.units import RD

PARTS = ("gripper", "strategy", "energy", "drive", "optics")
"""Parts of the configuration whose settings are moved."""
TIP = str(Path(__file__).parents[2] / "examples/best-tip/tip.json")
"""Table of another tip."""
QUICK_WORDS = {
    "bench": ["auto", "c"],
    "resolution": ["quasi-static", "quasi-static", "dynamic"],
    "tip": [None, TIP],
}
"""Words for settings of which others take long: a batch of trials in MJX is compiled for each."""
SMALLEST = 1e-38
"""A number that is nearly the smallest normal one of single precision."""
N_ROBOTS = 12
N_WORLDS = 8
N_STEPS = 4
PLACES = [(x * RD, y * RD) for x in (-3, -1, 1, 3) for y in (-2, 0, 2)]
"""Places of the robots [mm]."""
ON_DUMP = [number for number, (x, y) in enumerate(PLACES) if abs(x) <= RD and y == 0]
"""Numbers of the robots over the dump."""
SETTINGS = [(part, f.name) for part in PARTS for f in fields(getattr(SwarmConfig(), part))]
"""Part and name of each setting that is moved."""
OF_RUNS = [(part, name) for part, name in SETTINGS if name not in PER_WORLD_FIELDS[part]]
"""Settings that all worlds of a run share."""
OF_WORLDS = [(part, name) for part, name in SETTINGS if name in PER_WORLD_FIELDS[part]]
"""Settings in which worlds may differ."""


def end(rng, cls, name):
    """Return one of the last values that a setting of a class may have, or one of its words."""
    limits = constraint_of(cls, name)
    if limits is None:
        words = QUICK_WORDS.get(name) or list(choices(cls, name)) or [False, True]
        return pick(rng, words)
    if is_whole(cls, name):
        return int(pick(rng, [limits.low, limits.low + 1, limits.high]))
    least = limits.least if isinstance(limits, Above) else limits.low
    second = np.nextafter(least, limits.high)
    return float(pick(rng, [least, max(least, SMALLEST), second, limits.high]))


def is_whole(cls, name):
    """Return whether a setting is a whole number."""
    return type_of(cls, name) is int or isinstance(getattr(cls(), name), int)


def with_ends(rng, config, settings, n):
    """Return a configuration of which some settings are at the ends of their ranges.

    Args:
        rng: source of all that is random.
        config: configuration that is changed.
        settings: part and name of the settings that may be chosen.
        n: how many are chosen; values that do not fit the others are left out.
    """
    for index in rng.permutation(len(settings))[:n]:
        part_name, name = settings[index]
        part = getattr(config, part_name)
        value = end(rng, type(part), name)
        with suppress(ConfigError):
            config = replace(config, **{part_name: replace(part, **{name: value})})
    return config


def genome_with_ends(rng):
    """Return a genome of which some parameters are at the ends of their ranges."""
    values = {f.name: end(rng, Genome, f.name) for f in fields(Genome) if rng.random() < 0.2}
    return replace(Genome(), **values)


def busy_start(config, rng):
    """Return a start with robots in a grid.

    Those over the dump hold a ball, and most of the others have one at their tip.
    """
    start = start_of(config, N_ROBOTS, int(rng.integers(1000)), 0)
    poses = np.column_stack([PLACES, rng.uniform(-np.pi, np.pi, N_ROBOTS)])
    probe = np.asarray(read_robot().probe_tip, np.float32)
    tips = np.asarray(probe_tips(poses.astype(np.float32), probe))
    balls = jax.tree.map(np.array, start.task)
    balls.position[:N_ROBOTS] = tips
    balls.holder[ON_DUMP] = ON_DUMP
    balls.is_held[ON_DUMP] = True
    balls.was_picked[ON_DUMP] = True
    return start._replace(poses=poses, task=balls)


def drawn_run(rng, small):
    """Return a run whose worlds have settings at their ends."""
    capacitor = replace(small, energy=replace(small.energy, model="capacitor"))
    config = with_ends(rng, capacitor, OF_RUNS, n=rng.integers(3))
    worlds = []
    for _ in range(N_WORLDS):
        genome = genome_with_ends(rng)
        world_config = with_ends(rng, config, OF_WORLDS, n=rng.integers(1, 4))
        check_shared_settings(config, world_config)
        start = busy_start(world_config, rng)
        worlds.append(World(genome, N_ROBOTS, config=world_config, start=start))
    engine = PlanarSettings(1) if rng.random() < 0.8 else MujocoSettings(1)
    scenario = Scenario(config, engine=engine, worlds=worlds, steps=N_STEPS)
    return Run(scenario, record_worlds=range(N_WORLDS))


def assert_finite(record, faults):
    """Assert that the record of worlds without a fault is finite, and that no energy is owed."""
    is_sound = np.array([fault is None for fault in faults])
    arrays = {
        "swarm": record.swarm,
        "poses": record.poses,
        "command": record.command,
        "speed": record.speed,
        "measured": record.measured_distance,
    }
    for path, array in jax.tree_util.tree_leaves_with_path(arrays):
        values = np.asarray(array)
        if values.dtype.kind == "f":
            name = jax.tree_util.keystr(path)
            assert np.isfinite(values[:, is_sound]).all(), f"{name} is not finite"
    if record.swarm.energy is not None:
        assert (np.asarray(record.swarm.energy) >= 0).all()


@pytest.fixture(scope="module")
def compiled(small):
    """Programs of the engines, compiled once for all settings.

    That takes longer than a case may.
    """
    for engine in (PlanarSettings(1), MujocoSettings(1)):
        Run(Scenario(small, robots=N_ROBOTS, engine=engine, steps=1)).advance()


@pytest.mark.slow
@pytest.mark.usefixtures("compiled")
@attack(2)
def test_numbers_stay_finite(small, seed):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = drawn_run(np.random.default_rng(seed), small)
        while not run.is_over:
            record = run.advance()
            assert_finite(record, run.fault_of_each)
    event("with faults" if any(run.faults) else "done")
