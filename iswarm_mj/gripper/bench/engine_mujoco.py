"""Benches in MuJoCo's C engine: many at once on a thread pool, with the plugins."""

from collections.abc import Sequence
from functools import lru_cache, partial
from typing import Any, NamedTuple

import mujoco
import numpy as np
from jaxtyping import Float
from mujoco.batch import Batch

from iswarm_mj.engines.mujoco.timers import without_timers
from iswarm_mj.engines.mujoco_warnings import keep_no_log
from iswarm_mj.gripper import plugin
from iswarm_mj.gripper.bench.base import Mask, Move, Voltages, Watch
from iswarm_mj.gripper.bench.contact_log import ContactLog, Film, scattered
from iswarm_mj.gripper.bench.leaps import Row, press
from iswarm_mj.gripper.bench.model import bench_spec, layout, plugin_numbers, resized, sized, start
from iswarm_mj.gripper.bench.protocol import minimum_jerk
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.units import MS, UM

MEMORY = 2**18
"""Of a bench for contacts and the solver [bytes]; MuJoCo's own choice, 15 MB, takes longer to fill than a trial."""
STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
"""What a recorded state consists of."""
BLOCK = 256
"""Physics steps in one call of MuJoCo."""


class Recorded(NamedTuple):
    """T physics steps of a bench one after the other."""

    phases: list[str]
    """Of each step."""
    states: Float[np.ndarray, "T+1 n"]
    """Of MuJoCo, before the first step and after each of them."""


class MujocoBench:
    """`Bench` on `mujoco.batch`; bit-identical at any number of threads, 0 for one a core.

    Attributes:
        model: of the first bench.
        where: numbers are in its arrays.
        at: indices of the plugins' numbers in `plugin_state`, by instance and field.
        row: state of the first bench; physics resumes from what is written there.
        recorded: all steps of the first bench, where they are kept.
    """

    def __init__(
        self,
        trials: Sequence[Trial],
        start_gap: float,
        threads: int = 0,
        hanging: float | None = None,
        timestep: float | None = None,
        is_recorded: bool = False,
    ):
        """Place the balls.

        Args:
            trials: B of them.
            start_gap: between tool and ball [m].
            threads: 0 for one a core.
            hanging: balls hang at the tool, at this height above the plate [m]; None: they lie on the plate.
            timestep: instead of that of the model [s].
            is_recorded: keep all states of the first bench, for `tracing.trace_of`.
        """
        self.recorded: list[Recorded] | None = [] if is_recorded else None
        self._usual = partial(_usual, timestep, trials[0].probe_radius)
        self._own: mujoco.MjModel | None = None
        models = [_model(timestep, trial.radius, trial.probe_radius) for trial in trials]
        first = models[0]
        self.timestep = float(first.opt.timestep) * MS
        self.where, self.at = layout(first), plugin.state_indices(first)
        self._gaps = [self.at["electrostatic", name] for name in ("probe_gap", "plate_gap")]
        self._numbers = [self.at[names] for names in plugin_numbers(trials[0])]
        keep_no_log()
        self._batch = Batch(first, len(trials), threads)
        self._qvel, self._ctrl = self._batch.bind("qvel"), self._batch.bind("ctrl")
        self._qpos, self._state = self._batch.bind("qpos"), self._batch.bind("plugin_state")
        self._first = self._batch.state[0].copy()
        self._touch = np.zeros(len(trials))
        self.row = Row(self._qpos[0], self._qvel[0], self._state[0], self._batch.bind("qacc_warmstart")[0])
        self._place(models, trials, start_gap, hanging)

    def place(self, trial: Trial, start_gap: float, hanging: float | None = None) -> None:
        """Start another trial on a bench of one, in a tenth of the time that a new bench takes.

        See `__init__`; the probe is that of the first trial.
        """
        self._own = resized(self._usual(), trial.radius, self._own)
        self._place([self._own], [trial], start_gap, hanging)

    def _place(
        self, models: list[mujoco.MjModel], trials: Sequence[Trial], start_gap: float, hanging: float | None
    ) -> None:
        self.steps = 0
        self.model = models[0]
        self._batch.set_models(models)
        self._batch.state[:], self._batch.warning[:] = self._first, 0
        qpos, state = self._qpos, self._state
        for i, (model, trial) in enumerate(zip(models, trials, strict=True)):
            qpos[i], self._touch[i] = start(model, trial, start_gap, hanging)
            state[i, self._numbers] = list(plugin_numbers(trial).values())
        self._ctrl[:] = 0
        self._ctrl[:, self.where.tip] = qpos[:, self.where.slide]
        self._ctrl[:, self.where.aside_servo] = qpos[:, self.where.aside]

    def move(self, phase: str, duration: float, tip: float, voltage: Voltages, active: Mask | None = None) -> Watch:
        """See `Bench.move`."""
        ids = np.arange(len(self._touch)) if active is None else np.flatnonzero(active)
        n_steps, begin, end = self._plan(ids, duration, tip, voltage)
        contacts = ContactLog(len(ids))
        chosen = None if active is None else ids
        is_still = bool((begin == end).all())
        for first in range(0, n_steps, BLOCK):
            count = min(BLOCK, n_steps - first)
            control = None if is_still else self._way(begin, end, _shares(n_steps)[first : first + count])
            speed = -self._qvel[ids, None, self.where.ball + 2]
            block = self._rollout([phase] * count, control, ("qvel", "plugin_state"), chosen)
            speed = np.concatenate([speed, -block["qvel"][:, :-1, self.where.ball + 2]], axis=1)
            contacts.add(block["plugin_state"][:, :, self._gaps], speed, first)
        return self._watch(contacts, ids)

    def moves(self, moves: Sequence[Move], skip: int = 0) -> Watch:
        """Make several moves one after the other; gaps, speed and `finite` at their end are known, no contacts.

        Args:
            moves: of the tool.
            skip: leap over that many steps, in the last of which the tool presses the ball on the plate.
        """
        ids, ways, phases = np.arange(len(self._touch)), [], []
        begin = self._ctrl[ids]
        for phase, duration, tip, voltage in moves:
            n_steps, _, end = self._plan(ids, duration, tip, voltage, begin)
            ways.append(self._way(begin, end, _shares(n_steps)))
            phases += [phase] * n_steps
            begin = ways[-1][:, -1]
        way = np.concatenate(ways, axis=1)
        if skip:
            self.elapse(phases[:skip], way[:, :skip])
            press(self, way[0, skip - 1])
        self._rollout(phases[skip:], way[:, skip:])
        return self._watch(ContactLog(len(ids), self._state[:, self._gaps]), ids)

    def film(self, phase: str, duration: float, tip: float, voltage: float) -> Film:
        """Let physics go on where tip [m] and voltage [V] are and stay, on a bench with one ball."""
        n_steps, _, self._ctrl[:] = self._plan(np.zeros(1, int), duration, tip, voltage)
        time, fall, self._warned = (
            self._batch.state[0, 0],
            -self._qvel[0, self.where.ball + 2],
            self._batch.warning.copy(),
        )
        # A bench with a warning stands still from then on.
        block = self._rollout([phase] * n_steps, None, ("qvel", "plugin_state", STATE))
        velocity, gaps = block["qvel"][0, :, self.where.ball :], block["plugin_state"][0][:, self._gaps] * UM
        finite = np.isfinite(block[STATE][0]).all(axis=1)
        if (self._batch.warning > self._warned).any():
            finite[max(int(np.count_nonzero(np.diff(block[STATE][0, :, 0], prepend=time))) - 1, 0) :] = False
        return Film(
            gap_tool=gaps[:, 0],
            gap_plate=gaps[:, 1],
            fall=np.concatenate([[fall], -velocity[:-1, 2]]) * UM / MS,
            speed=np.sqrt((velocity[:, :3] ** 2).sum(axis=1)) * UM / MS,
            finite=finite,
            states=block[STATE][0],
        )

    def rewind(self, film: Film, step: int) -> None:
        """Return to the end of a step of the last film; what happened since is forgotten."""
        self._batch.state[0] = film.states[step]
        forgotten = len(film.finite) - 1 - step % len(film.finite)
        while self.recorded and forgotten:
            last = self.recorded.pop()
            kept, forgotten = max(0, len(last.phases) - forgotten), max(0, forgotten - len(last.phases))
            if kept:
                self.recorded.append(Recorded(last.phases[:kept], last.states[: kept + 1]))
        if film.finite[step]:
            self._batch.warning[:] = self._warned

    def number(self, instance: str, field: str) -> float:
        """A number of the first ball's plugins, see `plugin.state_index`."""
        return float(self._state[0, self.at[instance, field]])

    def elapse(self, phases: list[str], control: np.ndarray | None = None) -> None:
        """Let time pass without physics, unless what happens meanwhile is recorded; arguments as of `_rollout`."""
        if self.recorded is None:
            self._batch.state[0, 0] += len(phases) * self.timestep / MS
        elif phases:
            self._rollout(phases, control)

    def _rollout(
        self, phases: list[str], control: np.ndarray | None, record: tuple[Any, ...] = (), ids: np.ndarray | None = None
    ) -> dict[Any, np.ndarray]:
        """Take a physics step for each phase with these controls (n, T, nu), None: the present ones."""
        begin = self._batch.state[:1].copy()
        wanted = record if self.recorded is None else (*record, STATE)
        with without_timers():
            block = self._batch.rollout(len(phases), control, record=tuple(dict.fromkeys(wanted)), ids=ids)
        if self.recorded is not None:
            self.recorded.append(Recorded(phases, np.concatenate([begin, block[STATE][0]])))
        return block

    def _plan(
        self, ids: np.ndarray, duration: float, tip: float, voltage: Voltages, begin: np.ndarray | None = None
    ) -> tuple[int, np.ndarray, np.ndarray]:
        """Number of steps of a move, and controls (n, nu) at its begin, by default the present ones, and its end."""
        n_steps = max(1, round(duration / self.timestep))
        self.steps += n_steps * len(ids)
        begin = self._ctrl[ids] if begin is None else begin
        end = begin.copy()
        end[:, self.where.tip] = self._touch[ids] + tip / UM - self.where.tip_height
        end[:, self.where.voltage] = np.broadcast_to(voltage, len(self._touch))[ids]
        return n_steps, begin, end

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
        return Watch(*(scattered(values, ids, len(self._touch)) for values in watch))

    def save(self) -> Float[np.ndarray, "B n"]:
        """See `Bench.save`."""
        return self._batch.state.copy()

    def restore(self, state: Float[np.ndarray, "B n"]) -> None:
        """See `Bench.restore`."""
        self._batch.state[:] = state


@lru_cache(maxsize=64)
def _shares(n_steps: int) -> np.ndarray:
    """Shares (n_steps, 2) of the way after each step of a move: of time and voltage, and of the tool."""
    share = np.arange(1, n_steps + 1) / n_steps
    return np.stack([share, minimum_jerk(share)], axis=1)


@lru_cache(maxsize=4096)
def _model(timestep: float | None, radius: float, probe_radius: float) -> mujoco.MjModel:
    """The bench with these sizes [m] and a time step [s], by default its own."""
    return resized(_usual(timestep, probe_radius), radius)


@lru_cache(maxsize=16)
def _usual(timestep: float | None, probe_radius: float) -> mujoco.MjModel:
    """The default bench with a ball of 20 um."""
    spec = bench_spec()
    spec.memory = MEMORY
    if timestep is not None:
        spec.option.timestep = timestep / MS
    return sized(spec, Trial(20e-6, 0.0, 0.0, probe_radius=probe_radius))
