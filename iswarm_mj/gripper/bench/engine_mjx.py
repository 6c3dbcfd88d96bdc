"""Benches in MJX: one compiled program moves all of them; between moves only their states are kept."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Float

from iswarm_mj.engines.mjx.api import mjx, put_model
from iswarm_mj.gripper import mjx_forces
from iswarm_mj.gripper.bench.base import Mask, Voltages, Watch
from iswarm_mj.gripper.bench.model import Layout, bench_spec, layout, plugin_numbers, start
from iswarm_mj.gripper.bench.protocol import minimum_jerk
from iswarm_mj.gripper.bench.script import first_gaps
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import BALL_DENSITY
from iswarm_mj.gripper.mjx_forces import Force, GripperForces, first_state, gripper_force, gripper_forces
from iswarm_mj.gripper.mjx_model import mjx_compatible, resize
from iswarm_mj.gripper.units import MS, UM
from iswarm_mj.utils.arrays import Array

N_CONTACTS, N_ROWS = 4, 24
"""Capacity of a bench in MJX-Warp: contacts and rows of constraints."""

ITERATIONS, LINE_SEARCH = 2, 4
"""Limits of the contact solver: more change no voltage, and single precision never meets MuJoCo's tolerance."""


_IDLE = mujoco.mjtDisableBit.mjDSBL_SPRING | mujoco.mjtDisableBit.mjDSBL_DAMPER
"""Stages that have nothing to do without plugins, which in C are among them."""


class Physics(NamedTuple):
    """What all benches share."""

    forces: GripperForces
    model: mjx.Model
    data: mjx.Data
    """From which each move starts."""


class State(NamedTuple):
    """State of a bench between two moves; see MuJoCo for the fields."""

    qpos: Array
    qvel: Array
    qacc_warmstart: Array
    ctrl: Array
    ball: mjx_forces.State


class Parameters(NamedTuple):
    """What differs between benches. Units: um, nN."""

    radius: Array
    probe_radius: Array
    density: Array
    """Of the ball over that of the model."""
    numbers: dict[tuple[str, str], Array]
    """Of `GripperForces`."""


class MjxBench:
    """`Bench` in MJX, with `impl` "jax" or "warp"; numbers are single precision.

    Attributes:
        where: addresses of the bench's numbers.
        physics: what all benches share.
        parameters: what differs between them.
    """

    def __init__(
        self,
        trials: Sequence[Trial],
        start_gap: float,
        impl: str = "jax",
        timestep: float | None = None,
    ):
        """Place the balls; arguments as of `MujocoBench`. The first trial's rolling friction is that of all."""
        chosen = bench_spec()
        chosen.option.iterations, chosen.option.ls_iterations = ITERATIONS, LINE_SEARCH
        chosen.option.disableflags |= int(_IDLE)
        if timestep is not None:
            chosen.option.timestep = timestep / MS
        for pair in chosen.pairs:
            pair.friction[3:] = trials[0].contacts.rolling / UM
        model, portable, count = chosen.compile(), mjx_compatible(chosen), len(trials)
        self.timestep = float(model.opt.timestep) * MS
        self.steps = 0
        self.where, forces = layout(model), gripper_forces(model)
        capacity: dict[str, Any] = {"naconmax": N_CONTACTS * count, "njmax": N_ROWS} if impl == "warp" else {}
        self.physics = Physics(forces, put_model(portable, impl), mjx.make_data(portable, impl=impl, **capacity))
        rows: list[Any] = [
            (trial.radius / UM, trial.probe_radius / UM, trial.density / BALL_DENSITY, plugin_numbers(trial))
            for trial in trials
        ]
        self.parameters = _single(Parameters(*jax.tree.map(lambda *values: np.array(values), *rows)))
        qpos = np.array([start(model, trial, first_gaps(start_gap)) for trial in trials])
        self._touch = np.array([2 * trial.radius / UM for trial in trials])
        still, ctrl = np.zeros((count, model.nv)), np.zeros((count, model.nu))
        ball = jax.tree.map(lambda a: np.repeat(np.asarray(a)[None], count, axis=0), first_state(forces))
        ctrl[:, self.where.tip] = qpos[:, self.where.slide]
        ctrl[:, self.where.aside_servo] = self._start = qpos[:, self.where.aside]
        self._state = _single(State(qpos, still, still, ctrl, ball))

    def move(
        self,
        phase: str,
        duration: float,
        tip: float,
        voltage: Voltages,
        active: Mask | None = None,
        aside: float | None = None,
    ) -> Watch:
        """See `Bench.move`; benches that are not active move as well."""
        del phase, active
        n_steps = max(1, round(duration / self.timestep))
        self.steps += n_steps * len(self._touch)
        end = np.zeros((len(self._touch), 3))
        end[:, 0] = self._touch + tip / UM - self.where.tip_height
        end[:, 1] = voltage
        end[:, 2] = np.nan if aside is None else self._start + aside / UM
        with jax.default_matmul_precision("highest"):
            target = jnp.asarray(end, jnp.float32)
            self._state, watch = _advance(self.where, self.physics, self.parameters, self._state, target, n_steps)
        return Watch(*(values if values.dtype == bool else values.astype(float) for values in jax.device_get(watch)))

    def off_axis(self) -> Float[np.ndarray, "B"]:
        """See `Bench.off_axis`."""
        qpos = np.asarray(self._state.qpos, float)
        return (qpos[:, self.where.ball] - qpos[:, self.where.aside]) * UM

    def save(self) -> State:
        """See `Bench.save`."""
        return self._state

    def restore(self, state: State) -> None:
        """See `Bench.restore`."""
        self._state = state


def _single(arrays):
    return jax.tree.map(lambda array: jnp.asarray(array, jnp.float32), arrays)


def prepared(physics: Physics, parameters: Parameters) -> tuple[GripperForces, mjx.Model]:
    """Forces and MJX's model of one bench."""
    mine = physics.forces.having(parameters.numbers)
    return mine, resize(mine, physics.model, parameters.radius, parameters.probe_radius, parameters.density)


@partial(jax.jit, static_argnums=0)
def _advance(
    where: Layout, physics: Physics, parameters: Parameters, state: State, target: Float[Array, "B 3"], n_steps: Array
) -> tuple[State, Watch]:
    """Move B benches by a number of steps; `target`: of tip, voltage and shift aside, nan where that stays."""

    def move(parameters: Parameters, state: State, end: Array) -> tuple[State, Watch]:
        tip, voltage, aside = (state.ctrl[at] for at in (where.tip, where.voltage, where.aside_servo))
        way = jnp.where(jnp.isnan(end[2]), 0.0, end[2] - aside)

        def control(k: Array) -> Array:
            share = (k + 1) / n_steps
            ctrl = state.ctrl.at[where.tip].set(tip + minimum_jerk(share) * (end[0] - tip))
            ctrl = ctrl.at[where.aside_servo].set(aside + minimum_jerk(share) * way)
            return ctrl.at[where.voltage].set(voltage + share * (end[1] - voltage))

        begin = physics.data.replace(
            qpos=state.qpos, qvel=state.qvel, qacc_warmstart=state.qacc_warmstart, ctrl=state.ctrl
        )
        now, force, watch = watched(where, prepared(physics, parameters), begin, state.ball, control, n_steps)
        return State(now.qpos, now.qvel, now.qacc_warmstart, now.ctrl, force.state), watch

    return jax.vmap(move)(parameters, state, target)


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
        bench: of `prepared`.
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
    nothing = _single(Watch(-jnp.inf, -jnp.inf, jnp.inf, 0.0, jnp.nan, jnp.nan, 0.0, True))
    data, force, seen = jax.lax.fori_loop(0, n_steps, step, (data, force, nothing._replace(finite=jnp.bool_(True))))
    speed = jnp.linalg.norm(data.qvel[where.ball : where.ball + 3]) * (UM / MS)
    finite = jnp.isfinite(data.qpos).all() & jnp.isfinite(data.qvel).all()
    return data, force, seen._replace(speed=speed, finite=finite)
