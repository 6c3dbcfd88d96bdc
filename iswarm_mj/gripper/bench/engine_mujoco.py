"""Benches in MuJoCo's C engine, each with a ball and a tool that can be moved.

All take their physics steps at once, on a thread pool.
"""

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
from iswarm_mj.gripper.tips.table import TipTable, read_table
from iswarm_mj.gripper.units import MS, UM

TOOL, PLATE = "adhesion_probe", "adhesion_plate"
"""Instances of the adhesion plugin."""
PART = 4096
"""Number of physics steps for which controls are made at once, which limits the memory."""
NO_EVENT = Watch(
    last_tool=-np.inf,
    last_plate=-np.inf,
    first_plate=np.inf,
    landing_speed=0.0,
    gap_tool=np.nan,
    gap_plate=np.nan,
    speed=np.nan,
    finite=True,
)
"""Events on a bench that stands still."""


class MujocoBench:
    """Benches on `mujoco.batch`; bit-identical at any number of threads, 0 for one a core.

    At the start the balls rest on the plate, the tools are above them, and there is no voltage.

    Attributes:
        model: of the first bench.
        where: addresses of numbers in MuJoCo's arrays.
        timestep: time step [s].
        steps: number of physics steps that were taken, summed over benches.
        recorded: all steps of the first bench, where they are kept.
    """

    def __init__(
        self,
        trials: Sequence[Trial],
        start_gap: float,
        threads: int = 0,
        timestep: float | None = None,
        *,
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
            hanging: balls hang at the tool instead, at this height above the plate [m].
        """
        keep_no_log()
        models = [_model_of(trial, timestep) for trial in trials]
        self.model = models[0]
        self.timestep = float(self.model.opt.timestep) * MS
        self.steps = 0
        self.recorded: list[Recorded] | None = [] if is_recorded else None
        self.where = layout(self.model)
        self._index_of = plugin.state_indices(self.model)
        self._touch = np.array([2 * trial.radius / UM for trial in trials])

        self._batch = Batch(self.model, len(trials), threads)
        self._qpos = self._batch.bind("qpos")
        self._qvel = self._batch.bind("qvel")
        self._ctrl = self._batch.bind("ctrl")
        self._time = self._batch.bind("time")
        self._state = self._batch.bind("plugin_state")
        self._batch.set_models(models)

        gaps = first_gaps(start_gap, hanging)
        for i, (model, trial) in enumerate(zip(models, trials, strict=True)):
            self._qpos[i] = start(model, trial, gaps)
            for place, value in plugin_numbers(trial).items():
                self._state[i, self._index_of[place]] = value
        self._start = self._qpos[:, self.where.aside].copy()
        self._ctrl[:, self.where.tip] = self._qpos[:, self.where.slide]
        self._ctrl[:, self.where.aside_servo] = self._start

    def move(
        self,
        phase: str,
        duration: float,
        tip: float,
        voltage: Voltages,
        active: Mask | None = None,
        aside: float | None = None,
    ) -> Watch:
        """Take physics steps while tool and voltage go to their targets.

        The tool moves along `minimum_jerk`, the voltage linearly.

        Args:
            phase: name of the phase, for recordings.
            duration: rounded to a multiple of the time step [s].
            tip: target height of the tool above its first touch of the ball at rest [m].
            voltage: target voltage, one for all benches or one each (B,) [V].
            active: (B,) benches of interest; all by default. The others stand still, and their
                results are undefined.
            aside: shift of the tool from where it started, by default none in this move [m].

        Returns:
            Events on the benches during the move.
        """
        ids = np.arange(len(self._touch)) if active is None else np.flatnonzero(active)
        n_steps = max(1, round(duration / self.timestep))
        self.steps += n_steps * len(ids)

        begin = self._ctrl[ids]
        end = begin.copy()
        end[:, self.where.tip] = self._touch[ids] + tip / UM - self.where.tip_height
        end[:, self.where.voltage] = np.broadcast_to(voltage, len(self._touch))[ids]
        if aside is not None:
            end[:, self.where.aside_servo] = self._start[ids] + aside / UM
        stands_still = not (begin != end).any()

        start_time = self._time[ids].reshape(len(ids), 1)
        self._state[ids, self._index_of[PLATE, "first"]] = -1.0
        for first in range(0, n_steps, PART):
            part = shares(n_steps)[first : first + PART]
            control = None if stands_still else self._controls(begin, end, part)
            self._take_steps(phase, len(part), control, None if active is None else ids)
        return self._watch(ids, start_time)

    def _take_steps(
        self,
        phase: str,
        n_steps: int,
        control: np.ndarray | None,
        ids: np.ndarray | None,
    ) -> None:
        """Take physics steps on benches with these ids, None: all; record the first bench."""
        before = self._batch.state[:1].copy()
        record = () if self.recorded is None else (STATE,)
        with without_timers():
            result = self._batch.rollout(n_steps, control, record=record, ids=ids)
        if self.recorded is not None:
            states = np.concatenate([before, result[STATE][0]])
            self.recorded.append(Recorded([phase] * n_steps, states))

    def off_axis(self) -> Float[np.ndarray, "B"]:
        """Return the distance of each ball from the tool's axis, along the way aside [m]."""
        return (self._qpos[:, self.where.ball] - self._qpos[:, self.where.aside]) * UM

    def _controls(self, begin: np.ndarray, end: np.ndarray, shares: np.ndarray) -> np.ndarray:
        """Return the controls (n, T, nu) of the steps of a move.

        Args:
            begin: controls (n, nu) before.
            end: controls (n, nu) at the end.
            shares: shares (T, 2) of the way after each step, see `model.shares`.
        """
        share_of_voltage = shares[:, :1]
        share_of_tool = shares[:, 1]
        change = (end - begin)[:, None]
        controls = begin[:, None] + share_of_voltage * change
        for servo in (self.where.tip, self.where.aside_servo):
            controls[:, :, servo] = begin[:, None, servo] + share_of_tool * change[:, :, servo]
        return controls

    def throw(self, height: float, speed: np.ndarray) -> None:
        """Put the balls at a height above the plate [m], falling at these speeds (B,) [m/s]."""
        self._qpos[:, self.where.ball + 2] += height / UM
        self._qvel[:, self.where.ball + 2] = -speed * MS / UM

    def _watch(self, ids: np.ndarray, start_time: np.ndarray) -> Watch:
        """Return the events on these benches since a time (n, 1) [ms]; the others have none."""
        state = self._state[ids]
        index_of = self._index_of

        # Times of contacts that were before the start of the move are below 0 then.
        since_start = MS * (state - start_time)
        last_tool = since_start[:, index_of[TOOL, "last"]]
        last_plate = since_start[:, index_of[PLATE, "last"]]
        first_plate = since_start[:, index_of[PLATE, "first"]]

        velocity = self._qvel[ids, self.where.ball : self.where.ball + 3]
        has_warned = self._batch.warning[ids].any(axis=(1, 2))
        events = Watch(
            last_tool=np.where(last_tool >= 0, last_tool, -np.inf),
            last_plate=np.where(last_plate >= 0, last_plate, -np.inf),
            first_plate=np.where(first_plate >= 0, first_plate, np.inf),
            landing_speed=state[:, index_of[PLATE, "landing_speed"]] * UM / MS,
            gap_tool=state[:, index_of["electrostatic", "probe_gap"]] * UM,
            gap_plate=state[:, index_of["electrostatic", "plate_gap"]] * UM,
            speed=np.sqrt((velocity**2).sum(axis=1)) * UM / MS,
            finite=np.isfinite(self._batch.state[ids]).all(axis=1) & ~has_warned,
        )

        watch = Watch(*(np.full(len(self._touch), value) for value in NO_EVENT))
        for values, values_of_ids in zip(watch, events, strict=True):
            values[ids] = values_of_ids
        return watch

    def save(self) -> Float[np.ndarray, "B n"]:
        """Return the state of all benches."""
        return self._batch.state.copy()

    def restore(self, state: Float[np.ndarray, "B n"]) -> None:
        """Return to a saved state."""
        self._batch.state[:] = state


def _model_of(trial: Trial, timestep: float | None) -> mujoco.MjModel:
    """Return the model of a trial's bench; None: with its own time step [s]."""
    return _model(
        timestep,
        trial.radius,
        trial.probe_radius,
        trial.density,
        rolling=trial.contacts.rolling,
        tip=None if trial.tip is None else read_table(trial.tip),
    )


@lru_cache(maxsize=4096)
def _model(
    timestep: float | None,
    radius: float,
    probe_radius: float,
    density: float,
    *,
    rolling: float,
    tip: TipTable | None,
) -> mujoco.MjModel:
    """Return the bench with these sizes, density, rolling friction and tip. SI units."""
    return resized(usual_model(timestep, probe_radius, density, rolling, tip), radius)
