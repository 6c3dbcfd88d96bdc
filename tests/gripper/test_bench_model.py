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
CALIBRATED_W = {"adhesion_plate": 14.7, "adhesion_probe": 1.41}


def bench(radius=20.0):
    """Bench with a ball of a radius [um]."""
    spec = mujoco.MjSpec.from_file(str(BENCH))
    spec.geom("ball").size[0] = radius
    spec.body("ball").pos[2] = radius
    spec.body("probe").pos[2] = 2 * radius + 5
    return spec.compile()


def at(model, data, instance, field):
    return data.plugin_state[plugin.state_index(model, instance, field)]


def steps(model, data, duration, **controls):
    for name, value in controls.items():
        data.actuator(name).ctrl = value
    mujoco.mj_step(model, data, nstep=round(duration / model.opt.timestep))


def test_everything_that_carries_units_is_set():
    model, plain = (
        bench(),
        mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>"),
    )
    for name in ("timestep", "sleep_tolerance", "ccd_tolerance"):
        assert getattr(model.opt, name) != getattr(plain.opt, name), name
    assert model.opt.gravity[2] == -9.81
    assert (model.geom_solref[:, 0] < 0.02).all()
    assert (model.geom_friction[:, 1:] != plain.geom_friction[0, 1:]).all()
    assert (model.geom_solimp[:, 2] > plain.geom_solimp[0, 2]).all()
    assert (model.pair_solref[:, 0] >= 2 * model.opt.timestep).all()
    assert model.body_inertia[model.body("ball").id].min() > 1e3 * mujoco.mjMINVAL


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


@pytest.mark.parametrize("radius", [15e-6, 25e-6])
def test_a_resized_model_is_the_one_compiled_at_that_size(radius):
    """But for what nothing on the bench uses: boxes of the midphase, and statistics for the
    view."""
    trial = Trial(
        radius,
        0.0,
        0.0,
        probe_radius=16e-6,
        density=5000.0,
        contacts=Contacts(rolling=3e-9),
    )
    ours, theirs = MujocoBench([trial], 5e-6, 1).model, sized(bench_spec(), trial)
    assert theirs.body("ball").mass[0] == pytest.approx(4 / 3 * np.pi * (radius * 1e6) ** 3 * 5e-6)
    assert theirs.geom("probe").size[0] == 16 and (theirs.pair_friction[:, 3:] == 3e-3).all()
    unlike = {
        name
        for name in dir(theirs)
        if isinstance(getattr(theirs, name), np.ndarray)
        and not np.allclose(getattr(ours, name), getattr(theirs, name), rtol=1e-9, atol=0)
    }
    assert unlike <= {"bvh_aabb", "body_pos", "qpos0", "qpos_spring", "_sizes"}
