"""Random attempts to lift and to release balls, and steps of robots that make them.

Steps share programs: robots and balls far away fill up to `N` and `K`, and what differs between worlds is no constant.
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

PROBE, DUMP = np.array([0.9, 0.0], np.float32), 5 * RD
N, K = 4, 4
GRIPPER = GripperConfig(spread_tool_object=0.0, spread_object_substrate=0.0)
"""Whose attempts are alike."""
KEY = jax.random.key(0)
HUMIDITIES = (10.0, 30.0, 50.0)
"""[%]"""
PERIOD = 0.5
"""Duration of a control step [s]."""


def random_attempts(count, seed, spread=0.3):
    """Lifts and releases at voltages around their thresholds, and the distance from these, relative."""
    random = np.random.default_rng(seed)
    radius = random.uniform(15e-6, 25e-6, count)
    tool, floor = 1.41e-3 * np.exp(0.2 * random.normal(size=count)), 14.7e-3 * np.exp(0.3 * random.normal(size=count))
    lifts = random.random(count) < 0.5
    threshold = np.where(lifts, grasp_voltage(radius, tool, floor), release_voltage(radius, tool))
    share = np.exp(random.uniform(-spread, spread, count))
    voltage = np.minimum(threshold * share, 69.0)
    return _attempts(random, lifts, voltage, radius, (tool, floor)), voltage / threshold - 1


def any_attempts(count, seed):
    """Lifts and releases at voltages and humidities of the whole range, with the calibrated spreads; as above."""
    random = np.random.default_rng(seed)
    radius, lifts = random.uniform(15e-6, 25e-6, count), random.random(count) < 0.5
    factor = np.array([float(humidity_factor(rh)) for rh in HUMIDITIES])[random.integers(0, 3, count)]
    tool, floor = (
        factor * np.asarray(scattered_work(work, spread, random.normal(size=count)))
        for work, spread in (
            (WORK_TOOL_OBJECT, VARIATION_TOOL_OBJECT),
            (WORK_OBJECT_SUBSTRATE, VARIATION_OBJECT_SUBSTRATE),
        )
    )
    threshold = np.where(lifts, grasp_voltage(radius, tool, floor), release_voltage(radius, tool))
    voltage = random.uniform(0.0, 69.0, count)
    return _attempts(random, lifts, voltage, radius, (tool, floor)), voltage / threshold - 1


def _attempts(random, lifts, voltage, radius, works):
    miss = np.where(lifts, np.abs(random.normal(0, 4e-6, len(lifts))), 0.0)
    return Attempts(lifts, ~lifts, *(np.asarray(values, np.float32) for values in (voltage, radius, *works, miss)))


def step(gripper, balls, rows, *, picks=True, falls=False, voltage=69.0, releases=False, decider=by_balance, key=KEY):
    """One step of the hands of robots at rows of x, y, heading [deg]: the balls, and who lifted in vain."""
    n, k, own = len(rows), len(balls.radius), conditions_of(SwarmConfig(gripper=gripper))
    poses = place(*rows, *[(500, 500, 0)] * (N - n))
    if k < K:
        far = lay(*[(-500, -500)] * (K - k))
        balls = jax.tree.map(lambda a, b: np.concatenate([a, b]), balls, far)
    picks, voltage, falls = filled(picks, n, N), filled(np.float32(voltage), n, N), filled(falls, k, K)
    releases = filled(releases, n, N)
    usual = replace(gripper, **{name: getattr(GRIPPER, name) for name in own._fields if hasattr(GRIPPER, name)})
    given = poses.astype(np.float32), picks, falls, key, voltage, releases
    balls, failed = jax.device_get(_step(usual, decider, own, balls, *given))
    return jax.tree.map(lambda a: a[:k], balls), failed[:n]


def filled(values, count, size):
    """An array of so many values, or of one for each, with zeros up to `size`."""
    found = np.zeros(max(count, size), np.asarray(values).dtype)
    found[:count] = values
    return found


@partial(jax.jit, static_argnums=(0, 1))
def _step(gripper, decider, conditions, balls, poses, picks, falls, key, voltage, releases):
    """One step of the hands: the balls, and who lifted in vain."""
    tips = probe_tips(poses, PROBE)
    balls = carry(balls, tips)
    view = sense(poses, tips, balls.position, balls.is_lying, DUMP, 0.75 * RD)
    given = {"decider": decider, "control_period": PERIOD, "voltage": voltage, "releases": releases}
    return update_grasps(gripper, conditions, balls, tips, view, picks, falls, key=key, **given)
