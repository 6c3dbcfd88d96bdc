"""Grasp and release in the C engine, in MJX-JAX and in MJX-Warp: one decision, that of the laws."""

from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import mujoco.rollout
import numpy as np
import pytest
from mujoco import mjx

import iswarm_mj.gripper.plugin as plugin
from iswarm_mj.gripper.contact import ON_PLATE, ON_PROBE
from iswarm_mj.gripper.laws.detachment import grasp_voltage, release_voltage
from iswarm_mj.gripper.mjx_forces import first_state, gripper_forces, step
from iswarm_mj.gripper.mjx_model import mjx_compatible, resize

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


def in_mjx(task, impl):
    """Gap between ball and plate (2 N,) at the end."""
    spec = mujoco.MjSpec.from_file(str(BENCH))
    forces, portable = gripper_forces(spec.compile()), mjx_compatible(spec)
    size = {"naconmax": 8 * N_TRIALS, "njmax": 20} if impl == "warp" else {}
    mx, dx = mjx.put_model(portable, impl=impl), mjx.make_data(portable, impl=impl, **size)

    def run(radius, work, voltage, height, tip, path):
        lifted = height > 0
        works = {(f"adhesion_{surface}", "work"): work[k] for k, surface in enumerate(("plate", "probe"))}
        model, mine = resize(forces, mx, radius), forces.having(works)
        z = height + radius + jnp.where(lifted, 2e-4, -2e-4)
        start = dx.replace(qpos=dx.qpos.at[2].set(z).at[8].set(tip))

        def advance(carry, probe_z):
            data, ball = carry
            data = data.replace(ctrl=jnp.stack([0 * probe_z, probe_z, voltage]))
            data, force = step(mine, model, data, ball)
            return (data, force.state), None

        ball = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), first_state(mine))
        ball = ball._replace(potential=jnp.where(lifted, ON_PROBE, ON_PLATE))
        (data, _), _ = jax.lax.scan(advance, (start, ball), path)
        return data.qpos[2] - radius

    return np.asarray(jax.jit(jax.vmap(run))(*(jnp.asarray(column, jnp.float32) for column in trials(task))))


def decided(task, gap):
    """Whether each ball was grasped, or released (2, N)."""
    return (gap > 0.2 if task == "grasp" else gap < 4).reshape(2, N_TRIALS)


@pytest.mark.parametrize("task", ["grasp", "release"])
def test_the_plugin_decides_as_the_laws(task):
    below, above = decided(task, c_engine(task))
    assert not below.any()
    assert above.all()


@pytest.mark.slow
@pytest.mark.parametrize("impl", ["jax", "warp"])
@pytest.mark.parametrize("task", ["grasp", "release"])
def test_mjx_decides_as_the_laws(task, impl):
    if impl == "warp":
        pytest.importorskip("warp")
    below, above = decided(task, in_mjx(task, impl))
    assert not below.any()
    assert above.all()
