"""Trials of attempts that robots of a swarm make: each at one voltage, in MuJoCo's C engine."""

from functools import cache
from threading import Lock

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_batching import custom_vmap

from iswarm_mj.config import GripperConfig
from iswarm_mj.engines.mujoco_library import without_timers
from iswarm_mj.gripper.attempts import Attempts, Outcomes
from iswarm_mj.gripper.bench import script
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.script import START, Each, Ramp, hangs
from iswarm_mj.gripper.bench.single import SingleBench
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.numbers import in_arrays
from iswarm_mj.utils.arrays import Array

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


_IN_USE = Lock()
"""Trials are made one after the other."""


@cache
def _bench() -> SingleBench:
    """The bench that all attempts use, since making one takes as long as 300 steps."""
    return SingleBench(TIMESTEP)


def attempted(trial: Trial, voltage: float, gap: float | None) -> tuple[bool, float, float]:
    """Outcome of one attempt, see `attempt`."""
    with _IN_USE:
        return attempt(_bench(), trial, voltage, gap)


def attempt(bench: SingleBench, trial: Trial, voltage: float, gap: float | None) -> tuple[bool, float, float]:
    """Try to lift a ball, or to release one.

    Args:
        bench: on which the trial is placed.
        trial: the ball.
        voltage: of the tool [V].
        gap: between plate and ball at the release [m]; None for a lift.

    Returns:
        Whether it hangs, or stays on the plate; how long that took [s]; and the speed of its landing [m/s], 0 if there
        is none.
    """
    with without_timers():
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
            known[row] = attempted(trial, voltage, None if is_lift else gap)
        succeeded, found.duration[place], found.impact[place] = known[row]
        (found.lifted if is_lift else found.released)[place] = succeeded
    return found


def by_host(gripper: GripperConfig, attempts: Attempts) -> Outcomes:
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
