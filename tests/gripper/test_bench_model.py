"""The gripper bench: its units, the stiffness of its contacts, and balls of other sizes."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

import iswarm_mj.gripper.plugin as plugin
from iswarm_mj.gripper.bench.engine_mujoco import MujocoBench
from iswarm_mj.gripper.bench.model import bench_spec, sized
from iswarm_mj.gripper.bench.trial import Contacts, Trial

BENCH = Path(__file__).parents[2] / "models" / "bench.xml"
CALIBRATED_WORK = {"adhesion_plate": 14.7, "adhesion_probe": 1.41}
"""Works of adhesion by the instances of the plugin [mJ/m^2]."""
FIRST_TOUCH = -5.0
"""Slide of the probe at which the tool touches the ball [um]."""


def bench(radius=20.0):
    """Return the model of a bench with a ball of a radius [um], 5 um below the tool."""
    spec = mujoco.MjSpec.from_file(str(BENCH))
    spec.geom("ball").size[0] = radius
    spec.body("ball").pos[2] = radius
    spec.body("probe").pos[2] = 2 * radius + 5
    return spec.compile()


def plugin_number(model, data, instance, field):
    """Return a number of a plugin's state."""
    return data.plugin_state[plugin.state_index(model, instance, field)]


def move(model, data, duration, **controls):
    """Take physics steps for a duration [ms], with controls by the names of the actuators."""
    for name, value in controls.items():
        data.actuator(name).ctrl = value
    mujoco.mj_step(model, data, nstep=round(duration / model.opt.timestep))


def test_everything_that_carries_units_is_set():
    """Defaults of MuJoCo are for metres and kilograms."""
    model = bench()
    plain_xml = "<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"
    plain = mujoco.MjModel.from_xml_string(plain_xml)

    for name in ("timestep", "sleep_tolerance", "ccd_tolerance"):
        assert getattr(model.opt, name) != getattr(plain.opt, name), name
    assert model.opt.gravity[2] == -9.81
    assert (model.geom_solref[:, 0] < 0.02).all()
    assert (model.geom_friction[:, 1:] != plain.geom_friction[0, 1:]).all()
    assert (model.geom_solimp[:, 2] > plain.geom_solimp[0, 2]).all()
    assert (model.pair_solref[:, 0] >= 2 * model.opt.timestep).all()
    assert model.body_inertia[model.body("ball").id].min() > 1e3 * mujoco.mjMINVAL


@pytest.mark.parametrize("radius", [15, 25])
@pytest.mark.parametrize("is_lifted", [False, True])
def test_the_ball_sinks_by_less_than_a_hundredth_of_its_radius(radius, is_lifted):
    model = bench(radius)
    data = mujoco.MjData(model)
    for instance, work in CALIBRATED_WORK.items():
        data.plugin_state[plugin.state_index(model, instance, "work")] = 1.5 * work
        data.plugin_state[plugin.state_index(model, instance, "humidity")] = 50

    pressed = FIRST_TOUCH - 0.005
    move(model, data, 0.3, probe_z=pressed)
    move(model, data, 0.3, probe_z=FIRST_TOUCH + 0.5 if is_lifted else pressed, voltage=70)

    gaps = [plugin_number(model, data, instance, "gap") for instance in CALIBRATED_WORK]
    gap_to_plate = gaps[0]
    assert (gap_to_plate > 0.4) == is_lifted
    assert plugin_number(model, data, "electrostatic", "force") > 9e3
    assert -min(gaps) < 0.01 * radius


UNUSED = {"bvh_aabb", "body_pos", "qpos0", "qpos_spring", "_sizes"}
"""Fields of a model that nothing on the bench uses: boxes of the midphase, statistics for views."""


@pytest.mark.parametrize("radius", [15e-6, 25e-6])
def test_a_resized_model_is_the_one_compiled_at_that_size(radius):
    contacts = Contacts(rolling=3e-9)
    trial = Trial(radius, 0.0, 0.0, probe_radius=16e-6, density=5000.0, contacts=contacts)
    compiled = sized(bench_spec(), trial)
    mass = 4 / 3 * np.pi * (radius * 1e6) ** 3 * 5e-6
    assert compiled.body("ball").mass[0] == pytest.approx(mass)
    assert compiled.geom("probe").size[0] == 16
    assert (compiled.pair_friction[:, 3:] == 3e-3).all()

    resized = MujocoBench([trial], 5e-6, 1).model
    different = set()
    for name in dir(compiled):
        expected = getattr(compiled, name)
        if not isinstance(expected, np.ndarray):
            continue
        if not np.allclose(getattr(resized, name), expected, rtol=1e-9, atol=0):
            different.add(name)
    assert different <= UNUSED
