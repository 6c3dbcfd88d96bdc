"""Benches in MuJoCo's C engine: many at once on a thread pool, with the plugins."""

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch

from iswarm_mj.engines.mujoco.timers import without_timers
from iswarm_mj.gripper import plugin
from iswarm_mj.gripper.bench.base import Mask, Voltages, Watch, speed_at_zero
from iswarm_mj.gripper.bench.model import bench_spec, layout, plugin_values, resized, sized, start
from iswarm_mj.gripper.bench.protocol import minimum_jerk
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.units import MS, UM

MEMORY = 2**18
"""Of a bench for contacts and the solver [bytes]; MuJoCo's own choice, 15 MB, takes longer to fill than a trial."""
BLOCK = 256
"""Physics steps in one call of MuJoCo."""


class MujocoBench:
    """`Bench` on `mujoco.batch`; bit-identical at any number of threads, 0 for one a core."""

    def __init__(
        self,
        trials: Sequence[Trial],
        start_gap: float,
        threads: int = 0,
        spec: mujoco.MjSpec | None = None,
        hanging: float | None = None,
        timestep: float | None = None,
    ):
        """Place the balls.

        Args:
            trials: B of them.
            start_gap: between tool and ball [m].
            threads: 0 for one a core.
            spec: of the bench, by default `bench_spec`.
            hanging: balls hang at the tool, at this height above the plate [m]; None: they lie on the plate.
            timestep: instead of that of the specification [s].
        """
        self._make = partial(sized, spec) if spec is not None else partial(_compiled, timestep)
        models = [self._make(trial) for trial in trials]
        first = models[0]
        self.timestep = float(first.opt.timestep) * MS
        self._where = layout(first)
        self._gaps = [plugin.state_index(first, "electrostatic", name) for name in ("probe_gap", "plate_gap")]
        self._batch = Batch(first, len(trials), threads)
        self._qvel, self._ctrl = self._batch.bind("qvel"), self._batch.bind("ctrl")
        self._touch = np.zeros(len(trials))
        self._place(models, trials, start_gap, hanging)

    def place(self, trials: Sequence[Trial], start_gap: float, hanging: float | None = None) -> None:
        """Begin anew with as many other trials, in a third of the time that a new bench takes; see `__init__`."""
        self._place([self._make(trial) for trial in trials], trials, start_gap, hanging)

    def _place(
        self, models: list[mujoco.MjModel], trials: Sequence[Trial], start_gap: float, hanging: float | None
    ) -> None:
        self.steps = 0
        self._batch.set_models(models)
        self._batch.reset(stage=mujoco.mjtStage.mjSTAGE_NONE)
        qpos, state = self._batch.bind("qpos"), self._batch.bind("plugin_state")
        for i, (model, trial) in enumerate(zip(models, trials, strict=True)):
            qpos[i], self._touch[i] = start(model, trial, start_gap, hanging)
            for index, value in plugin_values(model, trial).items():
                state[i, index] = value
        self._ctrl[:] = 0
        self._ctrl[:, self._where.tip] = qpos[:, self._where.slide]
        self._ctrl[:, self._where.aside_servo] = qpos[:, self._where.aside]

    def move(self, phase: str, duration: float, tip: float, voltage: Voltages, active: Mask | None = None) -> Watch:
        """See `Bench.move`."""
        del phase
        n_benches, n_steps = len(self._touch), max(1, round(duration / self.timestep))
        ids = np.arange(n_benches) if active is None else np.flatnonzero(active)
        self.steps += n_steps * len(ids)
        begin = self._ctrl[ids]
        end = begin.copy()
        end[:, self._where.tip] = self._touch[ids] + tip / UM - self._where.tip_height
        end[:, self._where.voltage] = np.broadcast_to(voltage, n_benches)[ids]
        contacts = _Contacts(len(ids))
        chosen = None if active is None else ids
        is_still = bool((begin == end).all())
        for first in range(0, n_steps, BLOCK):
            count = min(BLOCK, n_steps - first)
            control = None if is_still else self._way(begin, end, np.arange(first + 1, first + count + 1) / n_steps)
            speed = -self._qvel[ids, None, self._where.ball + 2]
            with without_timers():
                block = self._batch.rollout(count, control, record=("qvel", "plugin_state"), ids=chosen)
            speed = np.concatenate([speed, -block["qvel"][:, :-1, self._where.ball + 2]], axis=1)
            contacts.add(block["plugin_state"][:, :, self._gaps], speed, first)
        return self._watch(contacts, ids)

    def _way(self, begin: np.ndarray, end: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Controls (n, T, nu) at T shares of the way from those at the begin (n, nu) to those at the end."""
        way = np.repeat(share[:, None], begin.shape[1], axis=1)
        way[:, self._where.tip] = minimum_jerk(share)
        return begin[:, None] + way * (end - begin)[:, None]

    def throw(self, height: float, speed: np.ndarray) -> None:
        """Put the balls at a height above the plate [m], falling at these speeds (B,) [m/s]."""
        qpos = self._batch.bind("qpos")
        qpos[:, self._where.ball + 2] += height / UM
        self._qvel[:, self._where.ball + 2] = -speed * MS / UM

    def _watch(self, contacts: "_Contacts", ids: np.ndarray) -> Watch:
        ball = slice(self._where.ball, self._where.ball + 3)
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
        return Watch(*(_scattered(values, ids, len(self._touch)) for values in watch))

    def save(self) -> Any:
        """See `Bench.save`."""
        return self._batch.state.copy()

    def restore(self, state: Any) -> None:
        """See `Bench.restore`."""
        self._batch.state[:] = state


def _compiled(timestep: float | None, trial: Trial) -> mujoco.MjModel:
    """The default bench with a trial's sizes and a time step [s]."""
    return _model(timestep, trial.radius, trial.probe_radius)


@lru_cache(maxsize=4096)
def _model(timestep: float | None, radius: float, probe_radius: float) -> mujoco.MjModel:
    return resized(_usual(timestep, probe_radius), radius)


@lru_cache(maxsize=16)
def _usual(timestep: float | None, probe_radius: float) -> mujoco.MjModel:
    """The default bench with a ball of 20 um."""
    spec = bench_spec()
    spec.memory = MEMORY
    if timestep is not None:
        spec.option.timestep = timestep / MS
    return sized(spec, Trial(20e-6, 0.0, 0.0, probe_radius=probe_radius))


class _Contacts:
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
        self.gaps = np.full((count, 2), np.nan)
        self._before = np.full((count, 2), np.nan)

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


def _scattered(value: np.ndarray, ids: np.ndarray, count: int) -> np.ndarray:
    """Values of the benches `ids` in an array of `count` benches; those of the others are nan or True."""
    full = np.full(count, np.nan) if value.dtype != bool else np.ones(count, bool)
    full[ids] = value
    return full
