"""Derivatives of contact forces, for MJX's JAX implementation.

The contact solver searches the accelerations a at which the gradient of its convex cost vanishes,

    g(a) = M a - f - J^T F(J a - a_ref) = 0.

Derivatives of the search itself are worthless: its last steps divide differences by differences that are about
zero. Those of what it finds follow from the equation (implicit function theorem): H da = -dg, where H = M + J^T D J
over the active contacts, as in Newton's method. Without derivatives the program is MJX's own.

So forward mode (`jax.jvp`, `jax.jacfwd`) goes through whole control steps, and reverse mode through `MjxEngine.move`
but not through sight, whose search is a loop of unknown length. A derivative is that of the branch which the run took:
it does not know that another contact, link, message bit or decision would come about nearby, where the outcome jumps.
Pack and unpack of messages round, and pass nothing on. In crowds a derivative needs a solver that went to the end: in
single precision it is some per cent off after four control steps, in double precision, where the solver's tolerance
can be zero, it agrees with differences to 1e-5.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager

import jax
import jax.numpy as jnp

from iswarm_mj.engines.mjx.api import mjx, mul_m, replaced, solver
from iswarm_mj.utils.arrays import Array


def implicit_contacts() -> AbstractContextManager[None]:
    """Let MJX-JAX differentiate contact forces by this module in what is traced inside the block."""
    search = solver.solve

    def solve(model: mjx.Model, data: mjx.Data) -> mjx.Data:
        return _solve(search, model, data)

    return replaced(vars(solver), {"solve": solve})


def _solve(search: Callable[[mjx.Model, mjx.Data], mjx.Data], model: mjx.Model, data: mjx.Data) -> mjx.Data:
    """Accelerations and contact forces as `search` finds them, with the accelerations' derivatives."""
    rows = data._impl

    def gradient(acceleration: jax.Array) -> jax.Array:
        beyond = rows.efc_J @ acceleration - rows.efc_aref
        most, pull = rows.efc_frictionloss, -rows.efc_D * beyond
        force = jnp.where(most > 0, jnp.clip(pull, -most, most), jnp.where(beyond < 0, pull, 0.0))
        return mul_m(model, data, acceleration) - data.qfrc_smooth - rows.efc_J.T @ force

    def find(_: Callable[[Array], Array], __: Array) -> tuple[Array, tuple[Array, Array]]:
        new = search(model, data)
        return new.qacc, (new.qfrc_constraint, new._impl.efc_force)

    def solve_linear(product: Callable[[Array], Array], right: Array) -> Array:
        return jax.scipy.linalg.solve(jax.jacfwd(product)(right), right, assume_a="pos")

    acceleration, (force, of_rows) = jax.lax.custom_root(gradient, data.qacc_smooth, find, solve_linear, has_aux=True)
    return data.replace(qacc=acceleration, qfrc_constraint=force, _impl=rows.replace(efc_force=of_rows))
