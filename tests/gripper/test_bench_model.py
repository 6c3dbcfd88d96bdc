"""The gripper bench: its units, the stiffness of its contacts, and what its time step does to voltages."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import iswarm_mj.gripper.plugin as plugin
from iswarm_mj.gripper.bench.model import bench_spec, resized, sized
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import ball_weight, grasp_voltage, release_voltage

BENCH = Path(__file__).parents[2] / "models" / "bench.xml"
CALIBRATED_W = {"adhesion_plate": 14.7, "adhesion_probe": 1.41}


def bench(radius=20.0, timestep=None):
    """Bench with a ball of a radius [um]."""
    spec = mujoco.MjSpec.from_file(str(BENCH))
    spec.geom("ball").size[0] = radius
    spec.body("ball").pos[2] = radius
    spec.body("probe").pos[2] = 2 * radius + 5
    spec.option.timestep = timestep or spec.option.timestep
    return spec.compile()


def at(model, data, instance, field):
    return data.plugin_state[plugin.state_index(model, instance, field)]


def steps(model, data, duration, **controls):
    for name, value in controls.items():
        data.actuator(name).ctrl = value
    mujoco.mj_step(model, data, nstep=round(duration / model.opt.timestep))


def is_lifted(model, voltage):
    """Touch the ball, apply the voltage, retract."""
    data = mujoco.MjData(model)
    steps(model, data, 0.3, probe_z=-5.005)
    steps(model, data, 0.2, voltage=voltage)
    for height in np.linspace(-5.005, -4.98, 26):
        steps(model, data, 0.02, probe_z=height)
    steps(model, data, 0.3, probe_z=-4.5)
    return at(model, data, "electrostatic", "plate_gap") > 0.2


def is_let_go(model, voltage):
    """Hang the ball at the probe, 5 um above the plate, and apply the voltage."""
    data = mujoco.MjData(model)
    data.joint("ball").qpos[2] += 5 + 2e-4
    data.joint("probe_z").qpos = -1e-3
    steps(model, data, 0.2)
    for share in (0.5, 0.8, 0.9, 0.95, 1.0):
        steps(model, data, 0.1, voltage=share * voltage)
    steps(model, data, 0.5)
    return at(model, data, "electrostatic", "plate_gap") < 4


def threshold(decide, low, high):
    while high - low > 1e-3 * low:
        middle = (low + high) / 2
        low, high = (low, middle) if decide(middle) else (middle, high)
    return (low + high) / 2


@pytest.mark.parametrize(("radius", "weight"), [(15, 1.02), (20, 2.42), (25, 4.72)])
def test_weight_in_nanonewton(radius, weight):
    model = bench(radius)
    force = model.body("ball").mass[0] * -model.opt.gravity[2]
    assert force == pytest.approx(ball_weight(radius * 1e-6) * 1e9, rel=1e-6)
    assert force == pytest.approx(weight, rel=0.01)


def test_everything_that_carries_units_is_set():
    model, plain = bench(), mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>")
    for name in ("timestep", "sleep_tolerance", "ccd_tolerance"):
        assert getattr(model.opt, name) != getattr(plain.opt, name), name
    assert model.opt.gravity[2] == -9.81
    assert (model.geom_solref[:, 0] < 0.02).all()
    assert (model.geom_friction[:, 1:] != plain.geom_friction[0, 1:]).all()
    assert (model.geom_solimp[:, 2] > plain.geom_solimp[0, 2]).all()
    assert (model.pair_solref[:, 0] >= 2 * model.opt.timestep).all()
    assert model.body_inertia[model.body("ball").id].min() > 1e3 * mujoco.mjMINVAL


def test_two_contacts_and_no_others():
    model = bench()
    data = mujoco.MjData(model)
    steps(model, data, 0.3, probe_z=-5.005)
    assert data.ncon == 2
    steps(model, data, 0.3, probe_z=5)
    steps(model, data, 0.3, probe_x=60)
    steps(model, data, 0.3, probe_z=-60)
    assert data.ncon == 1


@pytest.mark.parametrize("radius", [15, 25])
@pytest.mark.parametrize("held", [False, True])
def test_the_ball_sinks_by_less_than_a_hundredth_of_its_radius(radius, held):
    model = bench(radius)
    data = mujoco.MjData(model)
    for instance, work in CALIBRATED_W.items():
        data.plugin_state[plugin.state_index(model, instance, "work")] = 1.5 * work
        data.plugin_state[plugin.state_index(model, instance, "humidity")] = 50
    steps(model, data, 0.3, probe_z=-5.005)
    steps(model, data, 0.3, probe_z=-4.5 if held else -5.005, voltage=70)
    gaps = [at(model, data, instance, "gap") for instance in CALIBRATED_W]
    assert (gaps[0] > 0.4) == held
    assert at(model, data, "electrostatic", "force") > 9e3
    assert -min(gaps) < 0.01 * radius


def test_a_landing_ball_stays():
    model = bench()
    data = mujoco.MjData(model)
    data.joint("ball").qpos[2] += 4
    steps(model, data, 0.001, probe_z=10)
    data.joint("ball").qvel[2] = -140
    lowest = []
    for _ in range(300):
        mujoco.mj_step(model, data)
        lowest.append(at(model, data, "adhesion_plate", "gap"))
    assert min(lowest) > -0.02 * 20
    assert -0.01 < lowest[-1] < 0
    assert abs(data.joint("ball").qvel[2]) < 1e-3


@pytest.mark.parametrize("radius", [15, 20, 25])
def test_halving_the_time_step_leaves_the_voltages(radius):
    normal, halved = bench(radius), bench(radius, 0.0005)
    expected = grasp_voltage(radius * 1e-6)
    lift = [threshold(lambda v, m=m: is_lifted(m, v), 15, 40) for m in (normal, halved)]
    assert lift[1] == pytest.approx(lift[0], rel=0.01)
    assert lift[0] == pytest.approx(expected, rel=0.01)
    release = [threshold(lambda v, m=m: is_let_go(m, v), 30, 60) for m in (normal, halved)]
    assert release[1] == pytest.approx(release[0], rel=0.01)
    assert release[0] == pytest.approx(release_voltage(radius * 1e-6), rel=0.01)


def test_no_lift_without_contact():
    model = bench()
    data = mujoco.MjData(model)
    steps(model, data, 0.3, probe_z=-4)
    for voltage in np.linspace(0, 50, 51):
        steps(model, data, 0.02, voltage=voltage)
    assert at(model, data, "electrostatic", "plate_gap") < 0


@pytest.mark.parametrize("radius", [15e-6, 25e-6])
def test_a_resized_model_is_the_one_compiled_at_that_size(radius):
    """But for what nothing on the bench uses: boxes of the midphase, and statistics for the view."""
    of = [Trial(size, 0.0, 0.0) for size in (20e-6, radius)]
    ours, theirs = resized(sized(bench_spec(), of[0]), radius), sized(bench_spec(), of[1])
    unlike = {
        name
        for name in dir(theirs)
        if isinstance(getattr(theirs, name), np.ndarray)
        and not np.allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-9, atol=0)
    }
    assert unlike <= {"bvh_aabb", "dof_length", "body_pos", "qpos0", "qpos_spring"}
