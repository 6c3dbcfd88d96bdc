"""The fast-forwards of `leaps` for trials in a batch: after each step, every trial that can leap does."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Float

from iswarm_mj.engines.mjx.api import mjx
from iswarm_mj.gripper.bench import leap_laws
from iswarm_mj.gripper.bench.leap_laws import REST, Hanging
from iswarm_mj.gripper.bench.model import Layout
from iswarm_mj.gripper.laws.numbers import in_arrays
from iswarm_mj.gripper.mjx_forces import Force, GripperForces, State
from iswarm_mj.gripper.units import CLEARANCE
from iswarm_mj.utils.arrays import Array

_laws = in_arrays(leap_laws, jnp)


class Leap(NamedTuple):
    """The state from which a trial resumes. Units of the bench."""

    qpos: Float[Array, "nq"]
    qvel: Float[Array, "nv"]
    ball: State
    time: Float[Array, ""]
    """Time that the leap skips, 0 for none [ms]."""


def skip_hanging(
    where: Layout, forces: GripperForces, model: mjx.Model, data: mjx.Data, force: Force, limit: Array
) -> Leap:
    """Charge flows while a ball hangs at rest, see `leaps.hang`.

    Args:
        where: numbers are in the model's arrays.
        forces: attributes and ids.
        model: of MJX.
        data: of MJX, after a step.
        force: in that step.
        limit: longest time [ms].
    """
    above, below = _gaps(where, forces, model, data)
    tool, plate = (force.adhesion[k] for k in forces.tool_and_plate)
    hold = tool - plate + model.body_mass[forces.joints[forces.ball][0].body] * model.opt.gravity[2]
    voltage, charge = data.ctrl[where.voltage], force.state.charge
    ball = Hanging(
        voltage,
        force.ball_voltage,
        charge,
        *force.capacitances,
        forces.numbers[forces.circuit, "leak"],
        *force.pulls,
        tool,
        hold,
    )
    rests = (above <= 0) & (below > CLEARANCE) & (jnp.abs(data.qvel[where.ball : where.ball + 3]).max() < REST)
    time = jnp.where(rests, jnp.maximum(_laws.hanging_time(ball, limit, 1.1), 0.0), 0.0)
    later, share = _laws.after_hanging(ball, time)
    leapt = time > 0
    qpos = data.qpos.at[where.ball + 2].add(jnp.where(leapt, above * (1 - share), 0.0))
    state = force.state._replace(charge=jnp.where(leapt, later, charge))
    return Leap(qpos, jnp.where(leapt, 0.0, data.qvel), state, time)


def skip_flight(where: Layout, forces: GripperForces, model: mjx.Model, leap: Leap, volts: Array, limit: Array) -> Leap:
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
    above, below = (gap - CLEARANCE for gap in _gaps(where, forces, model, leap))
    can = (volts == 0) & (leap.ball.charge == 0) & (above > 0) & (below > 0)
    time = _laws.flight_time(rise, above, below, gravity)
    time = jnp.where(can & (time > 2 * model.opt.timestep), jnp.clip(time, 0.0, limit), 0.0)
    path = (leap.qvel[where.ball : where.ball + 3] * time).at[2].add(-gravity * time**2 / 2)
    qpos = leap.qpos.at[where.ball : where.ball + 3].add(path)
    qvel = leap.qvel.at[where.ball + 2].add(-gravity * time)
    return Leap(qpos, qvel, leap.ball, leap.time + time)


def sync_contacts(where: Layout, forces: GripperForces, model: mjx.Model, leap: Leap) -> Leap:
    """Give the contacts the gaps after a leap, so that they take it for no impact."""
    both = _gaps(where, forces, model, leap)
    own = jnp.stack([both[int(pair.surface != forces.probe)] for pair in forces.pairs])
    before = jnp.where(leap.time > 0, own, leap.ball.before)
    rebound = jnp.where(leap.time > 0, 0.0, leap.ball.rebound)
    return leap._replace(ball=leap.ball._replace(before=before, rebound=rebound))


def _gaps(where: Layout, forces: GripperForces, model: mjx.Model, state: mjx.Data | Leap) -> tuple[Array, Array]:
    """Gaps between the tool's face and a ball below it, and between ball and plate, see `leaps` [um]."""
    height, radius = state.qpos[where.ball + 2], model.geom_size[forces.ball, 0]
    return state.qpos[where.slide] + where.tip_height - height - radius, height - radius
