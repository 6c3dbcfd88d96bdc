"""Benches in MuJoCo's C engine: many at once on a thread pool, with the plugins."""

from collections.abc import Sequence
from functools import lru_cache

import mujoco
import numpy as np
from jaxtyping import Float
from mujoco.batch import Batch

from iswarm_mj.engines.mujoco.timers import without_timers
from iswarm_mj.engines.mujoco_warnings import keep_no_log
from iswarm_mj.gripper import plugin
from iswarm_mj.gripper.bench.base import Mask, Voltages, Watch, speed_at_zero
from iswarm_mj.gripper.bench.model import (
    STATE,
    Recorded,
    layout,
    plugin_numbers,
    resized,
    shares,
    start,
    usual_model,
)
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.units import MS, UM

BLOCK = 256
"""Physics steps in one call of MuJoCo."""


class ContactLog:
    """Contacts of n benches, in steps since the move began, in the bench's units.

    Attributes:
        last: (n, 2) step of the last contact with tool and plate, nan: never.
        first: (n,) step of the first contact with the plate, nan: never.
        landing_speed: (n,) downward speed at that moment.
        gaps: (n, 2) to tool and plate at the last step.
    """

    def __init__(self, count: int):
        self.last = np.full((count, 2), np.nan)
        self.first = np.full(count, np.nan)
        self.landing_speed = np.full(count, np.nan)
        self.gaps = self._before = np.full((count, 2), np.nan)

    def add(self, gaps: np.ndarray, speed: np.ndarray, first: int) -> None:
        """Process T steps from `first` on: gaps (n, T, 2) to tool and plate, downward speeds (n, T)."""
        rows, count = np.arange(len(gaps)), gaps.shape[1]
        touches = gaps <= 0
        last = first + count - 1 - np.argmax(touches[:, ::-1], axis=1)
        self.last = np.where(touches.any(axis=1), last, self.last)
        new = touches[:, :, 1].any(axis=1) & np.isnan(self.first)
        if new.any():
            at = np.argmax(touches[:, :, 1], axis=1)
            self.first = np.where(new, first + at, self.first)
            now = np.stack([gaps[rows, at, 1], speed[rows, at]], axis=1)
            earlier = np.stack([gaps[rows, at - 1, 1], speed[rows, at - 1]], axis=1)
            before = np.where(at[:, None] > 0, earlier, self._before)
            self.landing_speed = np.where(new, speed_at_zero(before, now), self.landing_speed)
        self.gaps, self._before = gaps[:, -1], np.stack([gaps[:, -1, 1], speed[:, -1]], axis=1)


class MujocoBench:
    """`Bench` on `mujoco.batch`; bit-identical at any number of threads, 0 for one a core.

    Attributes:
        model: of the first bench.
        where: numbers are in its arrays.
        recorded: all steps of the first bench, where they are kept.
    """

    def __init__(
        self,
        trials: Sequence[Trial],
        start_gap: float,
        threads: int = 0,
        timestep: float | None = None,
        is_recorded: bool = False,
    ):
        """Place the balls.

        Args:
            trials: B of them.
            start_gap: between tool and ball [m].
            threads: 0 for one a core.
            timestep: instead of that of the model [s].
            is_recorded: keep all states of the first bench, for `tracing.trace_of`.
        """
        self.recorded: list[Recorded] | None = [] if is_recorded else None
        models = [_model(timestep, trial.radius, trial.probe_radius) for trial in trials]
        first = self.model = models[0]
        self.timestep, self.steps = float(first.opt.timestep) * MS, 0
        self.where, at = layout(first), plugin.state_indices(first)
        self._gaps = [at["electrostatic", name] for name in ("probe_gap", "plate_gap")]
        keep_no_log()
        self._batch = Batch(first, len(trials), threads)
        self._qvel, self._ctrl = self._batch.bind("qvel"), self._batch.bind("ctrl")
        self._qpos, state = self._batch.bind("qpos"), self._batch.bind("plugin_state")
        self._touch = np.zeros(len(trials))
        self._batch.set_models(models)
        for i, (model, trial) in enumerate(zip(models, trials, strict=True)):
            self._qpos[i], self._touch[i] = start(model, trial, start_gap)
            state[i, [at[names] for names in plugin_numbers(trial)]] = list(plugin_numbers(trial).values())
        self._ctrl[:, self.where.tip] = self._qpos[:, self.where.slide]
        self._ctrl[:, self.where.aside_servo] = self._qpos[:, self.where.aside]

    def move(self, phase: str, duration: float, tip: float, voltage: Voltages, active: Mask | None = None) -> Watch:
        """See `Bench.move`."""
        ids = np.arange(len(self._touch)) if active is None else np.flatnonzero(active)
        n_steps, ball = max(1, round(duration / self.timestep)), self.where.ball + 2
        self.steps += n_steps * len(ids)
        begin = self._ctrl[ids]
        end = begin.copy()
        end[:, self.where.tip] = self._touch[ids] + tip / UM - self.where.tip_height
        end[:, self.where.voltage] = np.broadcast_to(voltage, len(self._touch))[ids]
        contacts, record = ContactLog(len(ids)), ("qvel", "plugin_state", *(() if self.recorded is None else (STATE,)))
        for first in range(0, n_steps, BLOCK):
            count = min(BLOCK, n_steps - first)
            control = self._way(begin, end, shares(n_steps)[first : first + count]) if (begin != end).any() else None
            speed, before = -self._qvel[ids, None, ball], self._batch.state[:1].copy()
            with without_timers():
                block = self._batch.rollout(count, control, record=record, ids=None if active is None else ids)
            if self.recorded is not None:
                self.recorded.append(Recorded([phase] * count, np.concatenate([before, block[STATE][0]])))
            speed = np.concatenate([speed, -block["qvel"][:, :-1, ball]], axis=1)
            contacts.add(block["plugin_state"][:, :, self._gaps], speed, first)
        return self._watch(contacts, ids)

    def _way(self, begin: np.ndarray, end: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Controls (n, T, nu) at T shares (T, 2) of the way from those at the begin (n, nu) to those at the end."""
        way = begin[:, None] + shares[:, :1] * (end - begin)[:, None]
        tip = self.where.tip
        way[:, :, tip] = begin[:, None, tip] + shares[:, 1] * (end - begin)[:, None, tip]
        return way

    def throw(self, height: float, speed: np.ndarray) -> None:
        """Put the balls at a height above the plate [m], falling at these speeds (B,) [m/s]."""
        self._qpos[:, self.where.ball + 2] += height / UM
        self._qvel[:, self.where.ball + 2] = -speed * MS / UM

    def _watch(self, contacts: ContactLog, ids: np.ndarray) -> Watch:
        ball = slice(self.where.ball, self.where.ball + 3)
        speed = np.sqrt((self._qvel[ids, ball] ** 2).sum(axis=1))
        warned = self._batch.warning[ids].any(axis=(1, 2))
        finite = np.isfinite(self._batch.state[ids]).all(axis=1) & ~warned
        watch = Watch(
            last_tool=contacts.last[:, 0] * self.timestep,
            last_plate=contacts.last[:, 1] * self.timestep,
            first_plate=contacts.first * self.timestep,
            landing_speed=contacts.landing_speed * UM / MS,
            gap_tool=contacts.gaps[:, 0] * UM,
            gap_plate=contacts.gaps[:, 1] * UM,
            speed=speed * UM / MS,
            finite=finite,
        )
        if len(ids) == len(self._touch):
            return watch
        full = [np.full(len(self._touch), True if values.dtype == bool else np.nan) for values in watch]
        for own, values in zip(full, watch, strict=True):
            own[ids] = values
        return Watch(*full)

    def save(self) -> Float[np.ndarray, "B n"]:
        """See `Bench.save`."""
        return self._batch.state.copy()

    def restore(self, state: Float[np.ndarray, "B n"]) -> None:
        """See `Bench.restore`."""
        self._batch.state[:] = state


@lru_cache(maxsize=4096)
def _model(timestep: float | None, radius: float, probe_radius: float) -> mujoco.MjModel:
    """The bench with these sizes [m] and a time step [s], by default its own."""
    return resized(usual_model(timestep, probe_radius), radius)
