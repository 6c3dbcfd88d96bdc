"""A bench in MuJoCo's C engine that records every physics step, and the traces of whole trials."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np

from iswarm_mj.gripper import plugin
from iswarm_mj.gripper.bench.base import Mask, Move, Voltages, Watch, speed_at_zero
from iswarm_mj.gripper.bench.film import Film
from iswarm_mj.gripper.bench.leaps import Row, places, press
from iswarm_mj.gripper.bench.model import bench_spec, layout, plugin_values, sized, start
from iswarm_mj.gripper.bench.protocol import Protocol, minimum_jerk
from iswarm_mj.gripper.bench.ramps import release
from iswarm_mj.gripper.bench.staircase import hang, rung, stays_up, touch
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.bench.trial_trace import Trace
from iswarm_mj.gripper.units import MS, NN, UM

_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)
_IMPACT_FIELDS = ("before", "gap", "rebound", "impact_speed", "impulse")
"""Fields of adhesion that tell about an impact."""
_PLUGIN_FIELDS = (
    ("electrostatic", "probe_gap"),
    ("electrostatic", "plate_gap"),
    ("adhesion_probe", "force"),
    ("adhesion_plate", "force"),
    ("electrostatic", "force"),
    ("electrostatic", "potential"),
    ("electrostatic", "ball_voltage"),
    ("electrostatic", "broken"),
)
"""Instances of plugins and fields of their states that a sample holds."""


class _Samples(NamedTuple):
    """One sample, or arrays of T samples, in the bench's units; see `Trace`."""

    phase: Any
    time: Any
    voltage: Any
    tip: Any
    """Height of the tip."""
    aside: Any
    """Shift of the tool along x."""
    ball: Any
    """(7,) position and quaternion."""
    fall: Any
    """Downward speed of the ball."""
    plugins: Any
    """(8,) the `_PLUGIN_FIELDS`."""
    contacts: Any
    """(2,) normal forces of the contacts with tool and plate."""
    drive: Any
    """Force of the tool's drive."""
    lost: Any
    """Energy lost in an impact [fJ]."""


class TraceBench:
    """`Bench` of a single trial, moved step by step."""

    def __init__(self, trial: Trial, start_gap: float, hanging: float | None = None, timestep: float | None = None):
        """Place the ball; arguments as of `MujocoBench`."""
        spec = bench_spec()
        if timestep is not None:
            spec.option.timestep = timestep / MS
        self.model = sized(spec, trial)
        self._data = mujoco.MjData(self.model)
        self._where, self.timestep = layout(self.model), float(self.model.opt.timestep) * MS
        self._data.qpos[:], self._touch = start(self.model, trial, start_gap, hanging)
        for index, value in plugin_values(self.model, trial).items():
            self._data.plugin_state[index] = value
        self._data.ctrl[self._where.tip] = self._data.qpos[self._where.slide]
        self._data.ctrl[self._where.aside_servo] = self._data.qpos[self._where.aside]
        self._fields = [plugin.state_index(self.model, *names) for names in _PLUGIN_FIELDS]
        self._impacts = [
            [plugin.state_index(self.model, name, field) for field in _IMPACT_FIELDS]
            for name in ("adhesion_probe", "adhesion_plate")
        ]
        self._ball, self._plate = self.model.geom("ball").id, self.model.geom("plate").id
        self.places = places(self.model)
        self.row = Row(self._data.qpos, self._data.qvel, self._data.plugin_state, self._data.qacc_warmstart)
        self.steps = 0
        self._press_at = 0
        self._phases: list[str] = []
        self._samples: list[_Samples] = []

    def move(self, phase: str, duration: float, tip: float, voltage: Voltages, active: Mask | None = None) -> Watch:
        """See `Bench.move`."""
        del active
        if phase not in self._phases:
            self._phases.append(phase)
        data, where = self._data, self._where
        n_steps, first = max(1, round(duration / self.timestep)), len(self._samples)
        begin = data.ctrl.copy()
        end = begin.copy()
        end[where.tip], end[where.voltage] = self._touch + tip / UM - where.tip_height, np.squeeze(voltage)
        for k in range(n_steps):
            if self.steps == self._press_at > 0:
                press(self, data.ctrl)
            self.steps += 1
            share = (k + 1) / n_steps
            way = np.full(len(begin), share)
            way[where.tip] = minimum_jerk(share)
            data.ctrl[:] = begin + way * (end - begin)
            self._samples.append(self._step(phase))
        return self._watch(_stacked(self._samples[first:]))

    def moves(self, moves: Sequence[Move], skip: int = 0) -> Watch:
        """See `FilmBench.moves`; what is leapt over is shown all the same."""
        self._press_at = self.steps + skip
        return [self.move(*move) for move in moves][-1]

    def film(self, phase: str, duration: float, tip: float, voltage: float) -> Film:
        """See `FilmBench.film`."""
        rows, states = [], []
        for _ in range(round(duration / self.timestep)):
            watch, fall = self.move(phase, self.timestep, tip, voltage), self._samples[-1].fall
            rows.append((watch.gap_tool[0], watch.gap_plate[0], fall * UM / MS, watch.speed[0], watch.finite[0]))
            states.append(self.save())
        gap_tool, gap_plate, falls, speed, finite = map(np.array, zip(*rows, strict=True))
        return Film(gap_tool, gap_plate, falls, speed, finite, states)

    def rewind(self, film: Film, step: int) -> None:
        """See `FilmBench.rewind`."""
        self.restore(film.states[step])

    def elapse(self, phase: str, steps: int) -> None:
        """See `LeapBench.elapse`; physics shows what happens meanwhile."""
        where, control = self._where, self._data.ctrl
        tip = (control[where.tip] + where.tip_height - self._touch) * UM
        if steps > 0:
            self.move(phase, steps * self.timestep, tip, control[where.voltage])

    def _step(self, phase: str) -> _Samples:
        """Take a physics step; its sample is the state before, with the forces that acted in it."""
        data, where = self._data, self._where
        time, qpos, fall = data.time, data.qpos.copy(), -data.qvel[where.ball + 2]
        before = [data.plugin_state[at[0]] for at in self._impacts]
        mujoco.mj_step(self.model, data)
        contacts, force = np.zeros(2), np.zeros(6)
        for i, geoms in enumerate(data.contact.geom):
            mujoco.mj_contactForce(self.model, data, i, force)
            contacts[int(self._plate in geoms)] += max(0.0, force[0])
        return _Samples(
            phase=self._phases.index(phase),
            time=time,
            voltage=data.ctrl[where.voltage],
            tip=qpos[where.slide] + where.tip_height,
            aside=qpos[where.aside],
            ball=qpos[where.ball : where.ball + 7],
            fall=fall,
            plugins=data.plugin_state[self._fields],
            contacts=contacts,
            drive=data.actuator_force[where.tip],
            lost=sum(map(self._lost, before, self._impacts)),
        )

    def _lost(self, before: float, at: list[int]) -> float:
        """Energy that a rebound in the last step cost [fJ], for the gap before it: m v^2 (1 - e^2) / 2."""
        _, gap, rebound, speed, impulse = self._data.plugin_state[at]
        if not (before > 0 >= gap and rebound > 0):
            return 0.0
        return impulse * (speed - impulse / self.model.body("ball").mass[0] / 2)

    def _watch(self, samples: _Samples) -> Watch:
        gaps, dt = samples.plugins[:, :2], self.timestep
        steps = [np.flatnonzero(gap <= 0) for gap in gaps.T]
        last = [at[-1] * dt if len(at) else np.nan for at in steps]
        first = steps[1][0] if len(steps[1]) else None
        speed = np.nan
        if first is not None:
            pairs = np.stack([gaps[:, 1], samples.fall], axis=1)
            speed = float(speed_at_zero(pairs[max(first - 1, 0)], pairs[first])) * UM / MS
        ball = slice(self._where.ball, self._where.ball + 3)
        values = {
            "last_tool": last[0],
            "last_plate": last[1],
            "first_plate": np.nan if first is None else first * dt,
            "landing_speed": speed,
            "gap_tool": gaps[-1, 0] * UM,
            "gap_plate": gaps[-1, 1] * UM,
            "speed": float(np.linalg.norm(self._data.qvel[ball])) * UM / MS,
            "finite": bool(np.isfinite(self._data.qpos).all()),
        }
        return Watch(**{name: np.array([value]) for name, value in values.items()})

    def save(self) -> Any:
        """See `Bench.save`."""
        state = np.empty(mujoco.mj_stateSize(self.model, _STATE))
        mujoco.mj_getState(self.model, self._data, state, _STATE)
        return state, len(self._samples)

    def restore(self, state: Any) -> None:
        """See `Bench.restore`; what happened since is forgotten."""
        state, count = state
        mujoco.mj_setState(self.model, self._data, state, _STATE)
        del self._samples[count:]

    def trace(self) -> Trace:
        """Trace of all moves so far."""
        samples = _stacked(self._samples)
        zero = np.zeros_like(samples.tip)
        gaps, forces = samples.plugins[:, :2] * UM, samples.plugins[:, 2:5] * NN
        return Trace(
            time=samples.time * MS,
            phase=samples.phase,
            phases=tuple(self._phases),
            voltage=samples.voltage,
            probe=np.stack([samples.aside, zero, samples.tip], axis=1) * UM,
            ball=samples.ball[:, :3] * UM,
            ball_quaternion=samples.ball[:, 3:],
            gap_tool=gaps[:, 0],
            gap_plate=gaps[:, 1],
            adhesion_tool=forces[:, 0],
            adhesion_plate=forces[:, 1],
            electrostatic=forces[:, 2],
            on_plate_potential=samples.plugins[:, 5] < 0.5,
            ball_voltage=samples.plugins[:, 6],
            contact_tool=samples.contacts[:, 0] * NN,
            contact_plate=samples.contacts[:, 1] * NN,
            broken=samples.plugins[:, 7] > 0.5,
            drive=samples.drive * NN,
            impact_loss=samples.lost * NN * UM,
            radius=float(self.model.geom_size[self._ball, 0]) * UM,
            probe_radius=float(self.model.geom("probe").size[0]) * UM,
            weight=float(-self.model.opt.gravity[2] * self.model.body("ball").mass[0]) * NN,
            probe_weight=float(-self.model.opt.gravity[2] * self.model.body("probe").mass[0]) * NN,
        )


def _stacked(samples: list[_Samples]) -> _Samples:
    return _Samples(*(np.array(values) for values in zip(*samples, strict=True)))


def trace_trial(
    trial: Trial, protocol: Protocol, voltage: float | None, gap: float, timestep: float | None = None
) -> Trace:
    """Trace of a trial from the approach to a ball that rests again.

    Args:
        trial: the ball.
        protocol: what the tool does.
        voltage: at which it lifts [V]; None: the highest rung is tried, and the ball is released only if that lifts it.
        gap: to the plate at which the ball is released [m].
        timestep: instead of that of the model [s].
    """
    bench = TraceBench(trial, protocol.start_gap, timestep=timestep)
    highest = protocol.highest_rung * protocol.step_voltage
    touch(bench, protocol)
    watch = rung(bench, protocol, highest if voltage is None else voltage)
    if stays_up(watch, protocol)[0]:
        hang(bench, protocol, gap)
        release(bench, protocol, np.array([True]), gap, to_the_end=True)
    return bench.trace()
