"""Random attempts to lift and to release balls."""

import numpy as np

from iswarm_mj.gripper.attempts import Attempts
from iswarm_mj.gripper.laws.detachment import grasp_voltage, release_voltage


def random_attempts(count, seed, spread=0.3):
    """Lifts and releases at voltages around their thresholds, and the distance from these, relative."""
    random = np.random.default_rng(seed)
    radius = random.uniform(15e-6, 25e-6, count)
    tool, floor = 1.41e-3 * np.exp(0.2 * random.normal(size=count)), 14.7e-3 * np.exp(0.3 * random.normal(size=count))
    lifts = random.random(count) < 0.5
    threshold = np.where(lifts, grasp_voltage(radius, tool, floor), release_voltage(radius, tool))
    share = np.exp(random.uniform(-spread, spread, count))
    voltage = np.minimum(threshold * share, 69.0)
    miss = np.where(lifts, np.abs(random.normal(0, 4e-6, count)), 0.0)
    values = (np.asarray(values, np.float32) for values in (voltage, radius, tool, floor, miss))
    return Attempts(lifts, ~lifts, *values), voltage / threshold - 1
