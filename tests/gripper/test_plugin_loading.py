"""The gripper's MuJoCo plugins: their attributes, and the cache of their compiled callbacks."""

import pickle
import re
import runpy
from pathlib import Path

import mujoco
import mujoco.batch
import mujoco.rollout
import numpy as np
import pytest
from numba import types

import iswarm_mj.gripper.plugin as plugin
from iswarm_mj.gripper.native import abi, attributes, callbacks
from iswarm_mj.gripper.native.callbacks import adhesion_callbacks, electrostatic_callbacks
from iswarm_mj.utils.errors import UserError

BENCH = Path(__file__).parents[2] / "models" / "bench.xml"
TEXT = BENCH.read_text(encoding="utf-8")


@pytest.fixture
def model():
    """The bench."""
    return mujoco.MjModel.from_xml_path(str(BENCH))


def enclosed(callback):
    """Return the values that a callback has from the function that made it."""
    return [cell.cell_contents for cell in callback.__wrapped__.__closure__ or ()]


@pytest.mark.parametrize("make", [adhesion_callbacks, electrostatic_callbacks])
def test_what_callbacks_enclose_has_the_same_bytes_in_every_process(make):
    """It is part of the key under which numba caches callbacks.

    Arrays have the same bytes; an object of a class that pickle cannot name has others.
    """
    values = [value for callback in make().values() for value in enclosed(callback)]
    assert values
    for value in values:
        assert isinstance(value, np.ndarray)
        assert pickle.dumps(value) == pickle.dumps(value.copy())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            'key="work" value="14.7"',
            'key="work" value="much"',
            r'iswarm.adhesion: work is "much"; give the work',
        ),
        ('key="work" value="14.7"', 'key="work" value="100%s"', r'work is "100_s"; give'),
        (
            'key="humidity" value="10"',
            'key="humidity" value="110"',
            r'humidity is "110"; give .* 0 to 100',
        ),
        (
            'key="ball" value="ball"',
            'key="ball" value="probe"',
            r'ball is "probe"; give the name of a sphere',
        ),
        (
            'key="voltage" value="voltage"',
            'key="voltage" value="volt"',
            r'voltage is "volt"; give .* an actuator',
        ),
        ('key="contact_gap"', 'key="gap"', r"gap"),
    ],
)
def test_a_wrong_attribute_is_a_load_error_with_a_sentence(old, new, message):
    assert old in TEXT
    with pytest.raises((ValueError, mujoco.FatalError), match=message):
        mujoco.MjModel.from_xml_string(TEXT.replace(old, new))


RK4_REFUSED = "iswarm.adhesion: the integrator is RK4, .*; choose Euler, implicit or implicitfast"


def test_a_model_with_rk4_is_a_load_error_with_a_sentence():
    """RK4 would average the impulse of an impact over its stages."""
    assert 'integrator="Euler"' in TEXT
    with pytest.raises((ValueError, mujoco.FatalError), match=RK4_REFUSED):
        mujoco.MjModel.from_xml_string(TEXT.replace('integrator="Euler"', 'integrator="RK4"'))


def test_a_model_that_changes_to_rk4_is_refused_in_its_next_step(model):
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
    with pytest.raises(mujoco.FatalError, match=RK4_REFUSED):
        mujoco.mj_step(model, data)


def test_unknown_state_fields_are_named(model):
    message = "no 'gaps' of 'adhesion_plate'; choose one of ball of adhesion_plate, "
    with pytest.raises(UserError, match=message):
        plugin.state_index(model, "adhesion_plate", "gaps")


def test_a_release_of_unknown_layout_is_refused_on_import(monkeypatch):
    monkeypatch.setattr(mujoco, "__version__", "4.0.0")
    message = r"need MuJoCo 3.17.0, .* \(got 4.0.0\); pip install mujoco==3.17.0 mujoco-mjx==3.17.0"
    with pytest.raises(UserError, match=message):
        runpy.run_path(abi.__file__)


NUMBA_TYPES = {
    "void": types.void,
    "int": types.int32,
    "const mjModel*": abi.Model,
    "mjData*": abi.Data,
    "mjtNum*": types.CPointer(types.float64),
    "void*": types.intp,
}
"""Types in the declarations of the callbacks: pointers and whole numbers only.

Structs by value, and arguments whose number varies, are passed in other ways on each processor and
system."""


@pytest.mark.parametrize("name", ["nstate", "init", "reset", "compute", "advance"])
def test_callbacks_have_the_signatures_of_the_header(name):
    header = Path(mujoco.__file__).parent / "include" / "mujoco" / "mjplugin.h"
    declaration = rf"(\w+) \(\*{name}\)\((.*)\);"
    result, parameters = re.search(declaration, header.read_text(encoding="utf-8")).groups()
    kinds = [parameter.rpartition(" ")[0] for parameter in parameters.split(", ")]
    expected = NUMBA_TYPES[result](*(NUMBA_TYPES[kind] for kind in kinds))
    assert getattr(callbacks, f"_{name}") == expected


OF_STRINGS = {"const char*": types.int64, "const mjModel*": abi.Model}
"""Types of strings, whose addresses are whole numbers of 64 bits."""


@pytest.mark.parametrize(
    ("function", "is_variadic"),
    [("get_plugin_config", False), ("name_to_id", False), ("error", True)],
)
def test_functions_of_mujoco_are_called_as_they_are_declared(function, is_variadic):
    """A call of `mju_error` without further arguments passes its text as a fixed argument."""
    program = getattr(attributes, f"_{function}")
    header = Path(mujoco.__file__).parent / "include" / "mujoco" / "mujoco.h"
    declaration = rf"MJAPI ([^;]*?)\s*\b{program.symbol}\(([^)]*)\)"
    result, parameters = re.search(declaration, header.read_text(encoding="utf-8")).groups()
    kinds = [result]
    for parameter in parameters.split(", "):
        kinds.append(parameter.rpartition(" ")[0] or parameter)
    assert (kinds[-1] == "...") == is_variadic

    fixed = [kind for kind in kinds if kind != "..."]
    expected = [OF_STRINGS.get(kind) or NUMBA_TYPES[kind] for kind in fixed]
    assert [program.sig.return_type, *program.sig.args] == expected
