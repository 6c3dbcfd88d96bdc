"""The leaps of `leaps`, for trials in a batch: at the end of each step, whoever can leap does."""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Bool, Float

from iswarm_mj.gripper.bench.leaps import MARGIN, REST
from iswarm_mj.gripper.bench.model import Layout
from iswarm_mj.gripper.mjx_forces import Force, GripperForces
from iswarm_mj.gripper.units import CLEARANCE
from iswarm_mj.utils.arrays import Array


class Leap(NamedTuple):
    """Where a trial goes on. Units of the bench."""

    qpos: Float[Array, "nq"]
    qvel: Float[Array, "nv"]
    ball: Any
    """`mjx_forces.State`."""
    time: Float[Array, ""]
    """That passes in the leap, 0: there is none [ms]."""


def hung(where: Layout, forces: GripperForces, model: Any, data: Any, force: Force, limit: Array) -> Leap:
    """Charge flows while a ball hangs at rest, see `leaps.hang`.

    Args:
        where: numbers are in the model's arrays.
        forces: attributes and ids.
        model: of MJX.
        data: of MJX, after a step.
        force: in that step.
        limit: longest time [ms].
    """
    voltage, was, (to_probe, to_plate) = data.ctrl[where.voltage], force.ball_voltage, force.capacitances
    above, below = gaps(where, forces, model, data)
    tool, plate = (force.adhesion[k] for k in tool_and_plate(forces))
    total = to_probe + to_plate
    start = (force.state.charge + to_probe * voltage) / total
    is_still = jnp.abs(data.qvel[where.ball : where.ball + 3]).max() < REST
    inside = (was > 0) & (start > 0) & (was < voltage) & (start < voltage)
    can = inside & is_still & (above <= 0) & (below > CLEARANCE) & (forces.leak > 0)
    across = jnp.where(can, voltage - was, 1.0)
    up, down = force.pulls[0] / across**2, force.pulls[1] / jnp.where(can, was, 1.0) ** 2
    still = tool - plate + model.body_mass[forces.joints[forces.ball][0].body] * model.opt.gravity[2]

    def pull(volts: Array) -> Array:
        return still + up * (voltage - volts) ** 2 - down * volts**2

    least = MARGIN * tool
    can &= pull(start) > 1.1 * least
    square = up * voltage**2 + still - least
    root = jnp.sqrt(jnp.maximum((up * voltage) ** 2 - (up - down) * square, 0.0))
    end = square / jnp.maximum(up * voltage + root, 1e-12)
    share = jnp.where(can & (end < voltage), (voltage - start) / jnp.where(end < voltage, voltage - end, 1.0), 1.0)
    relaxation = forces.leak * total
    ever = jnp.where(pull(voltage) <= least, relaxation * jnp.log(jnp.maximum(share, 1.0)), limit)
    time = jnp.where(can, jnp.clip(ever, 0.0, limit), 0.0)
    volts = voltage + (start - voltage) * jnp.exp(-time / jnp.where(can, relaxation, 1.0))
    height = above * (1 - pull(volts) / jnp.where(can, pull(start), 1.0))
    charge = to_plate * volts - to_probe * (voltage - volts)
    qpos = data.qpos.at[where.ball + 2].add(jnp.where(time > 0, height, 0.0))
    ball = force.state._replace(charge=jnp.where(time > 0, charge, force.state.charge))
    return Leap(qpos, jnp.where(time > 0, 0.0, data.qvel), ball, time)


def flown(where: Layout, forces: GripperForces, model: Any, leap: Leap, volts: Array, limit: Array) -> Leap:
    """An uncharged ball flies freely, see `leaps.fly`; it is a sphere, so that its turning does not matter.

    Args:
        where: numbers are in the model's arrays.
        forces: attributes and ids.
        model: of MJX.
        leap: where the trial stands.
        volts: of the tool [V].
        limit: longest time [ms].
    """
    gravity, rise = -model.opt.gravity[2], leap.qvel[where.ball + 2]
    above, below = (gap - CLEARANCE for gap in gaps(where, forces, model, leap))
    can = (volts == 0) & (leap.ball.charge == 0) & (above > 0) & (below > 0)
    falls = (rise + jnp.sqrt(jnp.maximum(rise**2 + 2 * gravity * below, 0.0))) / gravity
    reaches = (rise > 0) & (rise**2 > 2 * gravity * above)
    root = jnp.sqrt(jnp.maximum(rise**2 - 2 * gravity * above, 0.0))
    time = jnp.where(reaches, 2 * above / jnp.where(reaches, rise + root, 1.0), falls)
    time = jnp.where(can & (time > 2 * model.opt.timestep), jnp.clip(time, 0.0, limit), 0.0)
    path = leap.qvel[where.ball : where.ball + 3] * time
    path = path.at[2].add(-gravity * time**2 / 2)
    qpos = leap.qpos.at[where.ball : where.ball + 3].add(path)
    qvel = leap.qvel.at[where.ball + 2].add(-gravity * time)
    return Leap(qpos, qvel, leap.ball, leap.time + time)


def met(where: Layout, forces: GripperForces, model: Any, leap: Leap) -> Leap:
    """What the contacts remember after a leap, so that they take it for no impact."""
    both = gaps(where, forces, model, leap)
    own = jnp.stack([both[int(surface != forces.probe)] for _, surface in forces.pairs])
    leapt: Bool[Array, ""] = leap.time > 0
    before = jnp.where(leapt, own, leap.ball.before)
    rebound = jnp.where(leapt, 0.0, leap.ball.rebound)
    return leap._replace(ball=leap.ball._replace(before=before, rebound=rebound))


def gaps(where: Layout, forces: GripperForces, model: Any, state: Any) -> tuple[Array, Array]:
    """Gaps between the tool's face and a ball below it, and between ball and plate, see `leaps` [um]."""
    height, radius = state.qpos[where.ball + 2], model.geom_size[forces.ball, 0]
    return state.qpos[where.slide] + where.tip_height - height - radius, height - radius


def tool_and_plate(forces: GripperForces) -> tuple[int, int]:
    """Which of the pairs of surfaces are those of the tool and of the plate."""
    surfaces = [surface for _, surface in forces.pairs]
    return surfaces.index(forces.probe), surfaces.index(forces.plate)
