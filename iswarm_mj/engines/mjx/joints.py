"""What MJX's JAX implementation asks of a model's joints while a program is traced, answered at once.

MJX asks for each body anew, joint by joint, which takes minutes for a thousand robots.
"""

from contextlib import AbstractContextManager

import numpy as np

from iswarm_mj.engines.mjx.api import mjx, replaced, scan


def quick_trees() -> AbstractContextManager[None]:
    """Let MJX use the functions of this module in what is traced inside the block."""
    return replaced(vars(scan), {"_q_bodyid": body_of_positions, "_q_jointid": joint_of_positions})


def body_of_positions(model: mjx.Model) -> np.ndarray:
    """Body of each number in qpos (nq,)."""
    return np.repeat(model.jnt_bodyid, _widths(model))


def joint_of_positions(model: mjx.Model) -> np.ndarray:
    """Joint of each number in qpos (nq,)."""
    return np.repeat(np.arange(len(model.jnt_type)), _widths(model))


def _widths(model: mjx.Model) -> np.ndarray:
    """How many numbers in qpos each joint has (njnt,)."""
    kind = np.asarray(model.jnt_type)
    return np.select([kind == mjx.JointType.FREE, kind == mjx.JointType.BALL], [7, 4], 1)
