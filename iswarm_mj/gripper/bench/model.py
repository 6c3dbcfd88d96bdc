"""The bench of `models/bench.xml` for trials in numbers: no pictures, one model a size, and where its numbers lie."""

import re
from typing import NamedTuple

import mujoco
import numpy as np

from iswarm_mj.engines.arena import models_directory
from iswarm_mj.gripper import plugin
from iswarm_mj.gripper.bench.trial import Trial

UM, MS, NN = 1e-6, 1e-3, 1e-9
"""Units of the bench: length [m], time [s], force [N]."""


def bench_spec(visual: bool = False) -> mujoco.MjSpec:
    """Specification of the bench.

    For pictures it is the file's. Otherwise materials, textures, camera and light are left out, and the stages of a
    physics step that have nothing to do here are switched off; the physics is the same.
    """
    text = (models_directory() / "bench.xml").read_text(encoding="utf-8")
    if not visual:
        text = re.sub(r"<asset>.*?</asset>", "", text, flags=re.S)
        text = re.sub(r' material="\w+"|<light .*?/>|<camera .*?/>', "", text)
    spec = mujoco.MjSpec.from_string(text)
    if not visual:
        spec.option.disableflags |= sum(int(flag) for flag in _IDLE)
    return spec


_IDLE = (
    mujoco.mjtDisableBit.mjDSBL_SENSOR,
    mujoco.mjtDisableBit.mjDSBL_EQUALITY,
    mujoco.mjtDisableBit.mjDSBL_LIMIT,
    mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS,
)
"""Of these the bench has none."""


class Layout(NamedTuple):
    """Where the numbers of a bench lie in MuJoCo's arrays."""

    ball: int
    """Its position in qpos, then its quaternion; its velocity in qvel."""
    slide: int
    """The probe's height in qpos."""
    tip: int
    """The height's servo in ctrl."""
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
        model.actuator("voltage").id,
        float(model.body("probe").pos[2]),
    )


def sized(spec: mujoco.MjSpec, trial: Trial) -> mujoco.MjModel:
    """Model with a trial's ball and probe; what else a trial tells is in `plugin_values`."""
    spec.geom("ball").size[0] = trial.radius / UM
    spec.geom("probe").size[0] = trial.probe_radius / UM
    return spec.compile()


def plugin_values(model: mujoco.MjModel, trial: Trial) -> dict[int, float]:
    """Numbers of a trial by their index in `MjData.plugin_state`."""
    works = {"adhesion_plate": trial.work_object_substrate, "adhesion_probe": trial.work_tool_object}
    values = {plugin.state_index(model, name, "work"): work * UM / NN for name, work in works.items()}
    values |= {plugin.state_index(model, name, "humidity"): trial.relative_humidity for name in works}
    return values | {plugin.state_index(model, "electrostatic", "contact_gap"): trial.contact_gap / UM}


def start(model: mujoco.MjModel, trial: Trial, start_gap: float) -> tuple[np.ndarray, float]:
    """Positions (nq,) of ball and tool before a trial, and the height of the tip's first touch [um]."""
    where, radius = layout(model), trial.radius / UM
    qpos = np.array(model.qpos0)
    qpos[where.ball + 2] = radius - SINK
    touch = 2 * radius
    qpos[where.slide] = touch + start_gap / UM - where.tip_height
    return qpos, touch


SINK = 2e-4
"""Depth by which a ball starts pressed into the plate, so that it touches [um]."""
