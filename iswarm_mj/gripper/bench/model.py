"""The model of the bench, `models/bench.xml`: stripped for speed and sized for a trial."""

import copy
import re
from functools import lru_cache
from typing import NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float

from iswarm_mj.engines.arena import models_directory
from iswarm_mj.gripper import plugin  # noqa: F401, registers what the model names
from iswarm_mj.gripper.bench.protocol import minimum_jerk
from iswarm_mj.gripper.bench.trial import Contacts, Trial
from iswarm_mj.gripper.laws.detachment import BALL_DENSITY, PROBE_RADIUS
from iswarm_mj.gripper.native.abi import numeric_of_tip
from iswarm_mj.gripper.native.attributes import ELECTROSTATIC
from iswarm_mj.gripper.tips.table import TipTable
from iswarm_mj.gripper.units import DENSITY, MS, NN, PER_OHM, PRESSURE, UM


def bench_spec() -> mujoco.MjSpec:
    """Return the specification of the bench, without looks and idle stages of the physics step."""
    text = (models_directory() / "bench.xml").read_text(encoding="utf-8")
    text = re.sub(r"<asset>.*?</asset>", "", text, flags=re.S)
    text = re.sub(r' material="\w+"|<light .*?/>|<camera .*?/>', "", text)
    spec = mujoco.MjSpec.from_string(text)
    for flag in _IDLE:
        spec.option.disableflags |= int(flag)
    return spec


_IDLE = (
    mujoco.mjtDisableBit.mjDSBL_SENSOR,
    mujoco.mjtDisableBit.mjDSBL_EQUALITY,
    mujoco.mjtDisableBit.mjDSBL_LIMIT,
    mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS,
)
"""Stages of the physics step that have nothing to do on the bench."""

STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""Parts of MuJoCo's state that are recorded."""
MEMORY = 2**18
"""Memory of a bench for contacts and the solver [bytes].

MuJoCo's own choice, 15 MB, takes longer to fill than a trial.
"""


class Recorded(NamedTuple):
    """T successive physics steps of a bench."""

    phases: list[str]
    """Name of the phase of each step."""
    states: Float[np.ndarray, "T+1 n"]
    """States of MuJoCo, before the first step and after each of them."""


class Layout(NamedTuple):
    """Addresses of the bench's numbers in MuJoCo's arrays."""

    ball: int
    """Ball's position in qpos, followed by its quaternion, and its velocity in qvel."""
    slide: int
    """Probe's height in qpos."""
    tip: int
    """Servo of the height in ctrl."""
    aside: int
    """Tool's shift along x in qpos."""
    aside_servo: int
    """Servo of the shift in ctrl."""
    voltage: int
    """Voltage in ctrl."""
    tip_height: float
    """Height of the tip where the slide is at zero [um]."""


def layout(model: mujoco.MjModel) -> Layout:
    """Return the layout of a bench."""
    return Layout(
        ball=int(model.joint("ball").qposadr[0]),
        slide=int(model.joint("probe_z").qposadr[0]),
        tip=model.actuator("probe_z").id,
        aside=int(model.joint("probe_x").qposadr[0]),
        aside_servo=model.actuator("probe_x").id,
        voltage=model.actuator("voltage").id,
        tip_height=float(model.body("probe").pos[2]),
    )


def sized(spec: mujoco.MjSpec, trial: Trial) -> mujoco.MjModel:
    """Compile the model with a trial's ball and probe; `plugin_numbers` has its other numbers."""
    spec.geom("ball").size[0] = trial.radius / UM
    spec.geom("probe").size[0] = trial.probe_radius / UM
    spec.geom("ball").density = trial.density * DENSITY
    for pair in spec.pairs:
        pair.friction[3:] = trial.contacts.rolling / UM
    return spec.compile()


@lru_cache(maxsize=16)
def usual_model(
    timestep: float | None = None,
    probe_radius: float = PROBE_RADIUS,
    density: float = BALL_DENSITY,
    rolling: float = Contacts().rolling,
    tip: TipTable | None = None,
) -> mujoco.MjModel:
    """Return the bench with a ball of 20 um.

    Args:
        timestep: time step [s]; None: that of `models/bench.xml`.
        probe_radius: radius of the tool [m].
        density: of the ball [kg/m^3].
        rolling: see `Contacts.rolling` [m].
        tip: table of another tip than the flat one.
    """
    spec = bench_spec()
    spec.memory = MEMORY
    if tip is not None:
        put_tip(spec, tip)
    if timestep is not None:
        spec.option.timestep = timestep / MS
    trial = Trial(
        radius=20e-6,
        work_tool_object=0.0,
        work_object_substrate=0.0,
        probe_radius=probe_radius,
        density=density,
        contacts=Contacts(rolling=rolling),
    )
    return sized(spec, trial)


def put_tip(spec: mujoco.MjSpec, tip: TipTable) -> None:
    """Put the table of a tip into the specification of a bench, and its radius."""
    numbers = numeric_of_tip(*tip.tables)
    spec.add_numeric(name=_TIP, data=numbers, size=len(numbers))
    spec.geom("probe").size[0] = tip.profile.radius / UM
    for instance in spec.plugins:
        if instance.plugin_name == ELECTROSTATIC:
            instance.config = {**instance.config, "tip": _TIP}


_TIP = "tip"
"""Name of the numeric field with the table of a tip."""


@lru_cache(maxsize=64)
def shares(n_steps: int) -> np.ndarray:
    """Return the shares (n_steps, 2) of the way after each step of a move.

    The first column is that of time and voltage, the second that of the tool.
    """
    share = np.arange(1, n_steps + 1) / n_steps
    return np.stack([share, minimum_jerk(share)], axis=1)


def resized(
    model: mujoco.MjModel, radius: float, into: tuple[mujoco.MjModel, mujoco.MjData] | None = None
) -> mujoco.MjModel:
    """Return a copy of a bench's model whose ball has another radius.

    It takes a fifth of the time of compiling, and a tenth of that into an earlier copy.

    Args:
        model: of the bench.
        radius: of the ball [m].
        into: an earlier copy to overwrite, and data of it, which must be reset then.
    """
    new, data = into or (copy.copy(model), mujoco.MjData(model))
    geom = model.geom("ball").id
    body = model.body("ball").id
    ratio = radius / UM / float(model.geom_size[geom, 0])
    new.geom_size[geom, 0] = radius / UM
    new.geom_rbound[geom] = radius / UM
    new.geom_aabb[geom] = model.geom_aabb[geom] * ratio
    new.body_mass[body] = model.body_mass[body] * ratio**3
    new.body_inertia[body] = model.body_inertia[body] * ratio**5
    mujoco.mj_setConst(new, data)
    return new


def plugin_numbers(trial: Trial) -> dict[tuple[str, str], float]:
    """Return the numbers of a trial in the bench's units, for the plugins' states.

    Lengths are in um, forces in nN, works in nN/um, resistances in ms/fF and fields in V/um.

    Args:
        trial: ball, air and contacts in SI units; the substrate is the plate, the tool the probe.

    Returns:
        Numbers by instance of a plugin and name of its attribute.
    """
    contacts = trial.contacts

    # Without a given restitution it follows from plastic yield. A pressure of 0 turns yield off.
    if contacts.restitution is None:
        restitution = 0.0
        yield_pressure = contacts.yield_pressure / PRESSURE
    else:
        restitution = float(contacts.restitution)
        yield_pressure = 0.0
    impacts = {
        "restitution": restitution,
        "yield_pressure": yield_pressure,
        "humidity": trial.relative_humidity,
    }

    instances = {
        "adhesion_plate": {
            "work": trial.work_object_substrate * UM / NN,
            "modulus": contacts.plate_modulus / PRESSURE,
            **impacts,
        },
        "adhesion_probe": {
            "work": trial.work_tool_object * UM / NN,
            "modulus": contacts.probe_modulus / PRESSURE,
            **impacts,
        },
        "electrostatic": {
            "contact_gap": trial.contact_gap / UM,
            "leak": contacts.leak * PER_OHM,
            "contact": contacts.contact * PER_OHM,
            "plate_contact": contacts.plate_contact * PER_OHM,
            "oxide": contacts.oxide / UM,
            "breakdown": contacts.breakdown * UM,
        },
    }

    numbers = {}
    for instance, values in instances.items():
        for name, value in values.items():
            numbers[instance, name] = value
    return numbers


def start(model: mujoco.MjModel, trial: Trial, gaps: tuple[float, float]) -> np.ndarray:
    """Return the positions (nq,) of ball and tool before a trial.

    Args:
        model: of the bench.
        trial: the ball.
        gaps: of the ball to tool and plate [m].
    """
    where = layout(model)
    radius = trial.radius / UM
    tool_gap, plate_gap = gaps
    qpos = np.array(model.qpos0)
    qpos[where.ball + 2] = radius + plate_gap / UM
    qpos[where.slide] = 2 * radius + (tool_gap + plate_gap) / UM - where.tip_height
    qpos[where.aside] = trial.misalignment / UM
    return qpos
