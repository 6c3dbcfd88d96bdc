"""Benches in MJX: one compiled program moves all of them, and only their states are kept between moves."""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from iswarm_mj.engines.mjx.api import mjx, put_model
from iswarm_mj.gripper.bench.base import Watch, speed_at_zero
from iswarm_mj.gripper.bench.model import MS, NN, UM, Layout, bench_spec, layout, start
from iswarm_mj.gripper.bench.protocol import smooth
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.mjx_forces import ON_PROBE, GripperForces, gripper_force, gripper_forces, mjx_compatible, resize
from iswarm_mj.utils.arrays import Array

N_CONTACTS, N_ROWS = 4, 24
"""Of a bench in MJX-Warp: contacts and rows of constraints it has room for."""


ITERATIONS, LINE_SEARCH = 2, 4
"""Of the contact solver, at most: more change no voltage, and single precision never meets MuJoCo's tolerance."""


class State(NamedTuple):
    """What a bench remembers."""

    qpos: Array
    qvel: Array
    qacc_warmstart: Array
    ctrl: Array
    potential: Array


class Numbers(NamedTuple):
    """What differs between benches. Units: um, nN."""

    radius: Array
    probe_radius: Array
    work: Array
    """(P,) of the pairs of surfaces."""
    humidity: Array
    contact_gap: Array


class _Seen(NamedTuple):
    last: Array
    """(2,) step of the last contact with tool and plate, -1: none."""
    first: Array
    """Step of the first contact with the plate, -1: none."""
    landing_speed: Array
    gaps: Array
    """(2,) to tool and plate."""
    before: Array
    """(2,) gap to the plate and downward speed a step before."""


class MjxBench:
    """`Bench` in MJX, with `impl` "jax" or "warp"; numbers are single precision."""

    def __init__(self, trials: Sequence[Trial], start_gap: float, impl: str = "jax", spec: mujoco.MjSpec | None = None):
        chosen = spec or bench_spec()
        if spec is None:
            chosen.option.iterations, chosen.option.ls_iterations = ITERATIONS, LINE_SEARCH
        model, portable, count = chosen.compile(), mjx_compatible(chosen), len(trials)
        self.timestep = float(model.opt.timestep) * MS
        self.steps = 0
        self._where, self._forces = layout(model), gripper_forces(model)
        room: dict[str, Any] = {"naconmax": N_CONTACTS * count, "njmax": N_ROWS} if impl == "warp" else {}
        self._model, self._data = put_model(portable, impl), mjx.make_data(portable, impl=impl, **room)
        column = {name: np.array([getattr(trial, name) for trial in trials]) for name in Trial._fields}
        works = {self._forces.plate: "work_object_substrate", self._forces.probe: "work_tool_object"}
        work = np.stack([column[works[surface]] for _, surface in self._forces.pairs], axis=1)
        self._numbers = _single(
            Numbers(
                column["radius"] / UM,
                column["probe_radius"] / UM,
                work * UM / NN,
                np.repeat(column["relative_humidity"][:, None], work.shape[1], axis=1),
                column["contact_gap"] / UM,
            )
        )
        starts = [start(model, trial, start_gap) for trial in trials]
        qpos, self._touch = np.array([qpos for qpos, _ in starts]), np.array([touch for _, touch in starts])
        still, ctrl = np.zeros((count, model.nv)), np.zeros((count, model.nu))
        ctrl[:, self._where.tip] = qpos[:, self._where.slide]
        self._state = _single(State(qpos, still, still, ctrl, np.full(count, ON_PROBE)))

    def move(
        self, phase: str, duration: float, tip: np.ndarray, voltage: np.ndarray, active: np.ndarray | None = None
    ) -> Watch:
        """See `Bench.move`; benches that are not active move as well."""
        del phase, active
        n_steps = max(1, round(duration / self.timestep))
        self.steps += n_steps * len(self._touch)
        end = np.zeros((len(self._touch), 2))
        end[:, 0] = self._touch + tip / UM - self._where.tip_height
        end[:, 1] = voltage
        with jax.default_matmul_precision("highest"):
            self._state, seen = _advance_compiled(
                self._where, self._forces, self._model, self._data, self._numbers, self._state,
                jnp.asarray(end, jnp.float32), n_steps,
            )  # fmt: skip
        return self._watch(*jax.device_get((self._state, seen)))

    def _watch(self, state: State, seen: _Seen) -> Watch:
        def time(step: np.ndarray) -> np.ndarray:
            return np.where(step >= 0, step * self.timestep, np.nan)

        speed = np.linalg.norm(state.qvel[:, self._where.ball : self._where.ball + 3], axis=1) * UM / MS
        finite = np.isfinite(state.qpos).all(axis=1) & np.isfinite(state.qvel).all(axis=1)
        gaps = seen.gaps.astype(float) * UM
        landing_speed = np.where(seen.first >= 0, seen.landing_speed, np.nan) * UM / MS
        seen_in_order = (*time(seen.last).T, time(seen.first), landing_speed, *gaps.T, speed, finite)
        return Watch(*seen_in_order)

    def save(self) -> Any:
        """See `Bench.save`."""
        return self._state

    def restore(self, state: Any) -> None:
        """See `Bench.restore`."""
        self._state = state


def _single(arrays):
    return type(arrays)(*(jnp.asarray(array, jnp.float32) for array in arrays))


def _advance(
    where: Layout,
    forces: GripperForces,
    model: Any,
    data: Any,
    numbers: Numbers,
    state: State,
    end: Array,
    n_steps: Array,
) -> tuple[State, _Seen]:
    """Move B benches for a number of physics steps; `end` (B, 2) holds the tip's servo and the voltage."""

    def move(numbers: Numbers, state: State, end: Array) -> tuple[State, _Seen]:
        mine = dataclasses.replace(
            forces, work=numbers.work, humidity=numbers.humidity, contact_gap=numbers.contact_gap
        )
        sized = resize(mine, model, numbers.radius)
        sized = sized.replace(geom_size=sized.geom_size.at[forces.probe, 0].set(numbers.probe_radius))
        surfaces = [surface for _, surface in forces.pairs]
        order = jnp.array([surfaces.index(forces.probe), surfaces.index(forces.plate)])
        begin = data.replace(qpos=state.qpos, qvel=state.qvel, qacc_warmstart=state.qacc_warmstart, ctrl=state.ctrl)

        def step(k: Array, carry: tuple[Any, Array, _Seen]) -> tuple[Any, Array, _Seen]:
            now, potential, seen = carry
            share = (k + 1) / n_steps
            tip, voltage = state.ctrl[where.tip], state.ctrl[where.voltage]
            ctrl = state.ctrl.at[where.tip].set(tip + smooth(share) * (end[0] - tip))
            ctrl = ctrl.at[where.voltage].set(voltage + share * (end[1] - voltage))
            now = now.replace(ctrl=ctrl)
            force = gripper_force(mine, sized, now, potential)
            seen = _see(seen, k, force.gaps[order], -now.qvel[where.ball + 2])
            return mjx.step(sized, now.replace(qfrc_applied=force.generalized)), force.potential, seen

        nothing = jnp.full(2, jnp.nan)
        seen = _Seen(jnp.full(2, -1), jnp.array(-1), jnp.array(jnp.nan), nothing, nothing)
        now, potential, seen = jax.lax.fori_loop(0, n_steps, step, (begin, state.potential, seen))
        return State(now.qpos, now.qvel, now.qacc_warmstart, now.ctrl, potential), seen

    return jax.vmap(move)(numbers, state, end)


_advance_compiled = jax.jit(_advance, static_argnums=0)


def _see(seen: _Seen, k: Array, gaps: Array, speed: Array) -> _Seen:
    """Take in gaps (2,) to tool and plate and the downward speed at step k."""
    touches = gaps <= 0
    now = jnp.stack([gaps[1], speed])
    lands = touches[1] & (seen.first < 0)
    return _Seen(
        jnp.where(touches, k, seen.last),
        jnp.where(lands, k, seen.first),
        jnp.where(lands, speed_at_zero(seen.before, now), seen.landing_speed),
        gaps,
        now,
    )
