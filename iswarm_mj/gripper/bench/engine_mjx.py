"""The bench in MJX, for programs of JAX that carry many trials at once."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco

from iswarm_mj.engines.mjx.api import mjx, put_model
from iswarm_mj.gripper import mjx_forces
from iswarm_mj.gripper.bench.model import Layout, bench_spec, layout, plugin_numbers
from iswarm_mj.gripper.bench.script import Watch
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT
from iswarm_mj.gripper.mjx_forces import Force, GripperForces, gripper_force, gripper_forces
from iswarm_mj.gripper.mjx_model import mjx_compatible
from iswarm_mj.gripper.units import MS, UM
from iswarm_mj.utils.arrays import Array

ITERATIONS, LINE_SEARCH = 2, 4
"""Limits of the contact solver: more change no voltage, and single precision never meets MuJoCo's tolerance."""


_IDLE = mujoco.mjtDisableBit.mjDSBL_SPRING | mujoco.mjtDisableBit.mjDSBL_DAMPER
"""Stages that have nothing to do without plugins, which in C are among them."""


class MjxBench(NamedTuple):
    """A bench for programs of JAX, whose ball is that of a usual trial."""

    where: Layout
    """Addresses of the bench's numbers."""
    forces: GripperForces
    model: mjx.Model
    data: mjx.Data
    """At rest, without a voltage."""


def mjx_bench(timestep: float) -> MjxBench:
    """Return the bench with this time step [s]; numbers are single precision."""
    trial = Trial(20e-6, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE)
    chosen = bench_spec()
    chosen.option.iterations, chosen.option.ls_iterations = ITERATIONS, LINE_SEARCH
    chosen.option.disableflags |= int(_IDLE)
    chosen.option.timestep = timestep / MS
    for pair in chosen.pairs:
        pair.friction[3:] = trial.contacts.rolling / UM
    model, portable = chosen.compile(), mjx_compatible(chosen)
    forces = gripper_forces(model).having(single(plugin_numbers(trial)))
    return MjxBench(layout(model), forces, put_model(portable, "jax"), mjx.make_data(portable, impl="jax"))


def single(values: Any) -> Any:
    """Arrays of these numbers in single precision."""
    return jax.tree.map(lambda a: jnp.asarray(a, None if isinstance(a, bool) else jnp.float32), values)


def watched(
    where: Layout,
    bench: tuple[GripperForces, mjx.Model],
    data: mjx.Data,
    ball: mjx_forces.State,
    control: Callable[[Array], Array],
    n_steps: int | Array,
) -> tuple[mjx.Data, Force, Watch]:
    """Take physics steps of one bench and watch its ball; the force is that of the last step.

    Args:
        where: addresses of the bench's numbers.
        bench: forces and model of it.
        data: before the first step.
        ball: what it keeps from before.
        control: from the number of a step, from 0, to its `ctrl` (nu,).
        n_steps: at least one.
    """
    forces, model = bench
    time, (tool, plate) = model.opt.timestep * MS, forces.tool_and_plate

    def step(k: Array, carry: tuple[mjx.Data, Force, Watch]) -> tuple[mjx.Data, Force, Watch]:
        data, force, seen = carry
        data, force = mjx_forces.step(forces, model, data.replace(ctrl=control(k)), force.state)
        gap_tool, gap_plate = force.gaps[tool] * UM, force.gaps[plate] * UM
        begins = (gap_plate <= 0) & jnp.isinf(seen.first_plate)
        seen = seen._replace(
            last_tool=jnp.where(gap_tool <= 0, k * time, seen.last_tool),
            last_plate=jnp.where(gap_plate <= 0, k * time, seen.last_plate),
            first_plate=jnp.where(begins, k * time, seen.first_plate),
            landing_speed=jnp.where(begins, force.landing_speed[plate] * (UM / MS), seen.landing_speed),
            gap_tool=gap_tool,
            gap_plate=gap_plate,
        )
        return data, force, seen

    shapes = jax.eval_shape(partial(gripper_force, forces), model, data, ball)
    force = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), shapes)._replace(state=ball)
    nothing = single(Watch(-jnp.inf, -jnp.inf, jnp.inf, 0.0, jnp.nan, jnp.nan, 0.0, True))
    data, force, seen = jax.lax.fori_loop(0, n_steps, step, (data, force, nothing))
    speed = jnp.linalg.norm(data.qvel[where.ball : where.ball + 3]) * (UM / MS)
    finite = jnp.isfinite(data.qpos).all() & jnp.isfinite(data.qvel).all()
    return data, force, seen._replace(speed=speed, finite=finite)
