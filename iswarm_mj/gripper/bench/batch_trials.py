"""Trials of attempts in a swarm, as a batch inside a program of JAX: the script of `swarm_trials` on benches in MJX."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Int

from iswarm_mj.config.static import StaticGripper
from iswarm_mj.engines.mjx.api import mjx, put_model
from iswarm_mj.gripper import mjx_forces
from iswarm_mj.gripper.attempts import Attempts, Outcomes
from iswarm_mj.gripper.bench import leap_laws, script
from iswarm_mj.gripper.bench.leap_laws import Hanging
from iswarm_mj.gripper.bench.model import Layout, bench_spec, layout, plugin_numbers
from iswarm_mj.gripper.bench.script import START, Progress, Watch
from iswarm_mj.gripper.bench.swarm_trials import (
    LIFT,
    LIFT_TIME,
    PRESSED,
    PRESSED_GAP,
    PROTOCOL,
    RELEASE_LIMIT,
    TIMESTEP,
    ramp_to,
)
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import PROBE_RADIUS, WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT
from iswarm_mj.gripper.mjx_forces import Force, GripperForces, State, first_state, gripper_force, gripper_forces
from iswarm_mj.gripper.mjx_model import mjx_compatible, resize
from iswarm_mj.gripper.units import MS, NN, UM
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.scalar_backends import in_arrays

_laws, _script = in_arrays(leap_laws, jnp), in_arrays(script, jnp)
_STEPS = round(PROTOCOL.watch_time / TIMESTEP)
"""Physics steps between two looks."""
_LIMIT = max(LIFT_TIME, RELEASE_LIMIT + PROTOCOL.flight_limit)
"""Longest time of a trial [s]."""
ITERATIONS, LINE_SEARCH = 2, 4
"""Limits of the contact solver: more change no voltage, and single precision never meets MuJoCo's tolerance."""


_IDLE = mujoco.mjtDisableBit.mjDSBL_SPRING | mujoco.mjtDisableBit.mjDSBL_DAMPER
"""Stages that have nothing to do without plugins, which in C are among them."""


class MjxBench(NamedTuple):
    """A bench for programs of JAX, whose ball is that of a usual trial."""

    where: Layout
    """Addresses of the bench's numbers."""
    forces: GripperForces
    model: mjx.Model
    data: mjx.Data
    """At rest, without a voltage."""


def mjx_bench(timestep: float) -> MjxBench:
    """Return the bench with this time step [s]; numbers are single precision."""
    trial = Trial(20e-6, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE)
    chosen = bench_spec()
    chosen.option.iterations, chosen.option.ls_iterations = ITERATIONS, LINE_SEARCH
    chosen.option.disableflags |= int(_IDLE)
    chosen.option.timestep = timestep / MS
    for pair in chosen.pairs:
        pair.friction[3:] = trial.contacts.rolling / UM
    model, portable = chosen.compile(), mjx_compatible(chosen)
    forces = gripper_forces(model).having(single(plugin_numbers(trial)))
    return MjxBench(layout(model), forces, put_model(portable, "jax"), mjx.make_data(portable, impl="jax"))


def single(values: Any) -> Any:
    """Arrays of these numbers in single precision."""
    return jax.tree.map(lambda a: jnp.asarray(a, None if isinstance(a, bool) else jnp.float32), values)


def watched(
    where: Layout,
    bench: tuple[GripperForces, mjx.Model],
    data: mjx.Data,
    ball: mjx_forces.State,
    control: Callable[[Array], Array],
    n_steps: int | Array,
) -> tuple[mjx.Data, Force, Watch]:
    """Take physics steps of one bench and watch its ball; the force is that of the last step.

    `control` gives the `ctrl` (nu,) of a step by its number, from 0.
    """
    forces, model = bench
    time, (tool, plate) = model.opt.timestep * MS, forces.tool_and_plate

    def step(k: Array, carry: tuple[mjx.Data, Force, Watch]) -> tuple[mjx.Data, Force, Watch]:
        data, force, seen = carry
        data, force = mjx_forces.step(forces, model, data.replace(ctrl=control(k)), force.state)
        gap_tool, gap_plate = force.gaps[tool] * UM, force.gaps[plate] * UM
        begins = (gap_plate <= 0) & jnp.isinf(seen.first_plate)
        seen = seen._replace(
            last_tool=jnp.where(gap_tool <= 0, k * time, seen.last_tool),
            last_plate=jnp.where(gap_plate <= 0, k * time, seen.last_plate),
            first_plate=jnp.where(begins, k * time, seen.first_plate),
            landing_speed=jnp.where(begins, force.landing_speed[plate] * (UM / MS), seen.landing_speed),
            gap_tool=gap_tool,
            gap_plate=gap_plate,
        )
        return data, force, seen

    shapes = jax.eval_shape(partial(gripper_force, forces), model, data, ball)
    force = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), shapes)._replace(state=ball)
    nothing = single(Watch(-jnp.inf, -jnp.inf, jnp.inf, 0.0, jnp.nan, jnp.nan, 0.0, True))
    data, force, seen = jax.lax.fori_loop(0, n_steps, step, (data, force, nothing))
    speed = jnp.linalg.norm(data.qvel[where.ball : where.ball + 3]) * (UM / MS)
    finite = jnp.isfinite(data.qpos).all() & jnp.isfinite(data.qvel).all()
    return data, force, seen._replace(speed=speed, finite=finite)


class Slot(NamedTuple):
    """One trial in progress."""

    data: mjx.Data
    ball: State
    at: Progress
    time: Array
    """[s]"""


def by_batch(gripper: StaticGripper, attempts: Attempts) -> Outcomes:
    """Outcomes of trials in MJX, `gripper.bench_capacity` at once; the attempts beyond are postponed.

    The same script and the same laws as in `swarm_trials`, in single precision. A step of the swarm without attempts
    takes no physics step.
    """
    made, n_balls = attempts.lifts | attempts.releases, attempts.lifts.shape[0]
    count = min(gripper.bench_capacity, n_balls)
    (chosen,) = jnp.nonzero(jnp.asarray(made), size=count, fill_value=n_balls)
    is_real, place = chosen < n_balls, jnp.minimum(chosen, n_balls - 1)
    mine = jax.tree.map(lambda a: a[place], attempts)
    with jax.default_matmul_precision("highest"):
        slots = _run(gripper.release_gap, mine, is_real)
    good = slots.at.succeeds & ~slots.at.is_faulty & is_real

    def back(values: Array, kind: Any) -> Array:
        return jnp.zeros(n_balls, kind).at[chosen].set(values, mode="drop")

    tried = back(is_real, bool)
    return Outcomes(
        back(good & mine.lifts, bool),
        back(good & mine.releases, bool),
        made & ~tried,
        back(jnp.where(is_real, slots.time, 0.0), jnp.float32),
        back(jnp.where(is_real, slots.at.speed, 0.0), jnp.float32),
    )


def _run(gap: float, attempts: Attempts, is_real: Array) -> Slot:
    """Carry M trials to their ends; those that are not real are over at once."""
    with jax.ensure_compile_time_eval():
        bench = mjx_bench(TIMESTEP)

    def goes_on(carry: tuple[Slot, Int[Array, ""]]) -> Array:
        return ~carry[0].at.is_over.all() & (carry[1] < round(_LIMIT / PROTOCOL.watch_time))

    def loop(carry: tuple[Slot, Int[Array, ""]]) -> tuple[Slot, Int[Array, ""]]:
        return jax.vmap(partial(_advanced, bench, gap))(attempts, carry[0]), carry[1] + 1

    slots = jax.vmap(partial(_begin, bench, gap))(attempts)
    slots = slots._replace(at=slots.at._replace(is_over=~is_real))
    return jax.lax.while_loop(goes_on, loop, (slots, jnp.int32(0)))[0]


def _begin(bench: MjxBench, gap: float, attempt: Attempts) -> Slot:
    """A trial as it begins, see `swarm_trials`."""
    where, radius = bench.where, attempt.radius / UM
    is_pressed = attempt.lifts & (attempt.misalignment < PROBE_RADIUS)
    lying = jnp.where(is_pressed, PRESSED_GAP, jnp.array(script.first_gaps(PROTOCOL.start_gap)))
    hanging = jnp.array(script.first_gaps(PROTOCOL.start_gap, gap))
    above, below = jnp.where(attempt.releases, hanging, lying) / UM
    qpos = bench.data.qpos.at[where.ball + 2].set(radius + below)
    qpos = qpos.at[where.slide].set(2 * radius + above + below - where.tip_height)
    qpos = qpos.at[where.aside].set(attempt.misalignment / UM)
    ctrl = jnp.zeros_like(bench.data.ctrl).at[where.tip].set(qpos[where.slide])
    data = bench.data.replace(qpos=qpos, ctrl=ctrl.at[where.aside_servo].set(qpos[where.aside]))
    ball, at = (single(values) for values in (first_state(bench.forces), START))
    return Slot(data, ball, at, jnp.where(is_pressed, PRESSED, jnp.float32(0.0)))


def _advanced(bench: MjxBench, gap: float, attempt: Attempts, slot: Slot) -> Slot:
    """A trial at the next look; what is over keeps its outcome."""
    where, ready, ramp = bench.where, _ready(bench, attempt), ramp_to(attempt.voltage)

    def control(k: Array) -> Array:
        time = slot.time + (k + 1) * TIMESTEP
        tip, share = _script.setpoint(LIFT, PROTOCOL.start_gap, time)
        volts = _script.ramp_voltage(PROTOCOL, ramp, slot.at.freed, time)
        tip = jnp.where(attempt.releases, gap, tip) + 2 * attempt.radius
        volts = jnp.where(attempt.releases, volts, attempt.voltage * share)
        return slot.data.ctrl.at[where.tip].set(tip / UM - where.tip_height).at[where.voltage].set(volts)

    data, force, watch = watched(where, ready, slot.data, slot.ball, control, _STEPS)
    time = slot.time + _STEPS * TIMESTEP
    lift = slot.at._replace(
        succeeds=script.hangs(watch.gap_tool, watch.gap_plate, PROTOCOL), is_over=time >= LIFT_TIME - TIMESTEP / 2
    )
    release = _script.released(PROTOCOL, ramp, gap / 2, slot.at, watch, slot.time, time)
    at = jax.tree.map(partial(jnp.where, attempt.releases), release, lift)
    limits = _script.leap_limits(PROTOCOL, ramp, at, time)
    limits = tuple(jnp.where(attempt.releases, limit / MS, 0.0) for limit in limits)
    data, ball, passed = _leapt(bench, ready, data, force, limits)
    kept = jax.tree.map(partial(jnp.where, slot.at.is_over), (slot.at, slot.time), (at, time + passed))
    return Slot(data, ball, *kept)


def _leapt(
    bench: MjxBench, ready: tuple[GripperForces, mjx.Model], data: mjx.Data, force: Force, limits: tuple[Array, ...]
) -> tuple[mjx.Data, State, Array]:
    """Leap over a time after a step, see `SingleBench.leap`: data, ball, and the time [s]."""
    (forces, model), where, ball = ready, bench.where, force.state
    gravity = -model.opt.gravity[2]
    tool, plate = (force.adhesion[k] for k in forces.tool_and_plate)
    hold = tool - plate - gravity * model.body_mass[forces.bodies[forces.ball]]
    electric = data.ctrl[where.voltage], force.ball_voltage, ball.charge, *force.capacitances
    hanging = Hanging(*electric, forces.numbers[forces.circuit, "leak"], *force.pulls, tool, hold)
    gaps, velocity = _gaps(bench, ready, data), data.qvel[where.ball : where.ball + 3]
    leap = _laws.leap(hanging, gaps, tuple(velocity), gravity, limits, PROTOCOL.watch_time / MS)
    is_made = leap.hung + leap.flown > 0
    path = (leap.flown * velocity).at[2].set(leap.lift)
    velocity = jnp.where(leap.hung > 0, 0.0, data.qvel).at[where.ball + 2].set(leap.rise)
    data = data.replace(qpos=data.qpos.at[where.ball : where.ball + 3].add(path), qvel=velocity)
    now = _gaps(bench, ready, data)
    own = jnp.stack([now[int(pair.surface != forces.probe)] for pair in forces.pairs])
    ball = ball._replace(
        charge=leap.charge,
        before=jnp.where(is_made, own, ball.before),
        rebound=jnp.where(is_made, 0.0, ball.rebound),
    )
    return data, ball, (leap.hung + leap.flown) * MS


def _gaps(bench: MjxBench, ready: tuple[GripperForces, mjx.Model], data: mjx.Data) -> tuple[Array, Array]:
    """Gaps between the tool's face and a ball below it, and between ball and plate [um]."""
    where, (forces, model) = bench.where, ready
    height, radius = data.qpos[where.ball + 2], model.geom_size[forces.ball, 0]
    return data.qpos[where.slide] + where.tip_height - height - radius, height - radius


def _ready(bench: MjxBench, attempt: Attempts) -> tuple[GripperForces, mjx.Model]:
    """Forces and model with an attempt's ball, whose works are those at the air's humidity."""
    works = {"adhesion_probe": attempt.work_tool_object, "adhesion_plate": attempt.work_object_substrate}
    forces = bench.forces.having({(surface, "work"): work * (UM / NN) for surface, work in works.items()})
    return forces, resize(forces, bench.model, attempt.radius / UM)
