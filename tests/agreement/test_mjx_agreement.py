"""Grasp and release in the C engine, in MJX-JAX and in MJX-Warp: one decision, that of the laws."""

from pathlib import Path

import mujoco
import mujoco.rollout
import numpy as np
import pytest

import iswarm_mj.gripper.plugin as plugin
from iswarm_mj.gripper.laws.detachment import grasp_voltage, release_voltage

BENCH = Path(__file__).parents[2] / "models" / "bench.xml"
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
N_TRIALS = 50
SHARES = (0.995, 1.005)
START = 45.0
"""Height of the tip where the probe's slide is 0 [um]."""
RETRACTED = np.concatenate([np.full(100, -0.003), np.linspace(-0.003, 0.02, 300), np.linspace(0.02, 0.4, 200)])
"""Shift of the probe against first touch in a grasp [um]."""


def trials(task):
    """Radii, works (plate, probe), voltages, starts and paths of balls on both sides of their thresholds (2 N, ...)."""
    random = np.random.default_rng(6)
    radius = np.tile(random.uniform(15, 25, N_TRIALS), 2)
    work = np.tile(np.array([14.7, 1.41]) * np.exp(random.normal(0, [0.16, 0.12], (N_TRIALS, 2))), (2, 1))
    share = np.repeat(SHARES, N_TRIALS)
    os, to = work.T * 1e-3
    if task == "grasp":
        voltage = share * grasp_voltage(radius * 1e-6, to, os)
        height, path = np.zeros_like(radius), RETRACTED
    else:
        height, path = np.full_like(radius, 5.0), np.zeros(400)
        voltage = share * release_voltage(radius * 1e-6, to)
    tip = height + 2 * radius - START
    return radius, work, voltage, height, tip, tip[:, None] + path


def c_engine(task):
    """Gap between ball and plate (2 N,) at the end."""
    states, controls, models = [], [], []
    for radius, work, voltage, height, tip, path in zip(*trials(task), strict=True):
        spec = mujoco.MjSpec.from_file(str(BENCH))
        spec.geom("ball").size[0] = radius
        models.append(spec.compile())
        data = mujoco.MjData(models[-1])
        data.joint("ball").qpos[2] = height + radius + (2e-4 if height else -2e-4)
        data.joint("probe_z").qpos = tip
        for instance, w in zip(("adhesion_plate", "adhesion_probe"), work, strict=True):
            data.plugin_state[plugin.state_index(models[-1], instance, "work")] = w
        data.plugin_state[plugin.state_index(models[-1], "electrostatic", "potential")] = height > 0
        states.append(np.zeros(mujoco.mj_stateSize(models[-1], FULL)))
        mujoco.mj_getState(models[-1], data, states[-1], FULL)
        controls.append(np.stack([0 * path, path, np.full_like(path, voltage)], axis=1))
    result, _ = mujoco.rollout.rollout(models, [mujoco.MjData(models[0])] * 1, np.array(states), np.array(controls))
    return result[:, -1, 1 + 2] - trials(task)[0]


def decided(task, gap):
    """Whether each ball was grasped, or released (2, N)."""
    return (gap > 0.2 if task == "grasp" else gap < 4).reshape(2, N_TRIALS)


@pytest.mark.parametrize("task", ["grasp", "release"])
def test_the_plugin_decides_as_the_laws(task):
    below, above = decided(task, c_engine(task))
    assert not below.any()
    assert above.all()
