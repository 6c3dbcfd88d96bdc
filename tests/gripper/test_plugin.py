"""The gripper's MuJoCo plugins against the laws, MuJoCo's own adhesion, and conservation."""

import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

import iswarm_mj.gripper.plugin as plugin
from iswarm_mj.gripper.laws.adhesion import dmt_pull_off, van_der_waals_force
from iswarm_mj.gripper.laws.electrostatics import (
    pick_force,
    release_force,
)

BENCH = Path(__file__).parents[2] / "models" / "bench.xml"
TEXT = BENCH.read_text(encoding="utf-8")

HANGING = """
<mujoco>
  <option timestep="0.001" gravity="0 0 0" cone="elliptic"/>
  {extension}
  <worldbody>
    <geom name="ceiling" type="cylinder" pos="0 0 50" size="13 50" contype="0" conaffinity="0"/>
    <body pos="0 0 -19.9999">
      <freejoint/>
      <geom name="ball" type="sphere" size="20" density="7.4e-6" contype="0" conaffinity="0"/>
    </body>
  </worldbody>
  <contact>
    <pair geom1="ball" geom2="ceiling" condim="6" friction="0.3 0.3 0.03 0.001 0.001" solref="0.005 1"
      solimp="0.98 0.98 0.01 0.5 2" {pair}/>
  </contact>
</mujoco>
"""
DECLARED = """
<extension><plugin plugin="iswarm.adhesion"><instance name="adhesion"><config key="ball" value="ball"/>
<config key="surface" value="ceiling"/><config key="work" value="1.41"/><config key="hamaker" value="{hamaker}"/>
</instance></plugin></extension>
"""
PULL_OFF = 2 * np.pi * 20 * 1.41
MASS = 4 / 3 * np.pi * 20**3 * 7.4e-6


@pytest.fixture
def model():
    return mujoco.MjModel.from_xml_path(str(BENCH))


def at(model, instance, field):
    return plugin.state_index(model, instance, field)


def floating(text=TEXT):
    """Bench whose probe floats freely, without gravity or contacts."""
    text = re.sub(
        r'<joint name="probe_x".*?/>\s*<joint name="probe_z".*?/>',
        '<freejoint name="probe"/>',
        text,
        flags=re.S,
    )
    text = re.sub(r"<contact>.*?</contact>", "", text, flags=re.S)
    text = re.sub(r"<position .*?/>", "", text)
    text = text.replace('gravity="0 0 -9.81"', 'gravity="0 0 0"')
    return mujoco.MjModel.from_xml_string(
        text.replace('joint="probe_z" gainprm', 'joint="probe" gainprm'),
    )


def place(model, data, gap_to_probe, gap_to_plate, on_probe):
    """Put the ball on the probe's axis at two gaps [um], at the probe's potential or the
    plate's."""
    radius = model.geom("ball").size[0]
    start = model.body("probe").pos[2]
    data.joint("ball").qpos[2] = gap_to_plate + radius
    data.joint("probe_z").qpos = gap_to_plate + 2 * radius + gap_to_probe - start
    data.plugin_state[at(model, "electrostatic", "potential")] = on_probe


@pytest.mark.parametrize("load", [0.98, 1.02])
def test_a_hanging_ball_agrees_with_mujocos_own_adhesion(load):
    """The load rises slowly; under tension MuJoCo's own contact opens a little, which its gap
    allows."""
    native = HANGING.format(extension="", pair=f'adhesion="{PULL_OFF}" gap="0.01"')
    ours = [
        HANGING.format(extension=DECLARED.format(hamaker=hamaker), pair="") for hamaker in (0, 1e-4)
    ]
    for text in (native, *ours):
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        for share in np.linspace(0, load, 100):
            model.opt.gravity[2] = -share * PULL_OFF / MASS
            mujoco.mj_step(model, data, nstep=20)
        mujoco.mj_step(model, data, nstep=500)
        assert (data.qpos[2] > -20.001) == (load < 1)
        assert (data.qpos[2] < -21) == (load > 1)


def test_out_of_contact_only_van_der_waals_is_left(model):
    data = mujoco.MjData(model)
    force = at(model, "adhesion_plate", "force")
    for gap in (-0.01, 1e-5, 1e-3, 0.1, 1.0):
        place(model, data, 3, gap, 0)
        mujoco.mj_forward(model, data)
        if gap <= 0:
            expected = dmt_pull_off(20e-6, 14.7e-3) * 1e9
        else:
            offset = np.sqrt(1e-19 / (12 * np.pi * 14.7e-3))
            expected = van_der_waals_force(1e-19, 20e-6, gap * 1e-6 + offset) * 1e9
        assert data.plugin_state[force] == pytest.approx(expected, rel=1e-6)
        if gap >= 0.1:
            assert data.plugin_state[force] < 0.06
    data.plugin_state[at(model, "adhesion_plate", "hamaker")] = 0
    place(model, data, 3, 1e-5, 0)
    mujoco.mj_forward(model, data)
    assert data.plugin_state[force] == 0


@pytest.mark.parametrize("on_probe", [False, True])
def test_electrostatic_force_is_the_laws(model, on_probe):
    data = mujoco.MjData(model)
    random = np.random.default_rng(1)
    for _ in range(100):
        radius, voltage, gap = (
            random.uniform(10, 30),
            random.uniform(-80, 80),
            np.exp(random.uniform(-1.6, 3.2)),
        )
        model.geom("ball").size[0] = radius
        model.geom("probe").size[0] = probe = random.uniform(5, 40)
        place(model, data, -0.001 if on_probe else gap, gap if on_probe else -0.001, on_probe)
        data.actuator("voltage").ctrl = voltage
        for instance in ("adhesion_probe", "adhesion_plate"):
            data.plugin_state[at(model, instance, "work")] = 0
        mujoco.mj_forward(model, data)
        law = release_force if on_probe else pick_force
        expected = (
            (-1 if on_probe else 1) * law(voltage, gap * 1e-6, radius * 1e-6, probe * 1e-6) * 1e9
        )
        assert data.joint("ball").qfrc_passive[2] == pytest.approx(expected, rel=1e-6)
        assert data.joint("ball").qfrc_passive[:2] == pytest.approx(0, abs=1e-12)
        assert data.joint("probe_z").qfrc_passive == pytest.approx(
            0 if on_probe else -expected,
            rel=1e-6,
        )


@pytest.mark.parametrize("voltage", [0, 40])
def test_forces_are_equal_and_opposite(voltage):
    model = floating()
    data = mujoco.MjData(model)
    random = np.random.default_rng(2)
    for _ in range(50):
        data.joint("ball").qpos = [
            *random.normal(0, 6, 2),
            random.uniform(19.9, 26),
            *random.normal(size=4),
        ]
        probe = data.joint("ball").qpos[:3] + np.array(
            [*random.normal(0, 8, 2), random.uniform(19.9, 24)],
        )
        data.joint("probe").qpos = [*probe, 1, *random.normal(0, 0.1, 3)]
        data.plugin_state[at(model, "electrostatic", "potential")] = 0
        data.plugin_state[at(model, "adhesion_plate", "work")] = 0
        data.actuator("voltage").ctrl = voltage
        mujoco.mj_forward(model, data)
        total = np.zeros(6)
        for name in ("ball", "probe"):
            force, torque = np.split(data.joint(name).qfrc_passive, 2)
            body = data.body(name)
            total += [*force, *(body.xmat.reshape(3, 3) @ torque + np.cross(body.xpos, force))]
        largest = np.abs(data.qfrc_passive).max()
        assert largest > 1e-8
        assert np.abs(total).max() < 1e-10 * max(largest, 1e3)
