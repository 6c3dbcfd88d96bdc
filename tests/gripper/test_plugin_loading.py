"""The gripper's MuJoCo plugins: how they are registered and loaded, and that threads give what one thread gives."""

import ctypes
import pickle
from pathlib import Path

import mujoco
import mujoco.batch
import mujoco.rollout
import numpy as np
import pytest

import iswarm_mj.gripper.plugin as plugin
from iswarm_mj.gripper.native import abi as plugin_abi
from iswarm_mj.gripper.native import attributes as state
from iswarm_mj.utils.errors import UserError

BENCH = Path(__file__).parents[2] / "models" / "bench.xml"
TEXT = BENCH.read_text(encoding="utf-8")
FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS


@pytest.fixture
def model():
    return mujoco.MjModel.from_xml_path(str(BENCH))


def test_fields_lie_where_mujoco_put_them(model):
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    model_fields = ("geom_type", "geom_bodyid", "geom_size", "body_rootid", "dof_parentid", "plugin_stateadr")
    data_fields = ("plugin_state", "ctrl", "geom_xpos", "geom_xmat", "subtree_com", "cdof", "qfrc_passive")
    for struct, names, owner in (("mjModel", model_fields, model), ("mjData", data_fields, data)):
        for name, index in zip(names, plugin_abi.pointer_indices(struct, names), strict=True):
            pointer = ctypes.c_size_t.from_address(owner._address + 8 * int(index)).value
            assert pointer == getattr(owner, name).ctypes.data, name


@pytest.mark.parametrize("places", [state.OF_ADHESION, state.OF_ELECTROSTATIC])
def test_what_callbacks_enclose_has_the_same_bytes_in_every_process(places):
    """They are part of the key under which numba caches callbacks; a class that pickle cannot name has others."""
    assert pickle.loads(pickle.dumps(places)) == places


def starts(model, count):
    """States of balls that hang or lie, with works, voltages and radii all their own."""
    random = np.random.default_rng(3)
    data = mujoco.MjData(model)
    states, controls = [], []
    for i in range(count):
        mujoco.mj_resetData(model, data)
        data.joint("ball").qpos[2] += 5 + 2e-4 if i % 2 else -2e-4
        data.plugin_state[plugin.state_index(model, "adhesion_probe", "work")] = random.uniform(1, 2)
        states.append(np.zeros(mujoco.mj_stateSize(model, FULL)))
        mujoco.mj_getState(model, data, states[-1], FULL)
        voltage = np.linspace(0, random.uniform(30, 70), 300)
        controls.append(np.stack([0 * voltage, np.full(300, data.joint("probe_z").qpos[0]), voltage], axis=1))
    return np.array(states), np.array(controls)


def stepped(model, state, control):
    data = mujoco.MjData(model)
    mujoco.mj_setState(model, data, state, FULL)
    for u in control:
        data.ctrl = u
        mujoco.mj_step(model, data)
    return np.concatenate([data.qpos, data.qvel, data.plugin_state])


def test_threads_of_batch_give_the_same(model):
    states, controls = starts(model, 8)
    batch = mujoco.batch.Batch(model, nsim=8, nthread=2)
    bound = {name: batch.bind(name) for name in ("qpos", "qvel", "plugin_state", "ctrl")}
    data = mujoco.MjData(model)
    for i in range(8):
        mujoco.mj_setState(model, data, states[i], FULL)
        bound["qpos"][i], bound["plugin_state"][i] = data.qpos, data.plugin_state
    for k in range(controls.shape[1]):
        bound["ctrl"][:] = controls[:, k]
        batch.step()
    for i in range(8):
        ours = np.concatenate([bound[name][i] for name in ("qpos", "qvel", "plugin_state")])
        np.testing.assert_array_equal(ours, stepped(model, states[i], controls[i]))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('key="work" value="14.7"', 'key="work" value="much"', r'iswarm.adhesion: work is "much"; give the work'),
        ('key="work" value="14.7"', 'key="work" value="100%s"', r'work is "100_s"; give'),
        ('key="humidity" value="10"', 'key="humidity" value="110"', r'humidity is "110"; give .* 0 to 100'),
        ('key="ball" value="ball"', 'key="ball" value="probe"', r'ball is "probe"; give the name of a sphere'),
        ('key="voltage" value="voltage"', 'key="voltage" value="volt"', r'voltage is "volt"; give .* an actuator'),
        ('key="contact_gap"', 'key="gap"', r"gap"),
    ],
)
def test_a_wrong_attribute_is_a_load_error_with_a_sentence(old, new, message):
    assert old in TEXT
    with pytest.raises((ValueError, mujoco.FatalError), match=message):
        mujoco.MjModel.from_xml_string(TEXT.replace(old, new))


def test_unknown_state_fields_are_named(model):
    with pytest.raises(UserError, match="no 'gaps' of 'adhesion_plate'; choose one of ball of adhesion_plate, "):
        plugin.state_index(model, "adhesion_plate", "gaps")
