"""Benches in MJX: one compiled program moves all of them; between moves only their states are kept."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Float

from iswarm_mj.engines.mjx.api import mjx, put_model
from iswarm_mj.gripper import mjx_forces
from iswarm_mj.gripper.bench.base import Mask, Voltages, Watch, speed_at_zero
from iswarm_mj.gripper.bench.model import Layout, bench_spec, layout, plugin_numbers, start
from iswarm_mj.gripper.bench.protocol import minimum_jerk
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.mjx_forces import GripperForces, first_state, gripper_forces
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
    numbers: dict[tuple[str, str], Array]
    """Of `GripperForces`."""


class _Contacts(NamedTuple):
    last: Array
    """(2,) step of the last contact with tool and plate, -1: none."""
    first: Array
    """Step of the first contact with the plate, -1: none."""
    landing_speed: Array
    gaps: Array
    """(2,) to tool and plate."""
    before: Array
    """(2,) gap to the plate and downward speed one step earlier."""


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
        """Place the balls; arguments as of `MujocoBench`."""
        chosen = bench_spec()
        chosen.option.iterations, chosen.option.ls_iterations = ITERATIONS, LINE_SEARCH
        chosen.option.disableflags |= int(_IDLE)
        if timestep is not None:
            chosen.option.timestep = timestep / MS
        model, portable, count = chosen.compile(), mjx_compatible(chosen), len(trials)
        self.timestep = float(model.opt.timestep) * MS
        self.steps = 0
        self.where, forces = layout(model), gripper_forces(model)
        capacity: dict[str, Any] = {"naconmax": N_CONTACTS * count, "njmax": N_ROWS} if impl == "warp" else {}
        self.physics = Physics(forces, put_model(portable, impl), mjx.make_data(portable, impl=impl, **capacity))
        rows: list[Any] = [(trial.radius / UM, trial.probe_radius / UM, plugin_numbers(trial)) for trial in trials]
        self.parameters = _single(Parameters(*jax.tree.map(lambda *values: np.array(values), *rows)))
        starts = [start(model, trial, start_gap) for trial in trials]
        qpos, self._touch = np.array([qpos for qpos, _ in starts]), np.array([touch for _, touch in starts])
        still, ctrl = np.zeros((count, model.nv)), np.zeros((count, model.nu))
        ball = jax.tree.map(lambda a: np.repeat(np.asarray(a)[None], count, axis=0), first_state(forces))
        ctrl[:, self.where.tip] = qpos[:, self.where.slide]
        ctrl[:, self.where.aside_servo] = qpos[:, self.where.aside]
        self._state = _single(State(qpos, still, still, ctrl, ball))

    def move(self, phase: str, duration: float, tip: float, voltage: Voltages, active: Mask | None = None) -> Watch:
        """See `Bench.move`; benches that are not active move as well."""
        del phase, active
        n_steps = max(1, round(duration / self.timestep))
        self.steps += n_steps * len(self._touch)
        end = np.zeros((len(self._touch), 2))
        end[:, 0] = self._touch + tip / UM - self.where.tip_height
        end[:, 1] = voltage
        with jax.default_matmul_precision("highest"):
            target = jnp.asarray(end, jnp.float32)
            self._state, contacts = _advance(self.where, self.physics, self.parameters, self._state, target, n_steps)
        return self._watch(*jax.device_get((self._state, contacts)))

    def _watch(self, state: State, contacts: _Contacts) -> Watch:
        def time(step: Array) -> np.ndarray:
            return np.where(np.asarray(step) >= 0, np.asarray(step) * self.timestep, np.nan)

        speed = np.linalg.norm(state.qvel[:, self.where.ball : self.where.ball + 3], axis=1) * UM / MS
        finite = np.asarray(np.isfinite(np.hstack([state.qpos, state.qvel])).all(axis=1))
        gaps = np.asarray(contacts.gaps, float) * UM
        landing_speed = np.where(contacts.first >= 0, contacts.landing_speed, np.nan) * UM / MS
        last_tool, last_plate = time(contacts.last).T
        return Watch(last_tool, last_plate, time(contacts.first), landing_speed, gaps[:, 0], gaps[:, 1], speed, finite)

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
    return mine, resize(mine, physics.model, parameters.radius, parameters.probe_radius)


@partial(jax.jit, static_argnums=0)
def _advance(
    where: Layout, physics: Physics, parameters: Parameters, state: State, target: Float[Array, "B 2"], n_steps: Array
) -> tuple[State, _Contacts]:
    """Move B benches by a number of physics steps; `target` holds the setpoint of the tip and the voltage."""

    def move(parameters: Parameters, state: State, end: Array) -> tuple[State, _Contacts]:
        mine, sized = prepared(physics, parameters)
        order = jnp.array(mine.tool_and_plate)
        begin = physics.data.replace(
            qpos=state.qpos, qvel=state.qvel, qacc_warmstart=state.qacc_warmstart, ctrl=state.ctrl
        )

        def step(
            k: Array, carry: tuple[mjx.Data, mjx_forces.State, _Contacts]
        ) -> tuple[mjx.Data, mjx_forces.State, _Contacts]:
            before, ball, contacts = carry
            share = (k + 1) / n_steps
            tip, voltage = state.ctrl[where.tip], state.ctrl[where.voltage]
            ctrl = state.ctrl.at[where.tip].set(tip + minimum_jerk(share) * (end[0] - tip))
            ctrl = ctrl.at[where.voltage].set(voltage + share * (end[1] - voltage))
            now, force = mjx_forces.step(mine, sized, before.replace(ctrl=ctrl), ball)
            return now, force.state, _updated(contacts, k, force.gaps[order], -before.qvel[where.ball + 2])

        nothing = jnp.full(2, jnp.nan)
        contacts = _Contacts(jnp.full(2, -1), jnp.array(-1), jnp.array(jnp.nan), nothing, nothing)
        now, ball, contacts = jax.lax.fori_loop(0, n_steps, step, (begin, state.ball, contacts))
        return State(now.qpos, now.qvel, now.qacc_warmstart, now.ctrl, ball), contacts

    return jax.vmap(move)(parameters, state, target)


def _updated(contacts: _Contacts, k: Array, gaps: Array, speed: Array) -> _Contacts:
    """Contacts after step k with these gaps (2,) to tool and plate and this downward speed."""
    touches = gaps <= 0
    now = jnp.stack([gaps[1], speed])
    lands = touches[1] & (contacts.first < 0)
    return _Contacts(
        jnp.where(touches, k, contacts.last),
        jnp.where(lands, k, contacts.first),
        jnp.where(lands, speed_at_zero(contacts.before, now), contacts.landing_speed),
        gaps,
        now,
    )
