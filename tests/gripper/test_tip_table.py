"""Tables of tips: their splines against boundary elements, and both engines' forces with them."""

import json
from pathlib import Path

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from mujoco import mjx
from support.energy import energy_balance

from iswarm_mj.gripper import mjx_forces, plugin
from iswarm_mj.gripper.bench.model import bench_spec, put_tip
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.tracing import trace_trial
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws import probe_table
from iswarm_mj.gripper.laws.detachment import (
    BALL_DENSITY,
    WORK_OBJECT_SUBSTRATE,
    WORK_TOOL_OBJECT,
    ball_weight,
)
from iswarm_mj.gripper.mjx_forces import first_state, gripper_forces
from iswarm_mj.gripper.mjx_model import mjx_compatible
from iswarm_mj.gripper.tips import shapes, table
from iswarm_mj.gripper.tips.forces import extrapolated_force
from iswarm_mj.utils.errors import UserError

TIP = Path(__file__).parents[2] / "examples/best-tip/tip.json"
RADIUS = 20e-6
VOLTAGE = 25.0
TIP_HEIGHT = 45.0
"""Height of the tip where the probe's slide is 0 [um]."""


@pytest.mark.parametrize(
    ("task", "radius", "gap"),
    [
        ("pick", 20e-6, 0.2e-6),
        ("pick", 17.3e-6, 1.37e-6),
        ("release", 20e-6, 5e-6),
        ("release", 24.1e-6, 0.71e-6),
        pytest.param("pick", 15e-6, 0.2e-6, marks=pytest.mark.slow),
        pytest.param("pick", 25e-6, 7.3e-6, marks=pytest.mark.slow),
        pytest.param("pick", 12e-6, 31e-6, marks=pytest.mark.slow),
        pytest.param("pick", 44e-6, 0.31e-6, marks=pytest.mark.slow),
        pytest.param("release", 13e-6, 3.3e-6, marks=pytest.mark.slow),
        pytest.param("release", 47e-6, 12e-6, marks=pytest.mark.slow),
    ],
)
def test_the_table_agrees_with_boundary_elements_to_one_part_in_a_thousand(task, radius, gap):
    tip = table.read_table(TIP)
    expected = extrapolated_force(tip.profile, radius, gap, task)
    assert tip.force(task, radius, gap) == pytest.approx(expected, rel=1e-3)


def test_capacitances_are_those_whose_slopes_are_the_forces():
    """F = -V^2 / 2 dC / dD, by differences between gaps."""
    tip = table.read_table(TIP)
    spec = bench_spec()
    put_tip(spec, table.read_table(TIP))
    model = spec.compile()
    data = mujoco.MjData(model)
    for task, field in (("pick", "to_probe"), ("release", "to_plate")):
        gap = 2.0
        capacitances = []
        for each in (gap - 0.01, gap + 0.01):
            gaps = (each, 1.0) if task == "pick" else (1.0, each)
            place(model, data, gaps, potential=0)
            capacitances.append(number(model, data, field))
        force = (capacitances[0] - capacitances[1]) / 0.02 / 2 * 1e-9  # fF/um is nN/V^2
        assert force == pytest.approx(tip.force(task, RADIUS, gap * 1e-6), rel=1e-3)


def place(model, data, gaps, potential):
    """Put the ball between tip and plate, at gaps [um], under `VOLTAGE`."""
    mujoco.mj_resetData(model, data)
    tool_gap, plate_gap = gaps
    data.joint("ball").qpos[2] = 20 + plate_gap
    data.joint("probe_z").qpos = 40 + plate_gap + tool_gap - TIP_HEIGHT
    data.actuator("voltage").ctrl = VOLTAGE
    data.plugin_state[plugin.state_index(model, "electrostatic", "potential")] = potential
    mujoco.mj_forward(model, data)


def number(model, data, field):
    return data.plugin_state[plugin.state_index(model, "electrostatic", field)]


@pytest.mark.parametrize(
    ("task", "gap"),
    [
        pytest.param("pick", 0.2, marks=pytest.mark.slow),
        pytest.param("pick", 3.1, marks=pytest.mark.slow),
        ("release", 5.0),
        pytest.param("release", 0.9, marks=pytest.mark.slow),
    ],
)
def test_both_engines_agree_with_boundary_elements(task, gap):
    spec = bench_spec()
    put_tip(spec, table.read_table(TIP))
    model = spec.compile()
    data = mujoco.MjData(model)
    gaps = (gap, 0.5) if task == "pick" else (0.5, gap)
    potential = 0 if task == "pick" else 1
    place(model, data, gaps, potential)
    in_c = abs(number(model, data, "force"))

    forces = gripper_forces(model)
    portable = mjx_compatible(spec)
    model_of_mjx = mjx.put_model(portable, impl="jax")
    moved = mjx.make_data(portable, impl="jax").replace(
        qpos=jnp.asarray(data.qpos), ctrl=jnp.asarray(data.ctrl)
    )
    moved = mjx.kinematics(model_of_mjx, moved)
    state = first_state(forces)._replace(potential=jnp.float32(potential))
    force = jax.jit(mjx_forces.gripper_force)(forces, model_of_mjx, moved, state)

    profile = table.read_table(TIP).profile
    expected = extrapolated_force(profile, RADIUS, gap * 1e-6, task) * VOLTAGE**2 * 1e9
    assert in_c == pytest.approx(expected, rel=1e-3)
    assert abs(float(force.electrostatic)) == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
def test_the_energy_of_a_trial_with_a_tip_is_accounted_for():
    """As with the flat tip: to 1 % of the source's turnover at 1 us, and of the step's order."""
    tip = table.read_table(TIP)
    trial = Trial(
        RADIUS,
        WORK_TOOL_OBJECT * tip.adhesion_share(RADIUS),
        WORK_OBJECT_SUBSTRATE,
        probe_radius=tip.profile.radius,
        tip=str(TIP),
    )
    protocol = Protocol(lift=2e-6, cut_delay=0.04e-3)  # without which the ball returns to the tip
    errors = []
    for timestep in (1e-6, 0.25e-6):
        trace = trace_trial(trial, protocol, 36.0, 5e-6, timestep)
        assert trace.phases[-1] == "rest"
        balance = energy_balance(trace, trial)
        assert balance.turnover > 1e-11
        assert balance.parts["joule"] > 0.05
        errors.append(abs(balance.electrical + balance.mechanical))
    print(f"errors of the balance at 1 and 0.25 us: {errors[0]:.2%}, {errors[1]:.2%}")
    assert errors[0] < 0.01
    assert errors[1] < 0.5 * errors[0]


def coarse_table(monkeypatch):
    """Make a table of a flat tip with few entries."""
    exponents = np.array([-7.0, -5.0, -3.0, -1.0])
    monkeypatch.setattr(table, "GAP_EXPONENTS", exponents)
    monkeypatch.setattr(table, "N_RATIOS", 3)
    counted = []
    made = table.make_table(shapes.flat(13e-6), 0.2e-6, 1, lambda: counted.append(1))
    assert len(counted) == table.n_entries() == 24
    return made


@pytest.mark.slow
def test_the_table_of_a_flat_tip_is_that_of_the_probe(monkeypatch):
    made = coarse_table(monkeypatch)
    for task in ("pick", "release"):
        for row, gap in enumerate(table.GAP_EXPONENTS):
            ratios = 2.0**made.exponents
            expected = probe_table.probe_factor(task, 2.0**gap, ratios)
            np.testing.assert_allclose(getattr(made, task)[row], expected, rtol=5e-4)


def test_a_table_is_read_as_it_was_written(tmp_path, monkeypatch):
    made = coarse_table(monkeypatch)
    table.write_table(made, tmp_path / "tip.json")
    again = table.read_table(tmp_path / "tip.json")
    np.testing.assert_array_equal(again.pick, made.pick)
    np.testing.assert_array_equal(again.release, made.release)
    assert again.profile.radius == made.profile.radius
    assert again is table.read_table(tmp_path / "tip.json")


FACE = {"start_r": [0.0], "start_z": [0.0], "heading": [0.0], "curvature": [0.0], "length": [13e-6]}


@pytest.mark.parametrize(
    "change",
    [
        {"pick": [1.0]},
        {"face": {}},
        {"face": FACE | {"curvature": [0.0, 1.0]}},
        {"face": {name: [] for name in FACE}},
        {"tip_table": 2},
        {"reach": None},
        {"reach": 0.0},
    ],
)
def test_files_that_are_no_tables_are_refused(tmp_path, change):
    content = json.loads(TIP.read_text()) | change
    (tmp_path / "tip.json").write_text(json.dumps(content))
    with pytest.raises(UserError, match="is no table of a tip"):
        table.read_table(tmp_path / "tip.json")


def test_voltages_of_a_table_follow_the_density():
    """The square of the voltage is the deficit over the force."""
    tip = table.read_table(TIP)
    double = 2 * BALL_DENSITY
    weight = ball_weight(RADIUS)

    grasps = [tip.grasp_voltage(RADIUS, 1e-3, 2e-3, 0.2e-6, rho) for rho in (BALL_DENSITY, double)]
    pull = tip.force("pick", RADIUS, 0.2e-6)
    assert (grasps[1] ** 2 - grasps[0] ** 2) * pull == pytest.approx(weight)

    releases = [tip.release_voltage(RADIUS, 1e-3, 5e-6, rho) for rho in (BALL_DENSITY, double)]
    pull = tip.force("release", RADIUS, 5e-6)
    assert (releases[0] ** 2 - releases[1] ** 2) * pull == pytest.approx(weight)


def test_a_numeric_field_that_is_no_table_is_refused():
    for numbers in ([1.0, 2.0], [36.0, 11.0, *[1.0] * 50]):
        spec = bench_spec()
        put_tip(spec, table.read_table(TIP))
        spec.numerics[0].data = numbers
        spec.numerics[0].size = len(numbers)
        with pytest.raises((ValueError, mujoco.FatalError), match="tip is"):
            mujoco.MjData(spec.compile())
