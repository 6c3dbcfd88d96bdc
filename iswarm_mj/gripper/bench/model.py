"""The model of the bench, `models/bench.xml`: stripped for speed, sized for a trial, with addresses of its numbers."""

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
from iswarm_mj.gripper.units import DENSITY, MS, NN, PER_OHM, PRESSURE, UM


def bench_spec() -> mujoco.MjSpec:
    """Specification of the bench, without materials, textures, camera, light and idle stages of the physics step."""
    text = (models_directory() / "bench.xml").read_text(encoding="utf-8")
    text = re.sub(r"<asset>.*?</asset>", "", text, flags=re.S)
    text = re.sub(r' material="\w+"|<light .*?/>|<camera .*?/>', "", text)
    spec = mujoco.MjSpec.from_string(text)
    spec.option.disableflags |= sum(int(flag) for flag in _IDLE)
    return spec


_IDLE = (
    mujoco.mjtDisableBit.mjDSBL_SENSOR,
    mujoco.mjtDisableBit.mjDSBL_EQUALITY,
    mujoco.mjtDisableBit.mjDSBL_LIMIT,
    mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS,
)
"""Stages of the physics step that have nothing to do on the bench."""


STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""What a recorded state consists of."""
MEMORY = 2**18
"""Of a bench for contacts and the solver [bytes]; MuJoCo's own choice, 15 MB, takes longer to fill than a trial."""


class Recorded(NamedTuple):
    """T physics steps of a bench one after the other."""

    phases: list[str]
    """Of each step."""
    states: Float[np.ndarray, "T+1 n"]
    """Of MuJoCo, before the first step and after each of them."""


class Layout(NamedTuple):
    """Addresses of the bench's numbers in MuJoCo's arrays."""

    ball: int
    """Of its position in qpos, followed by its quaternion, and of its velocity in qvel."""
    slide: int
    """The probe's height in qpos."""
    tip: int
    """The height's servo in ctrl."""
    aside: int
    """The tool's shift along x in qpos."""
    aside_servo: int
    """In ctrl."""
    voltage: int
    """In ctrl."""
    tip_height: float
    """Height of the tip where the slide is at zero [um]."""


def layout(model: mujoco.MjModel) -> Layout:
    """Layout of a bench."""
    return Layout(
        int(model.joint("ball").qposadr[0]),
        int(model.joint("probe_z").qposadr[0]),
        model.actuator("probe_z").id,
        int(model.joint("probe_x").qposadr[0]),
        model.actuator("probe_x").id,
        model.actuator("voltage").id,
        float(model.body("probe").pos[2]),
    )


def sized(spec: mujoco.MjSpec, trial: Trial) -> mujoco.MjModel:
    """Model with a trial's ball and probe; the trial's other numbers are in `plugin_numbers`."""
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
) -> mujoco.MjModel:
    """The bench with a ball of 20 um of this density [kg/m^3] and this probe [m]; its own time step if None [s]."""
    spec = bench_spec()
    spec.memory = MEMORY
    if timestep is not None:
        spec.option.timestep = timestep / MS
    contacts = Contacts(rolling=rolling)
    return sized(spec, Trial(20e-6, 0.0, 0.0, probe_radius=probe_radius, density=density, contacts=contacts))


@lru_cache(maxsize=64)
def shares(n_steps: int) -> np.ndarray:
    """Shares (n_steps, 2) of the way after each step of a move: of time and voltage, and of the tool."""
    share = np.arange(1, n_steps + 1) / n_steps
    return np.stack([share, minimum_jerk(share)], axis=1)


def resized(
    model: mujoco.MjModel, radius: float, into: tuple[mujoco.MjModel, mujoco.MjData] | None = None
) -> mujoco.MjModel:
    """Copy of a bench's model whose ball has another radius [m]; a fifth of the time that compiling takes.

    Args:
        model: of the bench.
        radius: of the ball.
        into: an earlier copy to overwrite, which takes a tenth of that, and data of it, which are to be reset.
    """
    new, data = into or (copy.copy(model), mujoco.MjData(model))
    geom, body = model.geom("ball").id, model.body("ball").id
    ratio = radius / UM / float(model.geom_size[geom, 0])
    new.geom_size[geom, 0] = new.geom_rbound[geom] = radius / UM
    new.geom_aabb[geom] = model.geom_aabb[geom] * ratio
    new.body_mass[body] = model.body_mass[body] * ratio**3
    new.body_inertia[body] = model.body_inertia[body] * ratio**5
    mujoco.mj_setConst(new, data)
    return new


def plugin_numbers(trial: Trial) -> dict[tuple[str, str], float]:
    """Numbers of a trial by instance and field of the plugins' states."""
    contacts = trial.contacts
    yields = contacts.restitution is None
    impacts = {
        "restitution": contacts.restitution or 0.0,
        "yield_pressure": contacts.yield_pressure / PRESSURE if yields else 0.0,
        "humidity": trial.relative_humidity,
    }
    works = trial.work_object_substrate * UM / NN, trial.work_tool_object * UM / NN
    moduli = contacts.plate_modulus / PRESSURE, contacts.probe_modulus / PRESSURE
    numbers = {
        instance: {"work": work, "modulus": modulus, **impacts}
        for instance, work, modulus in zip(("adhesion_plate", "adhesion_probe"), works, moduli, strict=True)
    }
    numbers["electrostatic"] = {
        "contact_gap": trial.contact_gap / UM,
        "leak": contacts.leak * PER_OHM,
        "contact": contacts.contact * PER_OHM,
        "plate_contact": contacts.plate_contact * PER_OHM,
        "oxide": contacts.oxide / UM,
        "breakdown": contacts.breakdown * UM,
    }
    return {(instance, name): value for instance, values in numbers.items() for name, value in values.items()}


def start(model: mujoco.MjModel, trial: Trial, gaps: tuple[float, float]) -> np.ndarray:
    """Positions (nq,) of ball and tool before a trial, with these gaps of the ball to tool and plate [m]."""
    where, radius, (above, below) = layout(model), trial.radius / UM, gaps
    qpos = np.array(model.qpos0)
    qpos[where.ball + 2] = radius + below / UM
    qpos[where.slide] = 2 * radius + (above + below) / UM - where.tip_height
    qpos[where.aside] = trial.misalignment / UM
    return qpos
