"""Random attempts to lift and to release balls, and steps of robots that make them.

Steps share programs: robots and balls far away fill up to `N` and `K`, and values that differ
between worlds are no constants.
"""

from dataclasses import replace
from functools import partial

import jax
import numpy as np

from iswarm_mj.config.swarm import GripperConfig, SwarmConfig
from iswarm_mj.gripper.attempts import Attempts, by_balance
from iswarm_mj.gripper.handling import carry, update_grasps
from iswarm_mj.gripper.laws.adhesion import humidity_factor
from iswarm_mj.gripper.laws.detachment import (
    VARIATION_OBJECT_SUBSTRATE,
    VARIATION_TOOL_OBJECT,
    WORK_OBJECT_SUBSTRATE,
    WORK_TOOL_OBJECT,
    grasp_voltage,
    release_voltage,
    scattered_work,
)
from iswarm_mj.sensors.conditions import conditions_of
from iswarm_mj.sensors.floor import probe_tips, sense
from iswarm_mj.utils.units import RD
from support.sensing import lay, place

PROBE = np.array([0.9, 0.0], np.float32)
"""Position of the tip ahead of and to the left of the robot's centre [mm]."""
DUMP = 5 * RD
"""Edge of the dump [mm]."""
N = 4
"""Number of robots for which a step is compiled, at least."""
K = 4
"""Number of balls for which a step is compiled, at least."""
GRIPPER = GripperConfig(spread_tool_object=0.0, spread_object_substrate=0.0)
"""A gripper whose attempts are alike."""
KEY = jax.random.key(0)
HUMIDITIES = (10.0, 30.0, 50.0)
"""Relative humidities [%]."""
HIGHEST_VOLTAGE = 69.0
"""Voltage below that of melting [V]."""
PERIOD = 0.5
"""Duration of a control step [s]."""


def random_attempts(count, seed, spread=0.3):
    """Draw lifts and releases at voltages around their thresholds.

    Returns:
        Attempts, and the relative distances of their voltages from the thresholds.
    """
    random = np.random.default_rng(seed)
    radius = random.uniform(15e-6, 25e-6, count)
    tool = 1.41e-3 * np.exp(0.2 * random.normal(size=count))
    floor = 14.7e-3 * np.exp(0.3 * random.normal(size=count))
    lifts = random.random(count) < 0.5

    threshold = _threshold(lifts, radius, tool, floor)
    share = np.exp(random.uniform(-spread, spread, count))
    voltage = np.minimum(threshold * share, HIGHEST_VOLTAGE)
    return _attempts(random, lifts, voltage, radius, tool, floor), voltage / threshold - 1


def any_attempts(count, seed):
    """Draw lifts and releases at any voltage and humidity, with the calibrated spreads.

    Returns:
        Attempts, and the relative distances of their voltages from the thresholds.
    """
    random = np.random.default_rng(seed)
    radius = random.uniform(15e-6, 25e-6, count)
    lifts = random.random(count) < 0.5

    # Works of adhesion, which water on the surfaces raises.
    factors = np.array([float(humidity_factor(humidity)) for humidity in HUMIDITIES])
    factor = factors[random.integers(0, len(HUMIDITIES), count)]
    tool_scatter = random.normal(size=count)
    floor_scatter = random.normal(size=count)
    tool = scattered_work(WORK_TOOL_OBJECT, VARIATION_TOOL_OBJECT, tool_scatter)
    floor = scattered_work(WORK_OBJECT_SUBSTRATE, VARIATION_OBJECT_SUBSTRATE, floor_scatter)
    tool = factor * np.asarray(tool)
    floor = factor * np.asarray(floor)

    threshold = _threshold(lifts, radius, tool, floor)
    voltage = random.uniform(0.0, HIGHEST_VOLTAGE, count)
    return _attempts(random, lifts, voltage, radius, tool, floor), voltage / threshold - 1


def _threshold(lifts, radius, tool, floor):
    """Return the voltages at which the balance lifts or releases balls [V]."""
    return np.where(lifts, grasp_voltage(radius, tool, floor), release_voltage(radius, tool))


def _attempts(random, lifts, voltage, radius, tool, floor):
    """Return attempts at these balls; tools that lift are 4 um beside their axes."""
    offset = np.abs(random.normal(0, 4e-6, len(lifts)))
    return Attempts(
        lifts=lifts,
        releases=~lifts,
        voltage=np.asarray(voltage, np.float32),
        radius=np.asarray(radius, np.float32),
        work_tool_object=np.asarray(tool, np.float32),
        work_object_substrate=np.asarray(floor, np.float32),
        misalignment=np.asarray(np.where(lifts, offset, 0.0), np.float32),
    )


def step(
    gripper,
    balls,
    rows,
    *,
    picks=True,
    falls=False,
    voltage=HIGHEST_VOLTAGE,
    releases=False,
    decider=by_balance,
    key=KEY,
):
    """Take one step of robots at rows of x, y, heading [deg].

    Returns:
        The balls, and for each robot whether it lifted in vain.
    """
    n_robots = len(rows)
    n_balls = len(balls.radius)
    conditions = conditions_of(SwarmConfig(gripper=gripper))

    # Fill up to the numbers for which the step is compiled.
    poses = place(*rows, *[(500, 500, 0)] * (N - n_robots))
    if n_balls < K:
        far_balls = lay(*[(-500, -500)] * (K - n_balls))
        balls = jax.tree.map(lambda a, b: np.concatenate([a, b]), balls, far_balls)

    # Compile for a gripper without the values that are conditions of a world.
    varying = [name for name in conditions._fields if hasattr(GRIPPER, name)]
    static = replace(gripper, **{name: getattr(GRIPPER, name) for name in varying})

    after = _step(
        static,
        decider,
        conditions,
        balls,
        poses.astype(np.float32),
        filled(picks, n_robots, N),
        filled(falls, n_balls, K),
        key,
        filled(np.float32(voltage), n_robots, N),
        filled(releases, n_robots, N),
    )
    balls, failed = jax.device_get(after)
    return jax.tree.map(lambda a: a[:n_balls], balls), failed[:n_robots]


def filled(values, count, size):
    """Return an array of `count` values, or of one for all of them, with zeros up to `size`."""
    array = np.zeros(max(count, size), np.asarray(values).dtype)
    array[:count] = values
    return array


@partial(jax.jit, static_argnums=(0, 1))
def _step(gripper, decider, conditions, balls, poses, picks, falls, key, voltage, releases):
    """Move the balls with their robots, and update the grasps."""
    tips = probe_tips(poses, PROBE)
    balls = carry(balls, tips)
    view = sense(poses, tips, balls.position, balls.is_lying, DUMP, 0.75 * RD)
    return update_grasps(
        gripper,
        conditions,
        balls,
        tips,
        view,
        picks,
        falls,
        decider=decider,
        control_period=PERIOD,
        key=key,
        voltage=voltage,
        releases=releases,
    )
