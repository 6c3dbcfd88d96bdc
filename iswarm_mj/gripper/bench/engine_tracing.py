"""One bench in MuJoCo's C engine that keeps every physics step, and the traces of whole trials."""

from typing import Any

import mujoco
import numpy as np

from iswarm_mj.gripper import plugin
from iswarm_mj.gripper.bench.base import Watch, speed_at_zero
from iswarm_mj.gripper.bench.model import MS, NN, UM, bench_spec, layout, plugin_values, sized, start
from iswarm_mj.gripper.bench.protocol import Protocol, smooth
from iswarm_mj.gripper.bench.ramps import release
from iswarm_mj.gripper.bench.staircase import hang, rung, touch
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.bench.trial_trace import Trace

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_FORCES = (
    ("electrostatic", "probe_gap"), ("electrostatic", "plate_gap"), ("adhesion_probe", "force"),
    ("adhesion_plate", "force"), ("electrostatic", "force"), ("electrostatic", "potential"),
)  # fmt: skip


class TraceBench:
    """`Bench` of a single trial, stepped one by one."""

    def __init__(self, trial: Trial, start_gap: float):
        self._model = sized(bench_spec(), trial)
        self._data = mujoco.MjData(self._model)
        self._where, self.timestep = layout(self._model), float(self._model.opt.timestep) * MS
        self._data.qpos[:], self._touch = start(self._model, trial, start_gap)
        for index, value in plugin_values(self._model, trial).items():
            self._data.plugin_state[index] = value
        self._data.ctrl[self._where.tip] = self._data.qpos[self._where.slide]
        self._numbers = [plugin.state_index(self._model, *names) for names in _FORCES]
        self._ball, self._plate = self._model.geom("ball").id, self._model.geom("plate").id
        self.steps = 0
        self._phases: list[str] = []
        self._rows: list[np.ndarray] = []

    def move(
        self, phase: str, duration: float, tip: np.ndarray, voltage: np.ndarray, active: np.ndarray | None = None
    ) -> Watch:
        """See `Bench.move`."""
        del active
        if phase not in self._phases:
            self._phases.append(phase)
        data, where = self._data, self._where
        n_steps, first = max(1, round(duration / self.timestep)), len(self._rows)
        self.steps += n_steps
        begin = data.ctrl.copy()
        end = begin.copy()
        end[where.tip], end[where.voltage] = self._touch + tip[0] / UM - where.tip_height, voltage[0]
        for k in range(n_steps):
            share = (k + 1) / n_steps
            way = np.full(len(begin), share)
            way[where.tip] = smooth(share)
            data.ctrl[:] = begin + way * (end - begin)
            moment, qpos, fall = data.time, data.qpos.copy(), -data.qvel[where.ball + 2]
            mujoco.mj_step(self._model, data)
            self._rows.append(self._row(self._phases.index(phase), moment, qpos, fall))
        return self._watch(np.array(self._rows[first:]))

    def _row(self, phase: int, moment: float, qpos: np.ndarray, fall: float) -> np.ndarray:
        """A sample before a step: phase, time, voltage, tip, ball, quaternion, downward speed, `_FORCES`, contacts."""
        where, data = self._where, self._data
        tip = qpos[where.slide] + where.tip_height
        pressed, force = np.zeros(2), np.zeros(6)
        for i, geoms in enumerate(data.contact.geom):
            mujoco.mj_contactForce(self._model, data, i, force)
            pressed[int(self._plate in geoms)] += max(0.0, force[0])
        ball = qpos[where.ball : where.ball + 7]
        forces = data.plugin_state[self._numbers]
        return np.array([phase, moment, data.ctrl[where.voltage], tip, *ball, fall, *forces, *pressed])

    def _watch(self, rows: np.ndarray) -> Watch:
        gaps, fall = rows[:, 12:14], rows[:, 11]
        dt = self.timestep
        steps = [np.flatnonzero(gap <= 0) for gap in gaps.T]
        last = [at[-1] * dt if len(at) else np.nan for at in steps]
        first = steps[1][0] if len(steps[1]) else None
        speed = np.nan
        if first is not None:
            pairs = np.stack([gaps[:, 1], fall], axis=1)
            speed = float(speed_at_zero(pairs[max(first - 1, 0)], pairs[first])) * UM / MS
        ball = slice(self._where.ball, self._where.ball + 3)
        values = (
            *last, np.nan if first is None else first * dt, speed, *(gaps[-1] * UM),
            float(np.linalg.norm(self._data.qvel[ball])) * UM / MS, bool(np.isfinite(self._data.qpos).all()),
        )  # fmt: skip
        return Watch(*(np.array([value]) for value in values))

    def save(self) -> Any:
        """See `Bench.save`."""
        state = np.empty(mujoco.mj_stateSize(self._model, _STATE))
        mujoco.mj_getState(self._model, self._data, state, _STATE)
        return state

    def restore(self, state: Any) -> None:
        """See `Bench.restore`."""
        mujoco.mj_setState(self._model, self._data, state, _STATE)

    def trace(self) -> Trace:
        """What was seen so far."""
        rows = np.array(self._rows).T
        zero = np.zeros_like(rows[0])
        return Trace(
            time=rows[1] * MS, phase=rows[0].astype(int), phases=tuple(self._phases), voltage=rows[2],
            probe=np.stack([zero, zero, rows[3]], axis=1) * UM, ball=rows[4:7].T * UM, ball_quaternion=rows[7:11].T,
            gap_tool=rows[12] * UM, gap_plate=rows[13] * UM, adhesion_tool=rows[14] * NN, adhesion_plate=rows[15] * NN,
            electrostatic=rows[16] * NN, on_plate_potential=rows[17] < 0.5, contact_tool=rows[18] * NN,
            contact_plate=rows[19] * NN,
            radius=float(self._model.geom_size[self._ball, 0]) * UM,
            probe_radius=float(self._model.geom("probe").size[0]) * UM,
            weight=float(-self._model.opt.gravity[2] * self._model.body("ball").mass[0]) * NN,
        )  # fmt: skip


def trace_trial(trial: Trial, protocol: Protocol, voltage: float | None, gap: float) -> Trace:
    """Trace of a trial from the approach to a ball that rests again.

    Args:
        trial: the ball.
        protocol: what the tool does.
        voltage: at which it lifts [V]; None: the highest rung is tried, and nothing released.
        gap: to the plate at which the ball is released [m].
    """
    bench = TraceBench(trial, protocol.start_gap)
    highest = protocol.highest_rung * protocol.step_voltage
    touch(bench, protocol)
    watch = rung(bench, protocol, np.array([highest if voltage is None else voltage]))
    if watch.gap_plate[0] > protocol.away:
        hang(bench, protocol, gap)
        release(bench, protocol, np.array([True]), gap)
    return bench.trace()
