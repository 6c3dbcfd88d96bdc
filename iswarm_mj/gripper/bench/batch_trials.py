"""Trials of attempts in a swarm, as a batch inside a program of JAX: the forces of `mjx_forces`, stepped by MJX."""

import copy
from functools import cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from iswarm_mj.config import GripperConfig
from iswarm_mj.engines.mjx.api import mjx
from iswarm_mj.gripper.attempts import Attempts, Outcomes
from iswarm_mj.gripper.bench import leap_laws
from iswarm_mj.gripper.bench.engine_mjx import MjxBench, Parameters, prepared
from iswarm_mj.gripper.bench.leap_laws import REST, Hanging
from iswarm_mj.gripper.bench.model import SINK, Layout
from iswarm_mj.gripper.bench.protocol import minimum_jerk
from iswarm_mj.gripper.bench.staircase import hangs, lifting, touching
from iswarm_mj.gripper.bench.swarm_trials import PRESSED, PROTOCOL, RELEASE_LIMIT, TIMESTEP
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import GRAVITY, WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT
from iswarm_mj.gripper.laws.numbers import in_arrays
from iswarm_mj.gripper.mjx_forces import Force, GripperForces, State, first_state, stepped
from iswarm_mj.gripper.units import CLEARANCE, MS, NN, UM
from iswarm_mj.utils.arrays import Array

_laws = in_arrays(leap_laws, jnp)


class Script(NamedTuple):
    """What the tool does in an attempt to lift: P phases one after the other, from the start gap on."""

    end: Float[np.ndarray, "P"]
    """Time at which a phase ends [s]."""
    tip: Float[np.ndarray, "P"]
    """Height of the tool above its first touch as it ends [m]."""
    volts: Float[np.ndarray, "P"]
    """Share of the attempt's voltage as it ends."""


def _script() -> Script:
    _, durations, tips, volts = map(np.array, zip(*touching(PROTOCOL), *lifting(PROTOCOL, 1.0), strict=True))
    return Script(np.cumsum(durations), tips, volts)


class Slot(NamedTuple):
    """One trial in progress. Units of the bench, times in s."""

    data: mjx.Data
    ball: State
    left: Array
    """Time at which the ball was seen to have left the tool; inf: it has not."""
    down: Array
    """Whether it has touched the plate since."""
    impact: Array
    """Speed at which it first did [um/ms]."""
    is_over: Array
    succeeded: Array
    time: Array
    """[s]"""


def by_batch(gripper: GripperConfig, attempts: Attempts) -> Outcomes:
    """Outcomes of trials in MJX, `gripper.bench_capacity` at once; the attempts beyond are postponed.

    The same forces and the same tool path as in `swarm_trials`, in single precision. A step of the swarm without
    attempts takes no physics step.
    """
    made, n_balls = attempts.lifts | attempts.releases, attempts.lifts.shape[0]
    count = min(gripper.bench_capacity, n_balls)
    (chosen,) = jnp.nonzero(jnp.asarray(made), size=count, fill_value=n_balls)
    is_real, place = chosen < n_balls, jnp.minimum(chosen, n_balls - 1)
    mine = jax.tree.map(lambda a: a[place], attempts)
    with jax.default_matmul_precision("highest"):
        slots = _run(gripper.release_gap, mine, is_real)
    good = slots.succeeded & is_real

    def back(values: Array, kind: Any) -> Array:
        return jnp.zeros(n_balls, kind).at[chosen].set(values, mode="drop")

    tried = back(is_real, bool)
    return Outcomes(
        back(good & mine.lifts, bool),
        back(good & mine.releases, bool),
        made & ~tried,
        back(jnp.where(is_real, slots.time, 0.0), jnp.float32),
        back(jnp.where(is_real, slots.impact * (UM / MS), 0.0), jnp.float32),
    )


def _bench() -> MjxBench:
    """A bench whose numbers are replaced by those of attempts, for the program that is being traced."""
    bench = copy.copy(_usual())
    bench.physics, bench.parameters = jax.tree.map(_constant, (bench.physics, bench.parameters))
    return bench


@cache
def _usual() -> MjxBench:
    with jax.ensure_compile_time_eval():
        trial = Trial(20e-6, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE)
        return MjxBench([trial], PROTOCOL.start_gap, timestep=TIMESTEP)


def _constant(values: Any) -> Any:
    """An array without the devices of the program in which it was made, which another one would refuse."""
    return jnp.asarray(np.asarray(values)) if isinstance(values, jax.Array) else values


def _run(gap: float, attempts: Attempts, is_real: Array) -> Slot:
    """Carry M trials to their ends; those that are not real are over at once."""
    bench, script = _bench(), _script()
    limit = max(float(script.end[-1]), RELEASE_LIMIT + PROTOCOL.flight_limit)

    def begin(attempt: Attempts) -> Slot:
        physics, where = bench.physics, bench.where
        qpos = _start(bench, attempt, gap)
        ctrl = jnp.zeros_like(physics.data.ctrl).at[where.tip].set(qpos[where.slide])
        data = physics.data.replace(qpos=qpos, ctrl=ctrl.at[where.aside_servo].set(qpos[where.aside]))
        zero, no = jnp.float32(0.0), jnp.bool_(False)
        ball = jax.tree.map(lambda a: jnp.asarray(a, jnp.float32), first_state(physics.forces))
        time = jnp.where(_is_pressed(bench, attempt), PRESSED, zero)
        return Slot(data, ball, jnp.float32(jnp.inf), no, zero, no, no, time)

    def goes_on(carry: tuple[Slot, Int[Array, ""]]) -> Array:
        return ~carry[0].is_over.all() & (carry[1] < round(limit / bench.timestep))

    def loop(carry: tuple[Slot, Int[Array, ""]]) -> tuple[Slot, Int[Array, ""]]:
        return jax.vmap(partial(_advanced, bench, script, gap))(attempts, carry[0]), carry[1] + 1

    slots = jax.vmap(begin)(attempts)
    return jax.lax.while_loop(goes_on, loop, (slots._replace(is_over=~is_real), jnp.int32(0)))[0]


def _advanced(bench: MjxBench, script: Script, gap: float, attempt: Attempts, slot: Slot) -> Slot:
    """A trial after one physics step; what is over keeps its outcome."""
    where, (mine, model) = bench.where, prepared(bench.physics, _parameters(bench, attempt))
    time = slot.time + bench.timestep
    tip, volts = _set(script, attempt, gap, slot.left, time)
    target = 2 * attempt.radius / UM + tip / UM - where.tip_height
    ctrl = slot.data.ctrl.at[where.tip].set(target).at[where.voltage].set(volts)
    before = slot.data.replace(ctrl=ctrl)
    data, force = stepped(mine, model, before, slot.ball)
    gap_tool, gap_plate = (force.gaps[k] * UM for k in mine.tool_and_plate)
    leaves = attempt.releases & jnp.isinf(slot.left) & (gap_tool > PROTOCOL.away)
    left = jnp.where(leaves, time, slot.left)
    down = slot.down | (jnp.isfinite(left) & (gap_plate <= 0))
    impact = jnp.where(down & ~slot.down, -before.qvel[where.ball + 2], slot.impact)
    speed = jnp.linalg.norm(data.qvel[where.ball : where.ball + 3]) * (UM / MS)
    stays = down & (volts == 0) & (speed**2 / (2 * GRAVITY) + jnp.maximum(gap_plate, 0.0) < gap / 2)
    is_late = jnp.where(jnp.isinf(left), time > RELEASE_LIMIT, time > left + PROTOCOL.flight_limit)
    is_over = jnp.where(attempt.releases, stays | is_late, time >= script.end[-1])
    waits, falls = attempt.releases & jnp.isinf(left) & (time > PROTOCOL.rise_time), down & ~is_over
    limits = jnp.where(waits, (RELEASE_LIMIT - time) / MS, 0.0), jnp.where(falls, PROTOCOL.flight_limit / MS, 0.0)
    data, ball, hung = _skip_hanging(where, mine, model, data, force, limits[0])
    data, flown = _skip_flight(where, mine, model, data, ball, limits[1])
    ball = _synced(where, mine, model, data, ball, hung + flown)
    new = slot._replace(
        left=left,
        down=down,
        impact=impact,
        is_over=is_over,
        succeeded=jnp.where(attempt.releases, stays, hangs(gap_tool, gap_plate, PROTOCOL)),
        time=time + (hung + flown) * MS,
    )
    kept = jax.tree.map(partial(jnp.where, slot.is_over), slot[2:], new[2:])
    return Slot(data, ball, *kept)


def _skip_hanging(
    where: Layout, forces: GripperForces, model: mjx.Model, data: mjx.Data, force: Force, limit: Array
) -> tuple[mjx.Data, State, Array]:
    """Charge flows while a ball hangs at rest after a step, see `SingleBench.hang`: data, ball, and the time [ms]."""
    above, below = _gaps(where, forces, model, data)
    tool, plate = (force.adhesion[k] for k in forces.tool_and_plate)
    hold = tool - plate + model.body_mass[forces.joints[forces.ball][0].body] * model.opt.gravity[2]
    electric = data.ctrl[where.voltage], force.ball_voltage, force.state.charge, *force.capacitances
    ball = Hanging(*electric, forces.numbers[forces.circuit, "leak"], *force.pulls, tool, hold)
    rests = (above <= 0) & (below > CLEARANCE) & (jnp.abs(data.qvel[where.ball : where.ball + 3]).max() < REST)
    time = jnp.where(rests, jnp.maximum(_laws.hanging_time(ball, limit, 1.1), 0.0), 0.0)
    later, share = _laws.after_hanging(ball, time)
    leapt = time > 0
    qpos = data.qpos.at[where.ball + 2].add(jnp.where(leapt, above * (1 - share), 0.0))
    state = force.state._replace(charge=jnp.where(leapt, later, ball.charge))
    return data.replace(qpos=qpos, qvel=jnp.where(leapt, 0.0, data.qvel)), state, time


def _skip_flight(
    where: Layout, forces: GripperForces, model: mjx.Model, data: mjx.Data, ball: State, limit: Array
) -> tuple[mjx.Data, Array]:
    """An uncharged ball flies freely, see `SingleBench.fly`: data, and the time [ms]; a sphere need not turn."""
    gravity, rise = -model.opt.gravity[2], data.qvel[where.ball + 2]
    above, below = (gap - CLEARANCE for gap in _gaps(where, forces, model, data))
    can = (data.ctrl[where.voltage] == 0) & (ball.charge == 0) & (above > 0) & (below > 0)
    time = _laws.flight_time(rise, above, below, gravity)
    time = jnp.where(can & (time > 2 * model.opt.timestep), jnp.clip(time, 0.0, limit), 0.0)
    path = (data.qvel[where.ball : where.ball + 3] * time).at[2].add(-gravity * time**2 / 2)
    qpos = data.qpos.at[where.ball : where.ball + 3].add(path)
    return data.replace(qpos=qpos, qvel=data.qvel.at[where.ball + 2].add(-gravity * time)), time


def _synced(where: Layout, forces: GripperForces, model: mjx.Model, data: mjx.Data, ball: State, time: Array) -> State:
    """The ball whose contacts know the gaps after a leap, so that they take it for no impact."""
    both = _gaps(where, forces, model, data)
    own = jnp.stack([both[int(pair.surface != forces.probe)] for pair in forces.pairs])
    leapt = time > 0
    return ball._replace(before=jnp.where(leapt, own, ball.before), rebound=jnp.where(leapt, 0.0, ball.rebound))


def _gaps(where: Layout, forces: GripperForces, model: mjx.Model, data: mjx.Data) -> tuple[Array, Array]:
    """Gaps between the tool's face and a ball below it, and between ball and plate, see `SingleBench` [um]."""
    height, radius = data.qpos[where.ball + 2], model.geom_size[forces.ball, 0]
    return data.qpos[where.slide] + where.tip_height - height - radius, height - radius


def _set(script: Script, attempt: Attempts, gap: float, left: Array, time: Array) -> tuple[Array, Array]:
    """Height of the tool [m] and its voltage [V] at a time of an attempt whose ball was seen to leave at `left` [s]."""
    ends, tips, shares = (jnp.asarray(values, jnp.float32) for values in script)
    phase = jnp.minimum(jnp.searchsorted(ends, time - 1e-9), len(ends) - 1)
    before = jnp.maximum(phase - 1, 0)
    is_first = phase == 0
    start = jnp.where(is_first, 0.0, ends[before])
    share = jnp.clip((time - start) / (ends[phase] - start), 0.0, 1.0)
    from_tip = jnp.where(is_first, PROTOCOL.start_gap, tips[before])
    from_volts = jnp.where(is_first, 0.0, shares[before])
    tip = from_tip + minimum_jerk(share) * (tips[phase] - from_tip)
    volts = from_volts + share * (shares[phase] - from_volts)
    rise = jnp.minimum(time / PROTOCOL.rise_time, 1.0)
    cut = jnp.clip(1 - (time - left) / PROTOCOL.cut_time, 0.0, 1.0)
    drop = jnp.where(jnp.isinf(left), rise, cut)
    return jnp.where(attempt.releases, gap, tip), attempt.voltage * jnp.where(attempt.releases, drop, volts)


def _parameters(bench: MjxBench, attempt: Attempts) -> Parameters:
    """Numbers of a trial with an attempt's ball, whose works are those at the air's humidity."""
    usual = jax.tree.map(lambda a: a[0], bench.parameters)
    works = {"adhesion_probe": attempt.work_tool_object, "adhesion_plate": attempt.work_object_substrate}
    works = {(surface, "work"): work * (UM / NN) for surface, work in works.items()}
    return usual._replace(radius=attempt.radius / UM, numbers=usual.numbers | works)


def _start(bench: MjxBench, attempt: Attempts, gap: float) -> Array:
    """Positions (nq,) at the start of an attempt, see `model.start`."""
    where, radius = bench.where, attempt.radius / UM
    tip, _ = _set(_script(), attempt, gap, jnp.float32(jnp.inf), jnp.float32(PRESSED))
    pressed = jnp.stack([tip, tip * 2]) / (2 * UM)
    lying = jnp.where(_is_pressed(bench, attempt), pressed, jnp.array([-SINK, PROTOCOL.start_gap / UM]))
    hanging = jnp.array([gap / UM + SINK, gap / UM])
    ball, tip = jnp.where(attempt.releases, hanging, lying)
    qpos = bench.physics.data.qpos.at[where.ball + 2].set(radius + ball)
    qpos = qpos.at[where.slide].set(2 * radius + tip - where.tip_height)
    return qpos.at[where.aside].set(attempt.misalignment / UM)


def _is_pressed(bench: MjxBench, attempt: Attempts) -> Array:
    """Whether the trial begins where the tool presses the ball, see `single.SingleBench.press`."""
    return attempt.lifts & (attempt.misalignment < bench.parameters.probe_radius[0] * UM)
