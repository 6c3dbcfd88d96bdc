"""Trials of attempts that robots of a swarm make: each at one voltage, in MuJoCo's C engine.

Physics goes step by step, with closed-form leaps over times (`leap_laws`). They are two thirds of a
trial: the tool presses the ball on the plate, where only its present position matters; a ball hangs
at rest while charge flows; an uncharged ball flies. Physics makes and ends all contacts.
"""

import copy
import math
from dataclasses import replace
from functools import lru_cache
from threading import Lock
from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jax.custom_batching import custom_vmap

from iswarm_mj.config.static import StaticGripper
from iswarm_mj.engines.mujoco_library import keep_no_log, without_timers
from iswarm_mj.gripper import plugin
from iswarm_mj.gripper.attempts import Attempts, Outcomes, tip_of
from iswarm_mj.gripper.bench import script
from iswarm_mj.gripper.bench.leap_laws import Hanging, leap
from iswarm_mj.gripper.bench.model import layout, plugin_numbers, resized, start, usual_model
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.script import START, Each, Ramp, Watch, hangs
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import PROBE_RADIUS
from iswarm_mj.gripper.tips.table import TipTable
from iswarm_mj.gripper.units import MS, UM
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.scalar_backends import in_arrays

TIMESTEP = 2e-6
"""Time step [s], twice that of the bench.

Voltages change by less than 1 %, the speed of a landing by less than 4 %
(`tests/gripper/test_landing.py`).
"""
PROTOCOL = Protocol(start_gap=0.2e-6, approach_time=0.06e-3, flight_limit=10e-3, watch_time=0.02e-3)
"""Protocol of attempts in the swarm; the tool starts near the ball, where events begin."""
RELEASE_LIMIT = 6e-3
"""Time at the release voltage after which a ball that still hangs counts as not released [s].

It is ten relaxation times of its charge.
"""
LIFT = (*script.touching(PROTOCOL), *script.lifting(PROTOCOL, 1.0))
"""Moves of a lift, with shares of its voltage."""
LIFT_TIME = sum(move.duration for move in LIFT)
"""Duration of a lift [s]."""
PRESSED = PROTOCOL.approach_time + PROTOCOL.dwell + PROTOCOL.rise_time + 0.1 * PROTOCOL.peel_time
"""Time that a lift leaps over, up to a tenth of the retraction [s].

With a fifth, the first balls leave the plate before servo and contacts have come to rest.
"""
PRESSED_GAP = script.setpoint(LIFT, PROTOCOL.start_gap, PRESSED)[0] / 2
"""Gap of the ball to the tool, and to the plate, after this time [m]."""


def protocol_of(gripper: StaticGripper) -> Protocol:
    """Return the protocol of attempts of a gripper, which has a delay of the cut of its own."""
    return replace(PROTOCOL, cut_delay=gripper.cut_delay)


def ramp_to(voltage: Each) -> Ramp:
    """Return the ramp of a release, which rises to a voltage [V] and stays there."""
    return Ramp(rate=voltage / PROTOCOL.rise_time, limit=voltage, patience=RELEASE_LIMIT)


_TOOL, _PLATE = "adhesion_probe", "adhesion_plate"
"""Instances of the adhesion plugin."""
_CIRCUIT = "electrostatic"
"""Instance of the electrostatic plugin."""


class SingleBench:
    """A bench with one ball, on which trials are placed one after the other.

    Attributes:
        model: with the ball's radius.
        data: of MuJoCo; physics resumes from what is written there.
        where: addresses of numbers in MuJoCo's arrays.
        index_of: indices of the plugins' numbers in `plugin_state`, by instance and field.
        timestep: time step [s].
    """

    def __init__(self, timestep: float, tip: TipTable | None = None):
        """Prepare a bench on which `place` begins a trial.

        Args:
            timestep: time step [s].
            tip: table of the tool's tip; None for a flat one.
        """
        keep_no_log()
        self._usual = usual_model(timestep, probe_radius=radius_of(tip), tip=tip)
        self.model = copy.copy(self._usual)
        self.data = mujoco.MjData(self._usual)
        self.timestep = timestep
        self.where = layout(self.model)
        self.index_of = plugin.state_indices(self.model)
        self._tip_at_touch = 0.0
        self._last_look = 0.0

    def place(self, trial: Trial, gaps: tuple[float, float]) -> None:
        """Begin a trial, in a tenth of the time that a new bench takes.

        With negative gaps the tool presses the ball on the plate. There the ball has the plate's
        potential and cannot move, so that after a few steps nothing is left of the state before.

        Args:
            trial: the ball.
            gaps: of the ball to tool and plate [m].
        """
        data = self.data
        where = self.where
        self.model = resized(self._usual, trial.radius, (self.model, data))
        mujoco.mj_resetData(self.model, data)
        data.qpos[:] = start(self.model, trial, gaps)
        self._last_look = 0.0
        self._tip_at_touch = 2 * trial.radius / UM - where.tip_height
        for place, value in plugin_numbers(trial).items():
            data.plugin_state[self.index_of[place]] = value
        data.ctrl[where.tip] = data.qpos[where.slide]
        data.ctrl[where.aside_servo] = data.qpos[where.aside]

    def step(self, tip: float, voltage: float) -> None:
        """Take a physics step.

        Args:
            tip: setpoint of the tool's height above its first touch of the ball at rest [m].
            voltage: of the tool [V].
        """
        self.data.ctrl[self.where.tip] = self._tip_at_touch + tip / UM
        self.data.ctrl[self.where.voltage] = voltage
        mujoco.mj_step(self.model, self.data)

    def watch(self) -> Watch:
        """Return the events since the last look."""
        data = self.data
        state = data.plugin_state.tolist()
        last_tool = MS * (state[self.index_of[_TOOL, "last"]] - self._last_look)
        last_plate = MS * (state[self.index_of[_PLATE, "last"]] - self._last_look)
        first_plate = MS * (state[self.index_of[_PLATE, "first"]] - self._last_look)
        x, y, z = self._velocity()
        speed = (x * x + y * y + z * z) ** 0.5 * UM / MS

        data.plugin_state[self.index_of[_PLATE, "first"]] = -1.0
        self._last_look = data.time
        return Watch(
            last_tool=last_tool if last_tool >= 0 else -math.inf,
            last_plate=last_plate if last_plate >= 0 else -math.inf,
            first_plate=first_plate if first_plate >= 0 else math.inf,
            landing_speed=state[self.index_of[_PLATE, "landing_speed"]] * UM / MS,
            gap_tool=UM * state[self.index_of[_CIRCUIT, "probe_gap"]],
            gap_plate=UM * state[self.index_of[_CIRCUIT, "plate_gap"]],
            speed=speed,
            finite=math.isfinite(speed),
        )

    @property
    def is_finite(self) -> bool:
        """True if the state is finite and MuJoCo has warned of nothing."""
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
        result = leap(
            ball=self._hanging_ball(),
            gaps=self._present_gaps(),
            velocity=self._velocity(),
            gravity=self._gravity(),
            limits=(limits[0] / MS, limits[1] / MS),
            period=period / MS,
        )
        time = result.hung + result.flown
        if time == 0:
            return 0.0

        data = self.data
        ball = self.where.ball
        data.qpos[ball : ball + 2] += result.flown * data.qvel[ball : ball + 2]
        data.qpos[ball + 2] += result.lift
        if result.hung > 0:
            data.qvel[:] = 0.0
        data.qvel[ball + 2] = result.rise
        data.plugin_state[self.index_of[_CIRCUIT, "charge"]] = result.charge

        # The plugins must not take the leap for an impact.
        tool_gap, plate_gap = self._present_gaps()
        data.plugin_state[self.index_of[_TOOL, "before"]] = tool_gap
        data.plugin_state[self.index_of[_PLATE, "before"]] = plate_gap
        for surface in (_TOOL, _PLATE):
            data.plugin_state[self.index_of[surface, "rebound"]] = 0.0
        data.qacc_warmstart[:] = 0.0
        return float(time) * MS

    def _hanging_ball(self) -> Hanging:
        """Return what leaps need to know of the ball."""
        state = self.data.plugin_state.tolist()
        tool = state[self.index_of[_TOOL, "force"]]
        plate = state[self.index_of[_PLATE, "force"]]
        mass = float(self.model.body_mass[self.model.dof_bodyid[self.where.ball]])
        return Hanging(
            voltage=float(self.data.ctrl[self.where.voltage]),
            ball_voltage=state[self.index_of[_CIRCUIT, "ball_voltage"]],
            charge=state[self.index_of[_CIRCUIT, "charge"]],
            to_probe=state[self.index_of[_CIRCUIT, "to_probe"]],
            to_plate=state[self.index_of[_CIRCUIT, "to_plate"]],
            leak=state[self.index_of[_CIRCUIT, "leak"]],
            up=state[self.index_of[_CIRCUIT, "up"]],
            down=state[self.index_of[_CIRCUIT, "down"]],
            adhesion=tool,
            hold=tool - plate - self._gravity() * mass,
        )

    def _gravity(self) -> float:
        """Return the acceleration of gravity [um/ms^2]."""
        return -float(self.model.opt.gravity[2])

    def _velocity(self) -> tuple[float, float, float]:
        """Return the velocity of the ball along x, y and z [um/ms]."""
        ball = self.where.ball
        x, y, z = self.data.qvel[ball : ball + 3].tolist()
        return x, y, z

    def _present_gaps(self) -> tuple[float, float]:
        """Return the gaps of the ball to the tool's face above it and to the plate [um]."""
        qpos = self.data.qpos
        where = self.where
        radius = (self._tip_at_touch + where.tip_height) / 2
        height = float(qpos[where.ball + 2])
        face = float(qpos[where.slide]) + where.tip_height
        return face - height - radius, height - radius


_IN_USE = Lock()
"""Held during a trial, since trials are made one after the other on one bench."""


@lru_cache(maxsize=8)
def _bench(tip: TipTable | None = None) -> SingleBench:
    """Return the bench of all attempts with a tip, since making one takes as long as 300 steps."""
    return SingleBench(TIMESTEP, tip)


def radius_of(tip: TipTable | None) -> float:
    """Return the radius of a tool with a tip [m]; None for a flat one."""
    return PROBE_RADIUS if tip is None else tip.profile.radius


class TrialOutcome(NamedTuple):
    """Outcome of a trial at one voltage."""

    succeeded: bool
    """True if the ball hangs at the tool, or stays on the plate."""
    duration: float
    """Duration [s]."""
    impact: float
    """Speed of the ball's landing [m/s]; 0 if there is none."""


def attempt(
    trial: Trial,
    voltage: float,
    gap: float | None,
    bench: SingleBench | None = None,
    tip: TipTable | None = None,
    protocol: Protocol = PROTOCOL,
) -> TrialOutcome:
    """Try to lift a ball, or to release one.

    Args:
        trial: the ball.
        voltage: of the tool [V].
        gap: between plate and ball at the release [m]; None for a lift.
        bench: on which the trial is placed, instead of that of all attempts with the tip.
        tip: table of the tool's tip; None for a flat one.
        protocol: of the release, see `protocol_of`.
    """
    with _IN_USE, without_timers():
        bench = bench or _bench(tip)
        if gap is None:
            return _lift(bench, trial, voltage)
        return _release(bench, trial, voltage, gap, protocol)


def _lift(bench: SingleBench, trial: Trial, voltage: float) -> TrialOutcome:
    """Touch the ball, raise the voltage, retract the tool, and switch the voltage off."""
    n_steps = round(LIFT_TIME / bench.timestep)
    if trial.misalignment < trial.probe_radius:
        # The tool presses the ball on the plate, which needs no physics steps.
        bench.place(trial, (PRESSED_GAP, PRESSED_GAP))
        n_leapt = round(PRESSED / bench.timestep)
    else:
        bench.place(trial, script.first_gaps(PROTOCOL.start_gap))
        n_leapt = 0

    times = bench.timestep * np.arange(n_leapt + 1, n_steps + 1)
    tips, shares = in_arrays(script, np).setpoint(LIFT, PROTOCOL.start_gap, times)
    for tip, volts in zip(tips.tolist(), (voltage * shares).tolist(), strict=True):
        bench.step(tip, volts)

    watch = bench.watch()
    succeeded = hangs(watch.gap_tool, watch.gap_plate, PROTOCOL) and bench.is_finite
    return TrialOutcome(succeeded, duration=n_steps * bench.timestep, impact=0.0)


def _release(
    bench: SingleBench, trial: Trial, voltage: float, gap: float, protocol: Protocol
) -> TrialOutcome:
    """Raise the voltage on a hanging, uncharged ball, and cut it when the ball has left."""
    bench.place(trial, script.first_gaps(protocol.start_gap, gap))
    ramp = ramp_to(voltage)
    n_steps = round(protocol.watch_time / bench.timestep)

    progress = START
    time = 0.0
    while not progress.is_over:
        last_look = time
        for _ in range(n_steps):
            time += bench.timestep
            volts = script.ramp_voltage(protocol, ramp, progress.freed, time)
            bench.step(gap, volts)
        progress = script.released(
            protocol=protocol,
            ramp=ramp,
            low=gap / 2,
            was=progress,
            watch=bench.watch(),
            last_look=last_look,
            time=time,
        )
        limits = script.leap_limits(protocol, ramp, progress, time)
        if max(limits) > 0:
            time += bench.leap(limits, protocol.watch_time)

    succeeded = bool(progress.succeeds) and bench.is_finite
    return TrialOutcome(succeeded, duration=time, impact=float(progress.speed))


def outcomes(
    gap: float,
    attempts: Attempts,
    tip: TipTable | None = None,
    protocol: Protocol = PROTOCOL,
) -> Outcomes:
    """Return the outcomes of attempts (..., K), as NumPy arrays.

    Args:
        gap: of releases [m].
        attempts: with the works of adhesion at the air's humidity.
        tip: table of the tools' tips; None for flat ones.
        protocol: of the releases, see `protocol_of`.
    """
    shape = attempts.lifts.shape
    result = Outcomes(
        lifted=np.zeros(shape, bool),
        released=np.zeros(shape, bool),
        postponed=np.zeros(shape, bool),
        duration=np.zeros(shape, np.float32),
        impact=np.zeros(shape, np.float32),
    )
    attempts = Attempts(*(np.broadcast_to(values, shape) for values in attempts))

    # Worlds that only fill up a batch are copies of others, whose trials are not made again.
    known: dict[tuple[bool, float, Trial], TrialOutcome] = {}
    for place in zip(*np.nonzero(attempts.lifts | attempts.releases), strict=True):
        is_lift = bool(attempts.lifts[place])
        voltage = float(attempts.voltage[place])
        trial = Trial(
            radius=float(attempts.radius[place]),
            work_tool_object=float(attempts.work_tool_object[place]),
            work_object_substrate=float(attempts.work_object_substrate[place]),
            relative_humidity=10.0,  # at which the works are, since its factor is 1
            probe_radius=radius_of(tip),
            misalignment=float(attempts.misalignment[place]),
        )
        key = is_lift, voltage, trial
        if key not in known:
            gap_of_trial = None if is_lift else gap
            known[key] = attempt(trial, voltage, gap_of_trial, tip=tip, protocol=protocol)
        outcome = known[key]
        succeeded = result.lifted if is_lift else result.released
        succeeded[place] = outcome.succeeded
        result.duration[place] = outcome.duration
        result.impact[place] = outcome.impact
    return result


def by_host(gripper: StaticGripper, attempts: Attempts) -> Outcomes:
    """Return the outcomes of attempts, simulated in MuJoCo's C engine by a callback from JAX.

    The callback is skipped in steps in which no world makes an attempt. All numbers go as one array
    and come back as one, since each array costs time: the rows are the fields of `Attempts` and of
    `Outcomes`, in their order.
    """

    tip = tip_of(gripper)
    protocol = protocol_of(gripper)

    def call(numbers: jax.Array) -> np.ndarray:
        lifts, releases, *conditions = np.asarray(numbers)
        attempts = Attempts(lifts > 0, releases > 0, *conditions)
        decided = outcomes(gripper.release_gap, attempts, tip, protocol)
        return np.stack(decided).astype(np.float32)

    def on_host(numbers: Array) -> Array:
        return jax.pure_callback(call, _shape_of_outcomes(numbers), numbers)

    def nothing(numbers: Array) -> Array:
        return jnp.zeros_like(numbers, shape=_shape_of_outcomes(numbers).shape)

    # Under a plain vmap the condition would become a select, which always calls the host.
    @custom_vmap
    def decide(numbers: Array) -> Array:
        lifts_and_releases = numbers[:2]
        return jax.lax.cond(lifts_and_releases.any(), on_host, nothing, numbers)

    @decide.def_vmap
    def _(count: int, is_batched: list[bool], numbers: Array) -> tuple[Array, bool]:
        # Worlds become an axis of the attempts, so that the host is called once for all. Fields
        # stay the first axis inside, (7, worlds, ..., K); each further vmap comes here again.
        del count, is_batched
        return jnp.moveaxis(decide(jnp.moveaxis(numbers, 0, 1)), 1, 0), True

    numbers = jnp.stack([jnp.asarray(values, jnp.float32) for values in attempts])
    lifted, released, postponed, duration, impact = decide(numbers)
    return Outcomes(
        lifted=lifted > 0,
        released=released > 0,
        postponed=postponed > 0,
        duration=duration,
        impact=impact,
    )


def _shape_of_outcomes(numbers: Array) -> jax.ShapeDtypeStruct:
    """Return the shape (5, ..., K) of the outcomes of attempts (7, ..., K)."""
    return jax.ShapeDtypeStruct((len(Outcomes._fields), *numbers.shape[1:]), jnp.float32)
