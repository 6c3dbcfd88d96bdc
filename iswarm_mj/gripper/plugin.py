"""MuJoCo engine plugins of the gripper's forces; importing this module registers them.

    import iswarm_mj.gripper.plugin
    model = mujoco.MjModel.from_xml_path("models/bench.xml")

They are passive forces, compiled by Numba, and work in `mj_step`, in the viewer, and in the threads of
`mujoco.rollout` and `mujoco.batch`. Units are those of the bench: um, ug, ms, nN, V; W in nN/um = mJ/m^2.

`iswarm.adhesion` pulls a ball to one surface: with the DMT force 2 pi R W h(RH) while they touch (gap <= 0), and
beyond with the remaining van der Waals attraction, A R / (6 z^2), z = gap + sqrt(A / (12 pi W)), which starts at the
same value and falls to a hundredth of it within about 5 nm. Hence an approaching ball is pulled in only at contact,
while a leaving ball needs the full force: the hysteresis of pull-off. With A = 0 the force ends at contact.

`iswarm.electrostatic` pulls a ball to the probe while it has the plate's potential, and to the plate while it has
the probe's. A ball that touches the plate has the plate's potential, even if the tool touches it too, since the tool's
oxide insulates; the effective electrical gap D_eff of the oxide is the least gap in the law. A lifted ball keeps its
potential until, with the tool in contact, the voltage falls to `off_voltage` or below; from then on it has the
probe's, as does a ball that hangs at the probe after a reset. The law is that of a ball on the probe's axis; off the
axis, gap and direction are those of the closest points. Valid within the range of `probe_table`, clamped beyond.

With `leak` above 0 the potential is instead that of a circuit: the ball carries a charge Q and has the voltage
u = (Q + C_t V) / (C_t + C_p), with the capacitances to probe and plate (`laws.capacitance`); the probe pulls it with
the law of picking at V - u, the plate with that of releasing at u (what both fields do together is left out, see
`tests/gripper/test_capacitance.py`). While it touches the plate, Q relaxes through `plate_contact`; while it touches
the probe, through the oxide's `leak`, and through `contact` after the oxide broke down, which it does where V - u
across its thickness `oxide` exceeds the field `breakdown`. A new touch meets whole oxide.

An impact, a contact that begins, is over within a step: the surface gives the ball the impulse m (1 + e) v, by
`restitution`, or by plastic yield if `yield_pressure` is above 0, less what adhesion keeps if `modulus` is
(`laws.restitution`); where that leaves e = 0 the ball stays, caught by the critically damped contact. A ball that
rebounds does not adhere until it has left, since e holds that loss.

The voltage is the control of an actuator of zero gain, since all engines and the viewer have controls: a column of
`control` in `mujoco.rollout`, a column of `ctrl` in `mujoco.batch` and MJX, a slider in the viewer.

Attributes and results of an instance are numbers in `MjData.plugin_state`, at `state_index`: there a run can change a
work of adhesion or a humidity without compiling another model, and read gaps and forces.
"""

from typing import NamedTuple

import mujoco
import numpy as np

from iswarm_mj.gripper.native.abi import register
from iswarm_mj.gripper.native.attributes import ACTUATOR, GEOM, NUMBER
from iswarm_mj.gripper.native.callbacks import adhesion_callbacks, electrostatic_callbacks, life_cycle
from iswarm_mj.gripper.native.fields import CYLINDER, PLANE, SPHERE
from iswarm_mj.utils.errors import UserError

ADHESION = "iswarm.adhesion"
ELECTROSTATIC = "iswarm.electrostatic"


class Attribute(NamedTuple):
    """An attribute of a plugin instance in MJCF."""

    name: str
    constraint: str
    """The values that are valid, with their unit."""
    kind: int
    low: float = 0.0
    """Least number, or a type of geom."""
    high: float = np.inf
    """Largest number, or another type of geom."""
    default: float = np.nan
    """Number if the attribute is absent; nan: it is required."""


_BALL = Attribute("ball", "the name of a sphere", GEOM, SPHERE, SPHERE)

ATTRIBUTES = {
    ADHESION: (
        _BALL,
        Attribute("surface", "the name of a plane or a cylinder", GEOM, PLANE, CYLINDER),
        Attribute("work", "the work of adhesion at 10 % RH, a number of at least 0 [nN/um]", NUMBER),
        Attribute("humidity", "the relative humidity, a number from 0 to 100 [%]", NUMBER, 0, 100, 10),
        Attribute("hamaker", "the Hamaker constant, a number of at least 0 [nN um]", NUMBER, default=0),
        Attribute("restitution", "the restitution without adhesion, a number from 0 to 1", NUMBER, 0, 1, 0),
        Attribute("yield_pressure", "the yield pressure, a number of at least 0 [nN/um^2]", NUMBER, default=0),
        Attribute("modulus", "the reduced modulus, a number of at least 0 [nN/um^2]", NUMBER, default=0),
    ),
    ELECTROSTATIC: (
        _BALL,
        Attribute("probe", "the name of a cylinder", GEOM, CYLINDER, CYLINDER),
        Attribute("plate", "the name of a plane", GEOM, PLANE, PLANE),
        Attribute("voltage", "the name of an actuator, whose control is the voltage [V]", ACTUATOR),
        Attribute("contact_gap", "the effective gap D_eff of a touching tool, a number from 1e-3 [um]", NUMBER, 1e-3),
        Attribute("off_voltage", "the voltage taken as off, a number of at least 0 [V]", NUMBER, default=1),
        Attribute(
            "leak", "the resistance of a touching tool's oxide, a number of at least 0 [TOhm]", NUMBER, default=0
        ),
        Attribute("contact", "the resistance after breakdown, a number above 0 [TOhm]", NUMBER, 1e-15, default=1e-9),
        Attribute("plate_contact", "the plate's resistance, a number above 0 [TOhm]", NUMBER, 1e-15, default=1e-9),
        Attribute("oxide", "the thickness of the tool's oxide, a number of at least 0 [um]", NUMBER, default=0.07),
        Attribute("breakdown", "the field that breaks it, a number of at least 0 [V/um]", NUMBER, default=1000),
    ),
}
"""Attributes of each plugin, in the order of its state."""

COMPUTED = {
    ADHESION: {"gap": 0.0, "force": 0.0, "before": 0.0, "rebound": 0.0, "impact_speed": 0.0, "impulse": 0.0},
    ELECTROSTATIC: {
        **{"potential": 1.0, "probe_gap": 0.0, "plate_gap": 0.0, "force": 0.0},
        **{"charge": 0.0, "ball_voltage": 0.0, "broken": 0.0, "to_probe": 0.0, "to_plate": 0.0},
        **{"up": 0.0, "down": 0.0},
    },
}
"""Results that follow the attributes in the state, and their values after a reset.

gap, probe_gap, plate_gap [um]; force [nN], positive towards the surface, or towards the probe and negative towards the
plate; potential 0 for the plate's and 1 for the probe's, or the nearer of the two in a circuit; charge [fC] and voltage
of the ball against the plate [V] in a circuit; broken: 1 if the oxide of the present contact broke down; to_probe,
to_plate: the ball's capacitances [fF]; up, down: the two pulls of which `force` is the difference [nN]. Of impacts:
before, the gap one step earlier [um]; rebound, 0 no, 1 going on, 2 begins in this step; speed [um/ms] and impulse
[nN ms] of the last one.
"""


def state_index(model: mujoco.MjModel, instance: str, field: str) -> int:
    """Index of an attribute or a result of a plugin instance in `MjData.plugin_state`.

    Args:
        model: with the instance.
        instance: its name in MJCF.
        field: one of `ATTRIBUTES` or `COMPUTED`.
    """
    number = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_PLUGIN, instance)
    if number < 0:
        raise UserError(f"The model has no plugin instance {instance!r}; name one of its <extension>.")
    for name in ATTRIBUTES:
        known = state_fields(name)
        if model.plugin[number] == SLOTS[name]:
            if field not in known:
                raise UserError(f"The state of {name} has no {field!r}; choose one of {', '.join(known)}.")
            return int(model.plugin_stateadr[number]) + known.index(field)
    raise UserError(f"The plugin instance {instance!r} is none of {', '.join(ATTRIBUTES)}.")


def state_fields(plugin: str) -> tuple[str, ...]:
    """Names of the numbers in the state of a plugin's instance."""
    return (*(attribute.name for attribute in ATTRIBUTES[plugin]), *COMPUTED[plugin])


def _texts(plugin: str) -> np.ndarray:
    """Names and messages of a plugin's attributes (3, n, 256), zero-terminated."""
    rows = [
        (a.name, f'{plugin}: {a.name} is "', f'"; give {a.constraint}, as attribute of the instance.')
        for a in ATTRIBUTES[plugin]
    ]
    return np.array(
        [[list(text.encode().ljust(256, b"\0")) for text in column] for column in zip(*rows, strict=True)], np.uint8
    )


def _register(plugin: str) -> int:
    attributes = ATTRIBUTES[plugin]
    table = np.array([attribute[2:] for attribute in attributes], float)
    callbacks = life_cycle(_texts(plugin), table, np.array(list(COMPUTED[plugin].values())))
    callbacks |= adhesion_callbacks() if plugin == ADHESION else electrostatic_callbacks()
    return register(plugin, [attribute.name for attribute in attributes], callbacks)


SLOTS = {plugin: _register(plugin) for plugin in ATTRIBUTES}
"""Slots of the plugins in MuJoCo's registry."""
