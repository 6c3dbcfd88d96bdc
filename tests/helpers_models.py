"""The MJCF models as MuJoCo has them. Units: mm, mg, s."""

from pathlib import Path

import mujoco
import numpy as np

MODELS = Path(__file__).resolve().parents[1] / "models"
RD = 2 * np.sqrt(2.0)  # mm
OUTWARD = np.array([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=float)  # sides 0 to 3


def load(name: str) -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(MODELS / name))


def forwarded(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = load(name)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data
