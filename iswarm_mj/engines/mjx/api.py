"""MJX as the rest of the package uses it, with the few private parts that are needed, and in silence.

Where Warp is not installed, MJX says so on standard output, which is reserved for results.
"""

import contextlib
import io
from collections.abc import Iterator
from typing import Any, cast

import mujoco
import numpy as np

with contextlib.redirect_stdout(io.StringIO()):
    from mujoco import mjx
    from mujoco.mjx._src import collision_driver, scan, solver  # table of contact functions; body trees; solver
    from mujoco.mjx._src.support import mul_m  # the product with the inertia matrix

__all__ = ["collision_driver", "mjx", "mul_m", "put_model", "quick_trees", "replaced", "scan", "solver"]


def put_model(model: mujoco.MjModel, impl: str, device: Any = None) -> mjx.Model:
    """Return MJX's model, with settings of Warp that MuJoCo's model has no place for.

    Its kernels print nothing; by default they print two lines for each search in each world and step that ends at its
    limit, which takes longer than the search. The bits in `overflow` are set all the same. And it finds pairs of geoms
    that are near each other by sorting them, not by comparing each with each.

    Args:
        model: MuJoCo's.
        impl: "jax" or "warp".
        device: where it lies, by default MJX's choice.
    """
    put = mjx.put_model(model, device, impl)
    if impl != "warp":
        return put
    broadphase = type(put.opt._impl.broadphase).SAP_TILE
    return cast(mjx.Model, put.tree_replace({"opt._impl.warn_overflow": 0, "opt._impl.broadphase": broadphase}))


@contextlib.contextmanager
def replaced(table: Any, own: dict[Any, Any]) -> Iterator[None]:
    """Replace entries of a table of MJX's, or names of a module (its `vars`), for what is traced inside the block."""
    before = {key: table[key] for key in own}
    table.update(own)
    try:
        yield
    finally:
        table.update(before)


def quick_trees() -> contextlib.AbstractContextManager[None]:
    """Let MJX ask at once about the joints of a model in what is traced inside the block.

    It asks for each body anew, joint by joint, which takes minutes for a thousand robots.
    """
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
