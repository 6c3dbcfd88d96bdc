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
    <pair geom1="ball" geom2="ceiling" condim="6" friction="0.3 0.3 0.03 0.001 0.001"
      solref="0.005 1" solimp="0.98 0.98 0.01 0.5 2" {pair}/>
  </contact>
</mujoco>
"""
ADHESION = """
<extension>
  <plugin plugin="iswarm.adhesion">
    <instance name="adhesion">
      <config key="ball" value="ball"/>
      <config key="surface" value="ceiling"/>
      <config key="work" value="1.41"/>
      <config key="hamaker" value="{hamaker}"/>
    </instance>
  </plugin>
</extension>
"""
PULL_OFF = 2 * np.pi * 20 * 1.41
"""Pull-off force of a ball of 20 um (DMT) [nN]."""
MASS = 4 / 3 * np.pi * 20**3 * 7.4e-6
"""Mass of that ball [ug]."""


@pytest.fixture
def model():
    """The bench."""
    return mujoco.MjModel.from_xml_path(str(BENCH))


def set_plugins(model, data, numbers):
    """Write numbers into the states of plugins, by instance and field."""
    for (instance, field), value in numbers.items():
        data.plugin_state[plugin.state_index(model, instance, field)] = value


def floating_probe():
    """Return a bench whose probe floats freely, without gravity or contacts."""
    slides = r'<joint name="probe_x".*?/>\s*<joint name="probe_z".*?/>'
    text = re.sub(slides, '<freejoint name="probe"/>', TEXT, flags=re.S)
    text = re.sub(r"<contact>.*?</contact>", "", text, flags=re.S)
    text = re.sub(r"<position .*?/>", "", text)
    text = text.replace('gravity="0 0 -9.81"', 'gravity="0 0 0"')
    text = text.replace('joint="probe_z" gainprm', 'joint="probe" gainprm')
    return mujoco.MjModel.from_xml_string(text)


def place(model, data, gap_to_probe, gap_to_plate, on_probe):
    """Put the ball on the probe's axis, at the probe's potential or the plate's.

    Args:
        model: bench.
        data: its data.
        gap_to_probe: between the ball and the probe [um].
        gap_to_plate: between the ball and the plate [um].
        on_probe: whether the ball has the potential of the probe.
    """
    radius = model.geom("ball").size[0]
    start = model.body("probe").pos[2]
    data.joint("ball").qpos[2] = gap_to_plate + radius
    data.joint("probe_z").qpos = gap_to_plate + 2 * radius + gap_to_probe - start
    set_plugins(model, data, {("electrostatic", "potential"): on_probe})


NATIVE = HANGING.format(extension="", pair=f'adhesion="{PULL_OFF}" gap="0.01"')
"""MuJoCo's own adhesion: under tension the contact opens a little, which its gap allows."""
PLUGIN = HANGING.format(extension=ADHESION.format(hamaker=0), pair="")
WITH_VAN_DER_WAALS = HANGING.format(extension=ADHESION.format(hamaker=1e-4), pair="")


@pytest.mark.parametrize("load", [0.98, 1.02])
def test_a_hanging_ball_agrees_with_mujocos_own_adhesion(load):
    """The load rises slowly to shares of the pull-off force."""
    for text in (NATIVE, PLUGIN, WITH_VAN_DER_WAALS):
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        for share in np.linspace(0, load, 100):
            model.opt.gravity[2] = -share * PULL_OFF / MASS
            mujoco.mj_step(model, data, nstep=20)
        mujoco.mj_step(model, data, nstep=500)

        height = data.qpos[2]
        if load < 1:
            assert height > -20.001
        else:
            assert height < -21


def test_out_of_contact_only_van_der_waals_is_left(model):
    data = mujoco.MjData(model)
    work = 14.7e-3
    hamaker = 1e-19

    def force_at(gap):
        place(model, data, 3, gap, 0)
        mujoco.mj_forward(model, data)
        return data.plugin_state[plugin.state_index(model, "adhesion_plate", "force")]

    in_contact = dmt_pull_off(20e-6, work) * 1e9
    assert force_at(-0.01) == pytest.approx(in_contact, rel=1e-6)

    # The law begins where its force is that of the contact.
    offset = np.sqrt(hamaker / (12 * np.pi * work))
    for gap in (1e-5, 1e-3, 0.1, 1.0):
        expected = van_der_waals_force(hamaker, 20e-6, gap * 1e-6 + offset) * 1e9
        assert force_at(gap) == pytest.approx(expected, rel=1e-6)
        if gap >= 0.1:
            assert force_at(gap) < 0.06

    set_plugins(model, data, {("adhesion_plate", "hamaker"): 0})
    assert force_at(1e-5) == 0


@pytest.mark.parametrize("on_probe", [False, True])
def test_electrostatic_force_is_the_laws(model, on_probe):
    """The ball touches the probe or the plate, and the other one pulls."""
    data = mujoco.MjData(model)
    random = np.random.default_rng(1)
    touching = -0.001
    for _ in range(100):
        radius = random.uniform(10, 30)
        voltage = random.uniform(-80, 80)
        gap = np.exp(random.uniform(-1.6, 3.2))
        probe_radius = random.uniform(5, 40)
        model.geom("ball").size[0] = radius
        model.geom("probe").size[0] = probe_radius
        if on_probe:
            place(model, data, touching, gap, on_probe)
        else:
            place(model, data, gap, touching, on_probe)
        data.actuator("voltage").ctrl = voltage
        set_plugins(model, data, {("adhesion_probe", "work"): 0, ("adhesion_plate", "work"): 0})
        mujoco.mj_forward(model, data)

        law = release_force if on_probe else pick_force
        force = law(voltage, gap * 1e-6, radius * 1e-6, probe_radius * 1e-6) * 1e9
        upward = -force if on_probe else force
        on_ball = data.joint("ball").qfrc_passive
        assert on_ball[2] == pytest.approx(upward, rel=1e-6)
        assert on_ball[:2] == pytest.approx(0, abs=1e-12)
        on_slide = 0 if on_probe else -upward
        assert data.joint("probe_z").qfrc_passive == pytest.approx(on_slide, rel=1e-6)


def place_randomly(random, data):
    """Put the ball near the plate, and the floating probe above it."""
    ball = [*random.normal(0, 6, 2), random.uniform(19.9, 26)]
    turn_of_ball = random.normal(size=4)
    data.joint("ball").qpos = [*ball, *turn_of_ball]
    from_ball = [*random.normal(0, 8, 2), random.uniform(19.9, 24)]
    turn_of_probe = random.normal(0, 0.1, 3)
    data.joint("probe").qpos = [*np.add(ball, from_ball), 1, *turn_of_probe]


@pytest.mark.parametrize("voltage", [0, 40])
def test_forces_are_equal_and_opposite(voltage):
    """Forces on ball and probe, and their moments about the origin, add up to nothing."""
    model = floating_probe()
    data = mujoco.MjData(model)
    random = np.random.default_rng(2)
    for _ in range(50):
        place_randomly(random, data)
        no_plate = {("electrostatic", "potential"): 0, ("adhesion_plate", "work"): 0}
        set_plugins(model, data, no_plate)
        data.actuator("voltage").ctrl = voltage
        mujoco.mj_forward(model, data)

        total_force = np.zeros(3)
        total_moment = np.zeros(3)
        for name in ("ball", "probe"):
            body = data.body(name)
            force, torque = np.split(data.joint(name).qfrc_passive, 2)
            total_force += force
            total_moment += body.xmat.reshape(3, 3) @ torque + np.cross(body.xpos, force)

        largest = np.abs(data.qfrc_passive).max()
        assert largest > 1e-8
        rounding = 1e-10 * max(largest, 1e3)
        assert np.abs(total_force).max() < rounding
        assert np.abs(total_moment).max() < rounding
