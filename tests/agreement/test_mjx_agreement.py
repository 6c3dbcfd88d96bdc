"""Grasp and release in the C engine, in MJX-JAX and in MJX-Warp: one decision, that of the laws.

Units: um, mJ/m^2, V, as in `models/bench.xml`.
"""

from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import mujoco.rollout
import numpy as np
import pytest
from mujoco import mjx

import iswarm_mj.gripper.plugin as plugin
from iswarm_mj.gripper.bench.model import put_tip
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.contact import ON_PLATE, ON_PROBE
from iswarm_mj.gripper.laws.detachment import grasp_voltage, release_voltage
from iswarm_mj.gripper.mjx_forces import first_state, gripper_forces, step
from iswarm_mj.gripper.mjx_model import mjx_compatible, resize
from iswarm_mj.gripper.tips.table import read_table
from iswarm_mj.workflows.grasp import quasi_static_grasp, quasi_static_release

BENCH = Path(__file__).parents[2] / "models" / "bench.xml"
TIP = str(Path(__file__).parents[2] / "examples/best-tip/tip.json")
"""File of the table of another tip than the flat one."""
FULL_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
N_TRIALS = 50
SHARES = (0.995, 1.005)
"""Voltages below and above the threshold, as shares of it."""
TIP_AT_ZERO = 45.0
"""Height of the tip where the probe's slide is 0."""
TOUCH = 2e-4
"""Depth of the ball in the plate or the probe that it touches at the start."""
LIFTED = 5.0
"""Height of the ball above the plate before it is released."""
PULL_UP = np.concatenate(
    [
        np.full(100, -0.003),
        np.linspace(-0.003, 0.02, 300),
        np.linspace(0.02, 0.4, 200),
    ]
)
"""Shift of the probe against first touch in a grasp."""
HOLD = np.zeros(400)
"""Shift of the probe in a release."""


class Trials(NamedTuple):
    """Trials of balls, N below their thresholds and the same N above (2 N, ...)."""

    radius: np.ndarray
    """Radius of the ball."""
    work: np.ndarray
    """(2 N, 2) work of adhesion on the plate and on the probe."""
    voltage: np.ndarray
    """Voltage of the probe."""
    height: np.ndarray
    """Height of the ball above the plate at the start."""
    tip: np.ndarray
    """Slide of the probe at the start."""
    path: np.ndarray
    """(2 N, T) slide of the probe in each step."""


def draw_trials(task, table=None):
    """Return trials of a task on both sides of the thresholds of the laws.

    Args:
        task: "grasp" or "release".
        table: file of the table of a tip; None: the flat one.
    """
    rng = np.random.default_rng(6)
    radius = np.tile(rng.uniform(15, 25, N_TRIALS), 2)
    scatter = np.exp(rng.normal(0, [0.16, 0.12], (N_TRIALS, 2)))
    work = np.tile(np.array([14.7, 1.41]) * scatter, (2, 1))
    share = np.repeat(SHARES, N_TRIALS)
    work_plate, work_probe = work.T * 1e-3  # J/m^2
    radius_si = radius * 1e-6  # m

    if task == "grasp":
        voltage = share * least_voltages(task, table, radius_si, work_probe, work_plate)
        height = np.zeros_like(radius)
        shift = PULL_UP
    else:
        voltage = share * least_voltages(task, table, radius_si, work_probe, work_plate)
        height = np.full_like(radius, LIFTED)
        shift = HOLD

    tip = height + 2 * radius - TIP_AT_ZERO
    return Trials(radius, work, voltage, height, tip, tip[:, None] + shift)


def least_voltages(task, table, radius, work_probe, work_plate):
    """Return the thresholds of the laws [V]; SI units."""
    if table is None and task == "grasp":
        return grasp_voltage(radius, work_probe, work_plate)
    if table is None:
        return release_voltage(radius, work_probe)
    voltages = []
    for ball in map(Trial, radius, work_probe, work_plate):
        ball = ball._replace(tip=table)
        works = ball.work_tool_object, ball.work_object_substrate
        if task == "grasp":
            voltages.append(quasi_static_grasp(ball, *works, ball.contact_gap))
        else:
            voltages.append(quasi_static_release(ball, works[0], LIFTED * 1e-6))
    return np.array(voltages)


def specification(table):
    """Return the bench with a tip."""
    spec = mujoco.MjSpec.from_file(str(BENCH))
    if table is not None:
        put_tip(spec, read_table(table))
    return spec


def gaps_in_c(task, table=None):
    """Return the gaps between balls and plate (2 N,) at the end, in the C engine."""
    trials = draw_trials(task, table)
    models = []
    states = []
    controls = []
    for trial in zip(*trials, strict=True):
        radius, (work_plate, work_probe), voltage, height, tip, path = trial
        is_on_probe = height > 0
        spec = specification(table)
        spec.geom("ball").size[0] = radius
        model = spec.compile()

        # Where the trial starts, with the properties of its surfaces.
        data = mujoco.MjData(model)
        data.joint("ball").qpos[2] = height + radius + (TOUCH if is_on_probe else -TOUCH)
        data.joint("probe_z").qpos = tip
        for instance, field, value in (
            ("adhesion_plate", "work", work_plate),
            ("adhesion_probe", "work", work_probe),
            ("electrostatic", "potential", is_on_probe),
        ):
            data.plugin_state[plugin.state_index(model, instance, field)] = value

        state = np.zeros(mujoco.mj_stateSize(model, FULL_STATE))
        mujoco.mj_getState(model, data, state, FULL_STATE)
        models.append(model)
        states.append(state)
        controls.append(np.stack([0 * path, path, np.full_like(path, voltage)], axis=1))

    one_thread = [mujoco.MjData(models[0])]
    result, _ = mujoco.rollout.rollout(models, one_thread, np.array(states), np.array(controls))
    height_index = 1 + 2  # of the ball, after the time
    return result[:, -1, height_index] - trials.radius


def gaps_in_mjx(task, impl, table=None):
    """Return the gaps between balls and plate (2 N,) at the end, in MJX."""
    spec = specification(table)
    forces = gripper_forces(spec.compile())
    portable = mjx_compatible(spec)
    size = {"naconmax": 8 * N_TRIALS, "njmax": 20} if impl == "warp" else {}
    model = mjx.put_model(portable, impl=impl)
    data = mjx.make_data(portable, impl=impl, **size)

    def gap_of(trial):
        is_on_probe = trial.height > 0
        works = {
            ("adhesion_plate", "work"): trial.work[0],
            ("adhesion_probe", "work"): trial.work[1],
        }
        trial_model = resize(forces, model, trial.radius)
        trial_forces = forces.having(works)
        z = trial.height + trial.radius + jnp.where(is_on_probe, TOUCH, -TOUCH)
        start = data.replace(qpos=data.qpos.at[2].set(z).at[8].set(trial.tip))

        def advance(carry, probe_z):
            data, ball = carry
            control = jnp.stack([0 * probe_z, probe_z, trial.voltage])
            data = data.replace(ctrl=control)
            data, force = step(trial_forces, trial_model, data, ball)
            return (data, force.state), None

        ball = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), first_state(trial_forces))
        ball = ball._replace(potential=jnp.where(is_on_probe, ON_PROBE, ON_PLATE))
        (end, _), _ = jax.lax.scan(advance, (start, ball), trial.path)
        return end.qpos[2] - trial.radius

    single = jax.tree.map(lambda values: jnp.asarray(values, jnp.float32), draw_trials(task, table))
    return np.asarray(jax.jit(jax.vmap(gap_of))(single))


def assert_decided_as_the_laws(task, gaps):
    """Assert that balls above their thresholds were grasped or released, and no others."""
    is_done = gaps > 0.2 if task == "grasp" else gaps < 4
    below, above = is_done.reshape(2, N_TRIALS)
    assert not below.any()
    assert above.all()


@pytest.mark.parametrize("task", ["grasp", "release"])
def test_the_plugin_decides_as_the_laws(task):
    assert_decided_as_the_laws(task, gaps_in_c(task))


@pytest.mark.slow
@pytest.mark.parametrize("impl", ["jax", "warp"])
@pytest.mark.parametrize("task", ["grasp", "release"])
def test_mjx_decides_as_the_laws(task, impl):
    if impl == "warp":
        pytest.importorskip("warp")
    assert_decided_as_the_laws(task, gaps_in_mjx(task, impl))


@pytest.mark.parametrize("task", ["grasp", "release"])
def test_the_plugin_decides_as_the_laws_with_another_tip(task):
    """100 trials of each task."""
    assert_decided_as_the_laws(task, gaps_in_c(task, TIP))


@pytest.mark.slow
@pytest.mark.parametrize("task", ["grasp", "release"])
def test_mjx_decides_as_the_laws_with_another_tip(task):
    """100 trials of each task."""
    assert_decided_as_the_laws(task, gaps_in_mjx(task, "jax", TIP))
