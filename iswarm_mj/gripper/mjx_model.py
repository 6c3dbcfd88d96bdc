"""Models of the gripper for MJX: without plugins, and with balls of other sizes."""

import jax.numpy as jnp
import mujoco

from iswarm_mj.engines.mjx.api import mjx
from iswarm_mj.gripper.mjx_forces import GripperForces
from iswarm_mj.utils.arrays import Array


def mjx_compatible(spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a model that every implementation of MJX accepts.

    It has no plugins, and no flags that MJX-Warp lacks.

    MJX-Warp needs no such flags, since it has no midphase and never resets by itself. The
    specification is not changed.

    A cylinder becomes a square prism of its width, since MJX searches contacts of spheres and
    cylinders by descent, which ends 0.1 um off where the sphere is beside the axis. For a ball
    beside the axis along x or y, as under a misaligned tool, the nearest point is the same, and so
    is the contact.
    """
    spec = spec.copy()
    for geom in spec.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_CYLINDER:
            radius, half_length, _ = geom.size
            geom.type = mujoco.mjtGeom.mjGEOM_BOX
            geom.size = (radius, radius, half_length)
    for plugin in list(spec.plugins):
        spec.delete(plugin)
    flags = (mujoco.mjtDisableBit.mjDSBL_MIDPHASE, mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    spec.option.disableflags &= ~sum(int(flag) for flag in flags)
    return spec.compile()


def resize(forces: GripperForces, model: mjx.Model, radius: Array) -> mjx.Model:
    """Return an MJX model whose ball has another radius, mass and inertia.

    The ball is the only geom of a body with a free joint.

    Args:
        forces: of the model.
        model: of `mjx_compatible`.
        radius: radius of the ball [um]; for a batch use `vmap`.
    """
    body = forces.bodies[forces.ball]
    dof = int(model.body_dofadr[body])
    ratio = radius / model.geom_size[forces.ball, 0]
    mass = ratio**3
    inertia = ratio**5
    loose = jnp.repeat(jnp.stack([1 / mass, 1 / inertia]), 3)
    return model.replace(
        geom_size=model.geom_size.at[forces.ball, 0].set(radius),
        geom_rbound=model.geom_rbound.at[forces.ball].set(radius),
        geom_aabb=model.geom_aabb.at[forces.ball].multiply(ratio),
        body_mass=model.body_mass.at[body].multiply(mass),
        body_subtreemass=model.body_subtreemass.at[body].multiply(mass),
        body_inertia=model.body_inertia.at[body].multiply(inertia),
        body_invweight0=model.body_invweight0.at[body].multiply(loose[2:4]),
        dof_invweight0=model.dof_invweight0.at[dof : dof + 6].multiply(loose),
    )
