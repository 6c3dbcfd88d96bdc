"""Derivatives of contact forces, for MJX's JAX implementation.

The contact solver searches the accelerations a at which the gradient of its convex cost vanishes,

    g(a) = M a - f - J^T F(J a - a_ref) = 0.

Derivatives of the search itself are worthless: its last steps divide differences by differences
that are about zero. Derivatives of its result follow from the equation (implicit function
theorem): H da = -dg, where H = M + J^T D J over the active contacts, as in Newton's method.
Without derivatives the program is MJX's own.

Forward mode (`jax.jvp`, `jax.jacfwd`) goes through whole control steps, and reverse mode through
`MjxEngine.move` but not through sight, whose search is a loop of unknown length. A derivative is
that of the branch which the run took: it does not include contacts, links, message bits or
decisions that would come about nearby, where the outcome jumps. Messages are rounded, so
derivatives do not pass through them. In crowds a derivative needs a solver that has converged: in
single precision it is some per cent off after four control steps; in double precision, where the
solver's tolerance can be zero, it agrees with differences to 1e-5.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager

import jax
import jax.numpy as jnp

from iswarm_mj.engines.mjx.api import mjx, mul_m, replaced, solver
from iswarm_mj.utils.arrays import Array


def implicit_contacts() -> AbstractContextManager[None]:
    """Let MJX-JAX differentiate contact forces by this module in what is traced in the block."""
    search = solver.solve

    def solve(model: mjx.Model, data: mjx.Data) -> mjx.Data:
        return _solve(search, model, data)

    return replaced(vars(solver), {"solve": solve})


def _solve(
    search: Callable[[mjx.Model, mjx.Data], mjx.Data],
    model: mjx.Model,
    data: mjx.Data,
) -> mjx.Data:
    """Return the data with accelerations and contact forces, and their derivatives.

    Args:
        search: MJX's own contact solver, which finds them.
        model: MJX's.
        data: before the solver.
    """
    rows = data._impl

    def gradient(acceleration: jax.Array) -> jax.Array:
        """Return g(a) [nN]: contacts push only, friction is limited."""
        deviation = rows.efc_J @ acceleration - rows.efc_aref
        limit = rows.efc_frictionloss
        linear_force = -rows.efc_D * deviation
        friction = jnp.clip(linear_force, -limit, limit)
        push = jnp.where(deviation < 0, linear_force, 0.0)
        force = jnp.where(limit > 0, friction, push)
        return mul_m(model, data, acceleration) - data.qfrc_smooth - rows.efc_J.T @ force

    def find_root(_: Callable[[Array], Array], __: Array) -> tuple[Array, tuple[Array, Array]]:
        solved = search(model, data)
        return solved.qacc, (solved.qfrc_constraint, solved._impl.efc_force)

    def solve_linear(product: Callable[[Array], Array], right: Array) -> Array:
        matrix = jax.jacfwd(product)(right)
        return jax.scipy.linalg.solve(matrix, right, assume_a="pos")

    acceleration, (joint_force, row_force) = jax.lax.custom_root(
        f=gradient,
        initial_guess=data.qacc_smooth,
        solve=find_root,
        tangent_solve=solve_linear,
        has_aux=True,
    )
    return data.replace(
        qacc=acceleration,
        qfrc_constraint=joint_force,
        _impl=rows.replace(efc_force=row_force),
    )
