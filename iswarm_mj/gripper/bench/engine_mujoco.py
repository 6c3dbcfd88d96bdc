"""B benches in MuJoCo's C engine, each with a ball and a tool that can be moved: all at once on a thread pool."""

from collections.abc import Sequence
from functools import lru_cache

import mujoco
import numpy as np
from jaxtyping import Float
from mujoco.batch import Batch

from iswarm_mj.engines.mujoco_library import keep_no_log, without_timers
from iswarm_mj.gripper import plugin
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
from iswarm_mj.gripper.bench.script import Mask, Voltages, Watch, first_gaps
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.units import MS, UM

SURFACES = "adhesion_probe", "adhesion_plate"
PART = 4096
"""Physics steps for which controls are made at once, which limits the memory."""


class MujocoBench:
    """Benches on `mujoco.batch`; bit-identical at any number of threads, 0 for one a core.

    At the start the balls rest on the plate, the tools are above them, and there is no voltage.

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
        hanging: float | None = None,
    ):
        """Place the balls.

        Args:
            trials: B of them.
            start_gap: between tool and ball [m].
            threads: 0 for one a core.
            timestep: instead of that of the model [s].
            is_recorded: keep all states of the first bench, for `tracing.trace_of`.
            hanging: balls hang at the tool instead, so high above the plate [m].
        """
        self.recorded: list[Recorded] | None = [] if is_recorded else None
        models = [_model(timestep, t.radius, t.probe_radius, t.density, t.contacts.rolling) for t in trials]
        first = self.model = models[0]
        self.timestep, self.steps = float(first.opt.timestep) * MS, 0
        self.where, at = layout(first), plugin.state_indices(first)
        self._gaps = [at["electrostatic", name] for name in ("probe_gap", "plate_gap")]
        self._last = [at[surface, "last"] for surface in SURFACES]
        self._first, self._landing = at["adhesion_plate", "first"], at["adhesion_plate", "landing_speed"]
        keep_no_log()
        self._batch = Batch(first, len(trials), threads)
        self._qvel, self._ctrl, self._time = (self._batch.bind(name) for name in ("qvel", "ctrl", "time"))
        self._qpos, self._state = self._batch.bind("qpos"), self._batch.bind("plugin_state")
        self._touch = np.array([2 * trial.radius / UM for trial in trials])
        self._batch.set_models(models)
        for i, (model, trial) in enumerate(zip(models, trials, strict=True)):
            self._qpos[i] = start(model, trial, first_gaps(start_gap, hanging))
            self._state[i, [at[names] for names in plugin_numbers(trial)]] = list(plugin_numbers(trial).values())
        self._ctrl[:, self.where.tip] = self._qpos[:, self.where.slide]
        self._ctrl[:, self.where.aside_servo] = self._start = self._qpos[:, self.where.aside].copy()

    def move(
        self,
        phase: str,
        duration: float,
        tip: float,
        voltage: Voltages,
        active: Mask | None = None,
        aside: float | None = None,
    ) -> Watch:
        """Integrate the physics while the tool moves along `minimum_jerk` and the voltage linearly to their targets.

        Args:
            phase: name of the phase, for recordings.
            duration: rounded to a multiple of the time step [s].
            tip: target height of the tool above its first touch of the ball at rest [m].
            voltage: target voltage, one for all benches or one each (B,) [V].
            active: (B,) benches of interest; all by default. The others stand still, and their results are meaningless.
            aside: shift of the tool from where it started, by default none in this move [m].
        """
        ids = np.arange(len(self._touch)) if active is None else np.flatnonzero(active)
        n_steps = max(1, round(duration / self.timestep))
        self.steps += n_steps * len(ids)
        begin, began = self._ctrl[ids], self._time[ids].reshape(len(ids), 1)
        end = begin.copy()
        end[:, self.where.tip] = self._touch[ids] + tip / UM - self.where.tip_height
        end[:, self.where.voltage] = np.broadcast_to(voltage, len(self._touch))[ids]
        if aside is not None:
            end[:, self.where.aside_servo] = self._start[ids] + aside / UM
        self._state[ids, self._first] = -1.0
        for first in range(0, n_steps, PART):
            part = shares(n_steps)[first : first + PART]
            control = self._way(begin, end, part) if (begin != end).any() else None
            before, record = self._batch.state[:1].copy(), () if self.recorded is None else (STATE,)
            with without_timers():
                found = self._batch.rollout(len(part), control, record=record, ids=None if active is None else ids)
            if self.recorded is not None:
                self.recorded.append(Recorded([phase] * len(part), np.concatenate([before, found[STATE][0]])))
        return self._watch(ids, began)

    def off_axis(self) -> Float[np.ndarray, "B"]:
        """Return how far each ball is from the tool's axis, along the way aside [m]."""
        return (self._qpos[:, self.where.ball] - self._qpos[:, self.where.aside]) * UM

    def _way(self, begin: np.ndarray, end: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Controls (n, T, nu) at T shares (T, 2) of the way from those at the begin (n, nu) to those at the end."""
        way = begin[:, None] + shares[:, :1] * (end - begin)[:, None]
        for servo in (self.where.tip, self.where.aside_servo):
            way[:, :, servo] = begin[:, None, servo] + shares[:, 1] * (end - begin)[:, None, servo]
        return way

    def throw(self, height: float, speed: np.ndarray) -> None:
        """Put the balls at a height above the plate [m], falling at these speeds (B,) [m/s]."""
        self._qpos[:, self.where.ball + 2] += height / UM
        self._qvel[:, self.where.ball + 2] = -speed * MS / UM

    def _watch(self, ids: np.ndarray, began: np.ndarray) -> Watch:
        """What happened on these benches since they `began` (n, 1) [ms]; the others are calm."""
        state, velocity = self._state[ids], self._qvel[ids, self.where.ball : self.where.ball + 3]
        last, first = state[:, self._last] - began, state[:, [self._first]] - began
        last, first = np.where(last >= 0, last * MS, -np.inf), np.where(first >= 0, first * MS, np.inf)
        warned = self._batch.warning[ids].any(axis=(1, 2))
        finite = np.isfinite(self._batch.state[ids]).all(axis=1) & ~warned
        speeds = state[:, self._landing] * UM / MS, np.sqrt((velocity**2).sum(axis=1)) * UM / MS
        gaps = state[:, self._gaps] * UM
        watch = Watch(last[:, 0], last[:, 1], first[:, 0], speeds[0], gaps[:, 0], gaps[:, 1], speeds[1], finite)
        calm = Watch(-np.inf, -np.inf, np.inf, 0.0, np.nan, np.nan, np.nan, True)
        full = [np.full(len(self._touch), value) for value in calm]
        for own, values in zip(full, watch, strict=True):
            own[ids] = values
        return Watch(*full)

    def save(self) -> Float[np.ndarray, "B n"]:
        """Return the state of all benches."""
        return self._batch.state.copy()

    def restore(self, state: Float[np.ndarray, "B n"]) -> None:
        """Return to a saved state."""
        self._batch.state[:] = state


@lru_cache(maxsize=4096)
def _model(
    timestep: float | None, radius: float, probe_radius: float, density: float, rolling: float
) -> mujoco.MjModel:
    """The bench with these sizes, rolling friction [m], density [kg/m^3] and time step [s], by default its own."""
    return resized(usual_model(timestep, probe_radius, density, rolling), radius)
