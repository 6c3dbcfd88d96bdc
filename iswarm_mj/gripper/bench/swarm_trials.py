"""Trials of attempts that robots of a swarm make: each at one voltage, in MuJoCo's C engine.

Physics goes step by step, with closed-form leaps over times (`leap_laws`). Leaps are two thirds of a trial: the tool
presses the ball on the plate, and only where it is now matters; a ball hangs at rest while charge flows; an uncharged
ball flies. Whatever makes or ends a contact is left to physics.
"""

import copy
import math
from functools import cache
from threading import Lock

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jax.custom_batching import custom_vmap

from iswarm_mj.config.static import StaticGripper
from iswarm_mj.engines.mujoco_library import keep_no_log, without_timers
from iswarm_mj.gripper import plugin
from iswarm_mj.gripper.attempts import Attempts, Outcomes
from iswarm_mj.gripper.bench import script
from iswarm_mj.gripper.bench.leap_laws import Hanging, leap
from iswarm_mj.gripper.bench.model import layout, plugin_numbers, resized, start, usual_model
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.script import START, Each, Ramp, Watch, hangs
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.units import MS, UM
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.scalar_backends import in_arrays

TIMESTEP = 2e-6
"""Twice that of the bench: voltages change by less than 1 %, the speed of a landing by less than 4 %
(`tests/gripper/test_landing.py`) [s]."""
PROTOCOL = Protocol(start_gap=0.2e-6, approach_time=0.06e-3, flight_limit=10e-3, watch_time=0.02e-3)
"""Of attempts in the swarm: the tool starts near the ball, since nothing happens before."""
RELEASE_LIMIT = 6e-3
"""Time at the release voltage after which a ball that still hangs counts as not released: ten relaxation times of its
charge [s]."""
LIFT = (*script.touching(PROTOCOL), *script.lifting(PROTOCOL, 1.0))
"""Moves of a lift, with shares of its voltage."""
LIFT_TIME = sum(move.duration for move in LIFT)
"""[s]"""
PRESSED = PROTOCOL.approach_time + PROTOCOL.dwell + PROTOCOL.rise_time + 0.1 * PROTOCOL.peel_time
"""Time that a lift leaps over, a tenth of the retraction, too; with a fifth, the first balls leave the plate before
servo and contacts have come to rest [s]."""
PRESSED_GAP = script.setpoint(LIFT, PROTOCOL.start_gap, PRESSED)[0] / 2
"""Gaps of the ball to tool and plate then [m]."""


def ramp_to(voltage: Each) -> Ramp:
    """Voltage [V] of a release."""
    return Ramp(voltage / PROTOCOL.rise_time, voltage, RELEASE_LIMIT)


_HANGING = "ball_voltage", "charge", "to_probe", "to_plate", "leak", "up", "down"
_TOOL, _PLATE = "adhesion_probe", "adhesion_plate"


class SingleBench:
    """A ball and a tool of the usual radius.

    Attributes:
        model: with the ball's radius.
        data: of MuJoCo; physics resumes from what is written there.
        where: numbers are in its arrays.
        at: indices of the plugins' numbers in `plugin_state`, by instance and field.
        timestep: [s].
    """

    def __init__(self, timestep: float):
        """Prepare a bench on which `place` begins a trial."""
        keep_no_log()
        self._usual = usual_model(timestep)
        self.model, self.data, self.timestep = copy.copy(self._usual), mujoco.MjData(self._usual), timestep
        self.where, self.at = layout(self.model), plugin.state_indices(self.model)
        self._times = [self.at[_TOOL, "last"], self.at[_PLATE, "last"], self.at[_PLATE, "first"]]
        self._gaps = [self.at["electrostatic", name] for name in ("probe_gap", "plate_gap")]
        self._landing = self.at[_PLATE, "landing_speed"]
        self._hanging = [self.at["electrostatic", name] for name in _HANGING]
        self._adhesion = [self.at[surface, "force"] for surface in (_TOOL, _PLATE)]
        self._touch = self._looked = 0.0

    def place(self, trial: Trial, gaps: tuple[float, float]) -> None:
        """Begin a trial with these gaps of the ball to tool and plate [m]; a tenth of the time that a new bench takes.

        If they are negative, the tool presses the ball on the plate. There the ball has the plate's potential and
        cannot move, so that after a few steps nothing is left of what was before.
        """
        data, where = self.data, self.where
        self.model = resized(self._usual, trial.radius, (self.model, data))
        mujoco.mj_resetData(self.model, data)
        data.qpos[:], self._looked = start(self.model, trial, gaps), 0.0
        self._touch = 2 * trial.radius / UM - where.tip_height
        for names, value in plugin_numbers(trial).items():
            data.plugin_state[self.at[names]] = value
        data.ctrl[[where.tip, where.aside_servo]] = data.qpos[[where.slide, where.aside]]

    def step(self, tip: float, voltage: float) -> None:
        """Take a physics step with these setpoints: height of the tool above its first touch [m], and voltage [V]."""
        self.data.ctrl[self.where.tip], self.data.ctrl[self.where.voltage] = self._touch + tip / UM, voltage
        mujoco.mj_step(self.model, self.data)

    def watch(self) -> Watch:
        """What happened since the last look."""
        data, ball = self.data, self.where.ball
        state, (x, y, z) = data.plugin_state.tolist(), data.qvel[ball : ball + 3].tolist()
        last_tool, last_plate, first = (MS * (state[i] - self._looked) for i in self._times)
        gap_tool, gap_plate = (UM * state[i] for i in self._gaps)
        speed = (x * x + y * y + z * z) ** 0.5 * UM / MS
        data.plugin_state[self._times[2]], self._looked = -1.0, data.time
        return Watch(
            last_tool if last_tool >= 0 else -math.inf,
            last_plate if last_plate >= 0 else -math.inf,
            first if first >= 0 else math.inf,
            state[self._landing] * UM / MS,
            gap_tool,
            gap_plate,
            speed,
            math.isfinite(speed),
        )

    @property
    def is_finite(self) -> bool:
        """Whether the state is finite and MuJoCo has warned of nothing."""
        state = np.concatenate([self.data.qpos, self.data.qvel, self.data.plugin_state])
        return bool(np.isfinite(state).all() and not self.data.warning.number.any())

    def leap(self, limits: tuple[float, float], period: float) -> float:
        """Leap over a time in which the ball hangs at rest or flies freely, see `leap_laws.leap`.

        Args:
            limits: longest times of hanging and of flying [s].
            period: of which a leap takes a whole multiple [s].

        Returns:
            Time that passed [s].
        """
        data, model, ball = self.data, self.model, self.where.ball
        state, velocity = data.plugin_state.tolist(), data.qvel[ball : ball + 3].tolist()
        gravity, voltage = -float(model.opt.gravity[2]), float(data.ctrl[self.where.voltage])
        tool, plate = (state[i] for i in self._adhesion)
        hold = tool - plate - gravity * float(model.body_mass[model.dof_bodyid[ball]])
        hanging = Hanging(voltage, *(state[i] for i in self._hanging), adhesion=tool, hold=hold)
        longest = limits[0] / MS, limits[1] / MS
        leapt = leap(hanging, self._present_gaps(), velocity, gravity, longest, period / MS)
        if leapt.hung + leapt.flown == 0:
            return 0.0
        data.qpos[ball : ball + 2] += leapt.flown * data.qvel[ball : ball + 2]
        data.qpos[ball + 2] += leapt.lift
        if leapt.hung > 0:
            data.qvel[:] = 0.0
        data.qvel[ball + 2], data.plugin_state[self.at["electrostatic", "charge"]] = leapt.rise, leapt.charge
        for surface, gap in zip((_TOOL, _PLATE), self._present_gaps(), strict=True):
            data.plugin_state[self.at[surface, "before"]] = gap  # so that they take no leap for an impact
            data.plugin_state[self.at[surface, "rebound"]] = 0.0
        data.qacc_warmstart[:] = 0.0
        return float(leapt.hung + leapt.flown) * MS

    def _present_gaps(self) -> tuple[float, float]:
        """Gaps between the tool's face and a ball below it, and between ball and plate [um]."""
        qpos, where, radius = self.data.qpos, self.where, self._touch + self.where.tip_height
        height = float(qpos[where.ball + 2])
        return float(qpos[where.slide]) + where.tip_height - height - radius / 2, height - radius / 2


_IN_USE = Lock()
"""Trials are made one after the other."""


@cache
def _bench() -> SingleBench:
    """The bench that all attempts use, since making one takes as long as 300 steps."""
    return SingleBench(TIMESTEP)


def attempt(
    trial: Trial, voltage: float, gap: float | None, bench: SingleBench | None = None
) -> tuple[bool, float, float]:
    """Try to lift a ball, or to release one.

    Args:
        trial: the ball.
        voltage: of the tool [V].
        gap: between plate and ball at the release [m]; None for a lift.
        bench: on which the trial is placed, instead of that of all attempts.

    Returns:
        Whether it hangs, or stays on the plate; how long that took [s]; and the speed of its landing [m/s], 0 if there
        is none.
    """
    with _IN_USE, without_timers():
        bench = bench or _bench()
        return _lift(bench, trial, voltage) if gap is None else _drop(bench, trial, voltage, gap)


def _lift(bench: SingleBench, trial: Trial, voltage: float) -> tuple[bool, float, float]:
    """Touch, raise the voltage, retract, switch off."""
    is_below = trial.misalignment < trial.probe_radius
    gaps = (PRESSED_GAP, PRESSED_GAP) if is_below else script.first_gaps(PROTOCOL.start_gap)
    bench.place(trial, gaps)
    n_steps, skip = (round(time / bench.timestep) for time in (LIFT_TIME, PRESSED if is_below else 0.0))
    times = bench.timestep * np.arange(skip + 1, n_steps + 1)
    tips, shares = in_arrays(script, np).setpoint(LIFT, PROTOCOL.start_gap, times)
    for tip, volts in zip(tips.tolist(), (voltage * shares).tolist(), strict=True):
        bench.step(tip, volts)
    watch = bench.watch()
    return hangs(watch.gap_tool, watch.gap_plate, PROTOCOL) and bench.is_finite, n_steps * bench.timestep, 0.0


def _drop(bench: SingleBench, trial: Trial, voltage: float, gap: float) -> tuple[bool, float, float]:
    """Raise the voltage on a hanging, uncharged ball and cut it when it has left."""
    bench.place(trial, script.first_gaps(PROTOCOL.start_gap, gap))
    ramp, at, time = ramp_to(voltage), START, 0.0
    n_steps = round(PROTOCOL.watch_time / bench.timestep)
    while not at.is_over:
        began = time
        for _ in range(n_steps):
            time += bench.timestep
            bench.step(gap, script.ramp_voltage(PROTOCOL, ramp, at.freed, time))
        at = script.released(PROTOCOL, ramp, gap / 2, at, bench.watch(), began, time)
        limits = script.leap_limits(PROTOCOL, ramp, at, time)
        time += bench.leap(limits, PROTOCOL.watch_time) if max(limits) > 0 else 0.0
    return bool(at.succeeds) and bench.is_finite, time, float(at.speed)


def outcomes(gap: float, attempts: Attempts) -> Outcomes:
    """Outcomes of attempts (..., K), as NumPy arrays.

    Args:
        gap: of releases [m].
        attempts: what is tried; the works of adhesion are those at the air's humidity.
    """
    shape = attempts.lifts.shape
    found = Outcomes(*(np.zeros(shape, kind) for kind in (bool, bool, bool, np.float32, np.float32)))
    numbers = [np.broadcast_to(values, shape) for values in attempts[2:]]
    known: dict[tuple[float, ...], tuple[bool, float, float]] = {}  # worlds that only fill up a batch are copies
    for place in zip(*np.nonzero(np.asarray(attempts.lifts | attempts.releases)), strict=True):
        is_lift = bool(attempts.lifts[place])
        row = is_lift, *(float(values[place]) for values in numbers)
        if row not in known:
            _, voltage, radius, tool, floor, miss = row
            trial = Trial(radius, tool, floor, 10.0, misalignment=miss)  # whose factor of humidity is 1
            known[row] = attempt(trial, voltage, None if is_lift else gap)
        succeeded, found.duration[place], found.impact[place] = known[row]
        (found.lifted if is_lift else found.released)[place] = succeeded
    return found


def by_host(gripper: StaticGripper, attempts: Attempts) -> Outcomes:
    """Outcomes of trials in MuJoCo's C engine, by a callback from a program of JAX.

    The callback is skipped in steps in which no world makes an attempt. All numbers go as one array and come back as
    one, since each array costs time.
    """

    def call(numbers: jax.Array) -> np.ndarray:
        lifts, releases, *others = np.asarray(numbers)
        found = outcomes(gripper.release_gap, Attempts(lifts > 0, releases > 0, *others))
        return np.stack(found).astype(np.float32)

    def on_host(numbers: Array) -> Array:
        return jax.pure_callback(call, _places(numbers), numbers)

    @custom_vmap
    def decide(numbers: Array) -> Array:
        return jax.lax.cond(numbers[:2].any(), on_host, lambda a: jnp.zeros_like(a, shape=_places(a).shape), numbers)

    @decide.def_vmap
    def _(count: int, is_batched: list[bool], numbers: Array) -> tuple[Array, bool]:
        del count, is_batched
        return jnp.moveaxis(decide(jnp.moveaxis(numbers, 0, 1)), 1, 0), True

    lifted, released, postponed, *others = decide(jnp.stack([jnp.asarray(a, jnp.float32) for a in attempts]))
    return Outcomes(lifted > 0, released > 0, postponed > 0, *others)


def _places(numbers: Array) -> jax.ShapeDtypeStruct:
    """Shape (5, ..., K) of the outcomes of attempts (7, ..., K)."""
    return jax.ShapeDtypeStruct((len(Outcomes._fields), *numbers.shape[1:]), jnp.float32)
