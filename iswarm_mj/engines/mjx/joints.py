"""What MJX's JAX implementation asks of a model's joints while a program is traced, answered at once.

MJX asks for each body anew, joint by joint, which takes minutes for a thousand robots.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from iswarm_mj.engines.mjx.api import mjx, scan

_WIDTH = {mjx.JointType.FREE: 7, mjx.JointType.BALL: 4}
"""Numbers in qpos of joints that have more than one."""


@contextmanager
def quick_trees() -> Iterator[None]:
    """Let MJX use the functions of this module in what is traced inside the block."""
    own = {"_q_bodyid": body_of_positions, "_q_jointid": joint_of_positions}
    before = {name: getattr(scan, name) for name in own}
    for name, function in own.items():
        setattr(scan, name, function)
    try:
        yield
    finally:
        for name, function in before.items():
            setattr(scan, name, function)


def body_of_positions(model: mjx.Model) -> np.ndarray:
    """Body of each number in qpos (nq,)."""
    return np.repeat(model.jnt_bodyid, _widths(model))


def joint_of_positions(model: mjx.Model) -> np.ndarray:
    """Joint of each number in qpos (nq,)."""
    return np.repeat(np.arange(len(model.jnt_type)), _widths(model))


def _widths(model: mjx.Model) -> np.ndarray:
    """How many numbers in qpos each joint has (njnt,)."""
    kind = np.asarray(model.jnt_type)
    widths = np.ones(len(kind), int)
    for joint_type, width in _WIDTH.items():
        widths[kind == joint_type] = width
    return widths
