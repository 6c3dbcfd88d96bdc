"""MJX for the rest of the package: the public module, and the private parts that are needed.

Importing MJX prints a line where Warp is not installed; standard output is for results, so the
line is discarded here.
"""

import contextlib
import io
from collections.abc import Iterator
from typing import Any, cast

import mujoco
import numpy as np

with contextlib.redirect_stdout(io.StringIO()):
    from mujoco import mjx

    # Table of contact functions; trees of bodies; contact solver; product with the inertia matrix.
    from mujoco.mjx._src import collision_driver, scan, solver
    from mujoco.mjx._src.support import mul_m

__all__ = [
    "collision_driver",
    "mjx",
    "mul_m",
    "put_model",
    "quick_trees",
    "replaced",
    "scan",
    "solver",
]


def put_model(model: mujoco.MjModel, impl: str, device: Any = None) -> mjx.Model:
    """Return MJX's model, with settings of Warp that MuJoCo's model has no place for.

    Args:
        model: MuJoCo's.
        impl: "jax" or "warp".
        device: JAX device of the model, by default MJX's choice.
    """
    mjx_model = mjx.put_model(model, device, impl)
    if impl != "warp":
        return mjx_model

    # By default, kernels print two lines for each line search of the contact solver that ends at
    # its limit of iterations, which takes longer than the search. Without these lines, they set
    # the bits of the data's `overflow` all the same.
    silent = {"opt._impl.warn_overflow": 0}

    # Find pairs of geoms near each other by sorting them, not by comparing each with each. The
    # setting's value leads to its enumeration, which MJX does not export.
    broadphase = type(mjx_model.opt._impl.broadphase)
    sorting = {"opt._impl.broadphase": broadphase.SAP_TILE}
    return cast(mjx.Model, mjx_model.tree_replace(silent | sorting))


@contextlib.contextmanager
def replaced(table: Any, replacements: dict[Any, Any]) -> Iterator[None]:
    """Replace entries of a table of MJX for programs that are traced inside the block.

    Args:
        table: a dictionary, or the `vars` of a module.
        replacements: new entries by key.
    """
    originals = {key: table[key] for key in replacements}
    table.update(replacements)
    try:
        yield
    finally:
        table.update(originals)


def quick_trees() -> contextlib.AbstractContextManager[None]:
    """Let MJX look up the joints of a model at once in programs traced inside the block.

    MJX goes through the joints again for each body, which takes minutes for a thousand robots.
    """
    lookups = {"_q_bodyid": body_of_positions, "_q_jointid": joint_of_positions}
    return replaced(vars(scan), lookups)


def body_of_positions(model: mjx.Model) -> np.ndarray:
    """Return the body of each number in qpos (nq,)."""
    return np.repeat(model.jnt_bodyid, _numbers_per_joint(model))


def joint_of_positions(model: mjx.Model) -> np.ndarray:
    """Return the joint of each number in qpos (nq,)."""
    return np.repeat(np.arange(len(model.jnt_type)), _numbers_per_joint(model))


def _numbers_per_joint(model: mjx.Model) -> np.ndarray:
    """Return how many numbers in qpos each joint has (njnt,)."""
    joint_type = np.asarray(model.jnt_type)
    is_free = joint_type == mjx.JointType.FREE
    is_ball = joint_type == mjx.JointType.BALL
    return np.select([is_free, is_ball], [7, 4], default=1)
