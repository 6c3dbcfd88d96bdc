"""MuJoCo engine plugins of the gripper's forces; importing this module registers them.

    from iswarm_mj.gripper import register_plugins

    register_plugins()
    model = mujoco.MjModel.from_xml_path("models/bench.xml")

They are passive forces, compiled by numba, and work in `mj_step`, in the viewer, and in the threads
of `mujoco.rollout` and `mujoco.batch`. Units are those of the bench: um, ug, ms, nN, V; the work of
adhesion W is in nN/um = mJ/m^2.

`iswarm.adhesion` pulls a ball to one surface: with the DMT force 2 pi R W h(RH) while they touch
(gap <= 0), and beyond with the remaining van der Waals attraction, A R / (6 z^2) with
z = gap + sqrt(A / (12 pi W)), which starts at the same value and falls to a hundredth of it within
about 5 nm. Hence an approaching ball is pulled in only at contact, while a leaving ball needs the
full force: the hysteresis of pull-off. With A = 0 the force ends at contact.

`iswarm.electrostatic` pulls a ball to the probe while it has the plate's potential, and to the
plate while it has the probe's. A ball that touches the plate has the plate's potential, even if the
tool touches it too, since the tool's oxide insulates; the effective electrical gap D_eff of the
oxide is the least gap in the law. A lifted ball keeps its potential until, with the tool in
contact, the voltage falls to `off_voltage` or below; from then on it has the probe's, as does a
ball that hangs at the probe after a reset. The law is that of a ball on the probe's axis; off the
axis, gap and direction are those of the closest points. Valid within the range of `probe_table`,
clamped beyond.

With `leak` above 0 the potential is instead that of a circuit: the ball carries a charge Q and has
the voltage u = (Q + C_t V) / (C_t + C_p), with the capacitances to probe and plate
(`laws.probe_table`); the probe pulls it with the law of picking at V - u, the plate with that of
releasing at u. The interaction of both fields is left out (`tests/gripper/test_capacitance.py`).
While it touches the plate, Q relaxes through `plate_contact`; while it touches the probe, through
the oxide's `leak`, and through `contact` after the oxide broke down, which it does where V - u
across its thickness `oxide` exceeds the field `breakdown`. A new touch meets whole oxide.

An impact, a contact that begins, is over within a step: the surface gives the ball the impulse
m (1 + e) v. The restitution e is `restitution`, or that of plastic yield if `yield_pressure` is
above 0, less the loss by adhesion if `modulus` is (`laws.restitution`). A ball with e = 0 stays,
caught by the critically damped contact. A ball that rebounds does not adhere until it has left,
since e includes that loss. RK4 would average the impulse over its stages, so that adhesion refuses
this integrator.

The voltage is the control of an actuator of zero gain, since all engines and the viewer have
controls: a column of `control` in `mujoco.rollout`, a column of `ctrl` in `mujoco.batch` and MJX, a
slider in the viewer.

Attributes and results of an instance are numbers in `MjData.plugin_state`, at `state_index`: there
a run can change a work of adhesion or a humidity without compiling another model, and read gaps and
forces.
"""

import mujoco
import numpy as np

from iswarm_mj.gripper.native.abi import register
from iswarm_mj.gripper.native.attributes import ADHESION, ATTRIBUTES, RESULTS, state_fields
from iswarm_mj.gripper.native.callbacks import (
    adhesion_callbacks,
    electrostatic_callbacks,
    life_cycle,
)
from iswarm_mj.utils.errors import UserError


def state_index(model: mujoco.MjModel, instance: str, field: str) -> int:
    """Return the place of an attribute or a result of a plugin instance in `MjData.plugin_state`.

    Args:
        model: has the instance.
        instance: its name in the MJCF file.
        field: one of `ATTRIBUTES` or `RESULTS`; an error lists them.
    """
    known = state_indices(model)
    if (instance, field) not in known:
        choices = ", ".join(f"{field} of {instance}" for instance, field in known) or "none"
        raise UserError(
            f"The model's plugins have no {field!r} of {instance!r}; choose one of {choices}.",
        )
    return known[instance, field]


def state_indices(model: mujoco.MjModel) -> dict[tuple[str, str], int]:
    """Return the places in `MjData.plugin_state` of all numbers, by instance and field."""
    plugin_of_slot = {slot: plugin for plugin, slot in SLOTS.items()}
    indices = {}
    for number, slot in enumerate(model.plugin):
        if slot not in plugin_of_slot:
            continue
        instance = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_PLUGIN, number)
        first = int(model.plugin_stateadr[number])
        for k, field in enumerate(state_fields(plugin_of_slot[slot])):
            indices[instance, field] = first + k
    return indices


_TEXT_BYTES = 256
"""Bytes of each text that callbacks read, the terminating zero included."""


def _texts(plugin: str) -> np.ndarray:
    """Return the texts on a plugin's attributes for `life_cycle` (3, n, 256), zero-terminated."""
    attributes = ATTRIBUTES[plugin]
    names = []
    before = []
    after = []
    for attribute in attributes:
        names.append(attribute.name)
        before.append(f'{plugin}: {attribute.name} is "')
        after.append(f'"; give {attribute.constraint}, as attribute of the instance.')

    texts = [text.encode().ljust(_TEXT_BYTES, b"\0") for text in (*names, *before, *after)]
    characters = np.frombuffer(b"".join(texts), np.uint8)
    return characters.reshape(3, len(attributes), _TEXT_BYTES).copy()


def _register(plugin: str) -> int:
    """Register a plugin in MuJoCo, and return its slot."""
    attributes = ATTRIBUTES[plugin]
    table = [(row.kind, row.low, row.high, row.default) for row in attributes]
    start = [result.after_reset for result in RESULTS[plugin]]
    callbacks = life_cycle(_texts(plugin), np.array(table, float), np.array(start))
    callbacks |= adhesion_callbacks() if plugin == ADHESION else electrostatic_callbacks()
    return register(plugin, [attribute.name for attribute in attributes], callbacks)


SLOTS = {plugin: _register(plugin) for plugin in ATTRIBUTES}
"""Slots of the plugins in MuJoCo's registry."""


def register_plugins() -> dict[str, int]:
    """Register the plugins of the gripper's forces in MuJoCo, and return their slots.

    The first import of this module registers them, since MuJoCo takes each plugin once; calls only
    return the slots.
    """
    return SLOTS
