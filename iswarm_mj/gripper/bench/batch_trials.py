"""Trials of attempts in a swarm as a batch inside a program of JAX.

The script of `swarm_trials` on benches in MJX.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Int

from iswarm_mj.config.static import StaticGripper
from iswarm_mj.engines.mjx.api import mjx, put_model
from iswarm_mj.gripper import mjx_forces
from iswarm_mj.gripper.attempts import Attempts, Outcomes, tip_of
from iswarm_mj.gripper.bench import leap_laws, script
from iswarm_mj.gripper.bench.leap_laws import Hanging
from iswarm_mj.gripper.bench.model import Layout, bench_spec, layout, plugin_numbers, put_tip
from iswarm_mj.gripper.bench.protocol import Protocol
from iswarm_mj.gripper.bench.script import START, Progress, Ramp, Watch
from iswarm_mj.gripper.bench.swarm_trials import (
    LIFT,
    LIFT_TIME,
    PRESSED,
    PRESSED_GAP,
    PROTOCOL,
    RELEASE_LIMIT,
    TIMESTEP,
    protocol_of,
    radius_of,
    ramp_to,
)
from iswarm_mj.gripper.bench.trial import Trial
from iswarm_mj.gripper.laws.detachment import WORK_OBJECT_SUBSTRATE, WORK_TOOL_OBJECT
from iswarm_mj.gripper.mjx_forces import (
    Force,
    GripperForces,
    State,
    first_state,
    gripper_force,
    gripper_forces,
)
from iswarm_mj.gripper.mjx_model import mjx_compatible, resize
from iswarm_mj.gripper.tips.table import TipTable
from iswarm_mj.gripper.units import MS, NN, UM
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.scalar_backends import in_arrays

_laws = in_arrays(leap_laws, jnp)
_script = in_arrays(script, jnp)

_STEPS = round(PROTOCOL.watch_time / TIMESTEP)
"""Number of physics steps between two looks."""
_LIMIT = max(LIFT_TIME, RELEASE_LIMIT + PROTOCOL.flight_limit)
"""Longest time of a trial [s]."""
ITERATIONS, LINE_SEARCH = 2, 4
"""Limits of the contact solver.

More change no voltage, and single precision never meets MuJoCo's tolerance.
"""
_DISABLED = mujoco.mjtDisableBit.mjDSBL_SPRING | mujoco.mjtDisableBit.mjDSBL_DAMPER
"""Stages that have nothing to do without plugins; in C the plugins are among them."""

Ready: TypeAlias = tuple[GripperForces, mjx.Model]
"""Forces and model with the ball of an attempt."""


class MjxBench(NamedTuple):
    """A bench for programs of JAX, with a ball of 20 um."""

    where: Layout
    """Addresses of the bench's numbers."""
    probe_radius: float
    """Radius of the tool [m]."""
    protocol: Protocol
    """Protocol of the trials."""
    forces: GripperForces
    """Forces of the plugins."""
    model: mjx.Model
    """Model without plugins."""
    data: mjx.Data
    """Data at rest, without a voltage."""


def mjx_bench(
    timestep: float, tip: TipTable | None = None, protocol: Protocol = PROTOCOL
) -> MjxBench:
    """Return a bench; numbers are single precision.

    Args:
        timestep: time step [s].
        tip: table of the tool's tip; None for a flat one.
        protocol: of the trials, see `protocol_of`.
    """
    trial = Trial(20e-6, WORK_TOOL_OBJECT, WORK_OBJECT_SUBSTRATE)
    spec = bench_spec()
    if tip is not None:
        put_tip(spec, tip)
    spec.option.iterations = ITERATIONS
    spec.option.ls_iterations = LINE_SEARCH
    spec.option.disableflags |= int(_DISABLED)
    spec.option.timestep = timestep / MS
    for pair in spec.pairs:
        pair.friction[3:] = trial.contacts.rolling / UM

    model = spec.compile()
    portable = mjx_compatible(spec)
    return MjxBench(
        where=layout(model),
        probe_radius=radius_of(tip),
        protocol=protocol,
        forces=gripper_forces(model).having(single(plugin_numbers(trial))),
        model=put_model(portable, "jax"),
        data=mjx.make_data(portable, impl="jax"),
    )


def single(values: Any) -> Any:
    """Return these numbers as arrays in single precision; truth values stay."""

    def as_array(value: Any) -> Array:
        return jnp.asarray(value, None if isinstance(value, bool) else jnp.float32)

    return jax.tree.map(as_array, values)


def watched(
    where: Layout,
    bench: Ready,
    data: mjx.Data,
    ball: State,
    control: Callable[[Array], Array],
    n_steps: int | Array,
) -> tuple[mjx.Data, Force, Watch]:
    """Take physics steps of one bench and watch its ball.

    Args:
        where: addresses of the bench's numbers.
        bench: forces and model.
        data: before.
        ball: state of the ball before.
        control: returns the `ctrl` (nu,) of a step by its number, from 0.
        n_steps: number of steps.

    Returns:
        Data after the steps, forces of the last step, and the events.
    """
    forces, model = bench
    timestep = model.opt.timestep * MS
    tool, plate = forces.tool_and_plate

    def step(k: Array, carry: tuple[mjx.Data, Force, Watch]) -> tuple[mjx.Data, Force, Watch]:
        data, force, watch = carry
        data, force = mjx_forces.step(forces, model, data.replace(ctrl=control(k)), force.state)
        gap_tool = force.gaps[tool] * UM
        gap_plate = force.gaps[plate] * UM
        lands = (gap_plate <= 0) & jnp.isinf(watch.first_plate)
        landing_speed = force.landing_speed[plate] * (UM / MS)
        watch = watch._replace(
            last_tool=jnp.where(gap_tool <= 0, k * timestep, watch.last_tool),
            last_plate=jnp.where(gap_plate <= 0, k * timestep, watch.last_plate),
            first_plate=jnp.where(lands, k * timestep, watch.first_plate),
            landing_speed=jnp.where(lands, landing_speed, watch.landing_speed),
            gap_tool=gap_tool,
            gap_plate=gap_plate,
        )
        return data, force, watch

    # The loop carries the forces of the last step, of which only the state matters at first.
    shapes = jax.eval_shape(partial(gripper_force, forces), model, data, ball)
    force = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), shapes)._replace(state=ball)
    no_event = Watch(
        last_tool=-jnp.inf,
        last_plate=-jnp.inf,
        first_plate=jnp.inf,
        landing_speed=0.0,
        gap_tool=jnp.nan,
        gap_plate=jnp.nan,
        speed=0.0,
        finite=True,
    )
    data, force, watch = jax.lax.fori_loop(0, n_steps, step, (data, force, single(no_event)))

    speed = jnp.linalg.norm(data.qvel[where.ball : where.ball + 3]) * (UM / MS)
    is_finite = jnp.isfinite(data.qpos).all() & jnp.isfinite(data.qvel).all()
    return data, force, watch._replace(speed=speed, finite=is_finite)


class Slot(NamedTuple):
    """One trial in progress."""

    data: mjx.Data
    """Data of its bench."""
    ball: State
    """State of its ball."""
    progress: Progress
    """Progress of the trial at the last look."""
    time: Array
    """Time since it began [s]."""


def by_batch(gripper: StaticGripper, attempts: Attempts) -> Outcomes:
    """Return the outcomes of trials in MJX, `gripper.bench_capacity` at once.

    Attempts beyond that are postponed. The script and the laws are those of `swarm_trials`, in
    single precision. A step of the swarm without attempts takes no physics step.
    """
    n_balls = attempts.lifts.shape[0]
    is_tried = attempts.lifts | attempts.releases

    # The first attempts get the slots; a slot without one has an index beyond the balls.
    n_slots = min(gripper.bench_capacity, n_balls)
    (ball,) = jnp.nonzero(jnp.asarray(is_tried), size=n_slots, fill_value=n_balls)
    is_real = ball < n_balls
    some_ball = jnp.minimum(ball, n_balls - 1)
    attempts_of_slots = jax.tree.map(lambda a: a[some_ball], attempts)
    with jax.default_matmul_precision("highest"):
        slots = _run(gripper, attempts_of_slots, is_real)
    succeeded = slots.progress.succeeds & ~slots.progress.is_faulty & is_real

    def of_balls(values: Array, kind: Any) -> Array:
        return jnp.zeros(n_balls, kind).at[ball].set(values, mode="drop")

    has_slot = of_balls(is_real, bool)
    return Outcomes(
        lifted=of_balls(succeeded & attempts_of_slots.lifts, bool),
        released=of_balls(succeeded & attempts_of_slots.releases, bool),
        postponed=is_tried & ~has_slot,
        duration=of_balls(jnp.where(is_real, slots.time, 0.0), jnp.float32),
        impact=of_balls(jnp.where(is_real, slots.progress.speed, 0.0), jnp.float32),
    )


def _run(gripper: StaticGripper, attempts: Attempts, is_real: Array) -> Slot:
    """Carry M trials to their ends; those that are not real are over at once."""
    gap = gripper.release_gap
    with jax.ensure_compile_time_eval():
        bench = mjx_bench(TIMESTEP, tip_of(gripper), protocol_of(gripper))
    n_looks = round(_LIMIT / PROTOCOL.watch_time)
    begin = jax.vmap(partial(_begin, bench, gap))
    advance = jax.vmap(partial(_advance, bench, gap))

    def is_running(carry: tuple[Slot, Int[Array, ""]]) -> Array:
        slots, look = carry
        return ~slots.progress.is_over.all() & (look < n_looks)

    def next_look(carry: tuple[Slot, Int[Array, ""]]) -> tuple[Slot, Int[Array, ""]]:
        slots, look = carry
        return advance(attempts, slots), look + 1

    slots = begin(attempts)
    slots = slots._replace(progress=slots.progress._replace(is_over=~is_real))
    slots, _ = jax.lax.while_loop(is_running, next_look, (slots, jnp.int32(0)))
    return slots


def _begin(bench: MjxBench, gap: float, attempt: Attempts) -> Slot:
    """Place ball and tool of a trial, see `swarm_trials`."""
    where = bench.where
    radius = attempt.radius / UM

    # A tool above the ball has pressed it on the plate; a ball to be released hangs at the tool.
    is_pressed = attempt.lifts & (attempt.misalignment < bench.probe_radius)
    apart = jnp.array(script.first_gaps(PROTOCOL.start_gap))
    hanging = jnp.array(script.first_gaps(PROTOCOL.start_gap, gap))
    lying = jnp.where(is_pressed, PRESSED_GAP, apart)
    tool_gap, plate_gap = jnp.where(attempt.releases, hanging, lying) / UM

    slide = 2 * radius + tool_gap + plate_gap - where.tip_height
    qpos = bench.data.qpos.at[where.ball + 2].set(radius + plate_gap)
    qpos = qpos.at[where.slide].set(slide)
    qpos = qpos.at[where.aside].set(attempt.misalignment / UM)
    ctrl = jnp.zeros_like(bench.data.ctrl).at[where.tip].set(qpos[where.slide])
    ctrl = ctrl.at[where.aside_servo].set(qpos[where.aside])

    return Slot(
        data=bench.data.replace(qpos=qpos, ctrl=ctrl),
        ball=single(first_state(bench.forces)),
        progress=single(START),
        time=jnp.where(is_pressed, PRESSED, jnp.float32(0.0)),
    )


def _advance(bench: MjxBench, gap: float, attempt: Attempts, slot: Slot) -> Slot:
    """Carry a trial to the next look; a trial that is over keeps its outcome."""
    ready = _ready(bench, attempt)
    ramp = ramp_to(attempt.voltage)
    control = partial(_control, bench, gap, attempt, ramp, slot)
    data, force, watch = watched(bench.where, ready, slot.data, slot.ball, control, _STEPS)
    time = slot.time + _STEPS * TIMESTEP

    # A lift ends after its moves, a release when the ball has come to rest.
    lift = slot.progress._replace(
        succeeds=script.hangs(watch.gap_tool, watch.gap_plate, bench.protocol),
        is_over=time >= LIFT_TIME - TIMESTEP / 2,
    )
    release = _script.released(
        bench.protocol,
        ramp,
        low=gap / 2,
        was=slot.progress,
        watch=watch,
        last_look=slot.time,
        time=time,
    )
    progress = jax.tree.map(partial(jnp.where, attempt.releases), release, lift)

    hanging, flying = _script.leap_limits(bench.protocol, ramp, progress, time)
    limits = (
        jnp.where(attempt.releases, hanging / MS, 0.0),
        jnp.where(attempt.releases, flying / MS, 0.0),
    )
    data, ball, leap_time = _leap(bench, ready, data, force, limits)

    keep_if_over = partial(jnp.where, slot.progress.is_over)
    return Slot(
        data=data,
        ball=ball,
        progress=jax.tree.map(keep_if_over, slot.progress, progress),
        time=keep_if_over(slot.time, time + leap_time),
    )


def _control(
    bench: MjxBench, gap: float, attempt: Attempts, ramp: Ramp, slot: Slot, k: Array
) -> Array:
    """Return the controls of a trial's bench in a physics step.

    Args:
        bench: of the trial.
        gap: between ball and plate in releases [m].
        attempt: the attempt.
        ramp: ramp of the voltage in releases.
        slot: trial at the last look.
        k: number of the step since then, from 0.
    """
    where = bench.where
    time = slot.time + (k + 1) * TIMESTEP

    gap_of_lift, share = _script.setpoint(LIFT, PROTOCOL.start_gap, time)
    voltage_of_lift = attempt.voltage * share
    voltage_of_release = _script.ramp_voltage(bench.protocol, ramp, slot.progress.freed, time)

    # The tip's height above the plate, with the ball between them.
    height = jnp.where(attempt.releases, gap, gap_of_lift) + 2 * attempt.radius
    voltage = jnp.where(attempt.releases, voltage_of_release, voltage_of_lift)
    ctrl = slot.data.ctrl.at[where.tip].set(height / UM - where.tip_height)
    return ctrl.at[where.voltage].set(voltage)


def _leap(
    bench: MjxBench, ready: Ready, data: mjx.Data, force: Force, limits: tuple[Array, Array]
) -> tuple[mjx.Data, State, Array]:
    """Leap over a time after a step, see `SingleBench.leap`.

    Returns:
        Data, state of the ball, and the time that passed [s].
    """
    forces, model = ready
    ball = bench.where.ball
    velocity = data.qvel[ball : ball + 3]
    leap = _laws.leap(
        ball=_hanging_ball(bench, ready, data, force),
        gaps=_gaps(bench, ready, data),
        velocity=tuple(velocity),
        gravity=-model.opt.gravity[2],
        limits=limits,
        period=PROTOCOL.watch_time / MS,
    )

    path = (leap.flown * velocity).at[2].set(leap.lift)
    speeds = jnp.where(leap.hung > 0, 0.0, data.qvel).at[ball + 2].set(leap.rise)
    data = data.replace(qpos=data.qpos.at[ball : ball + 3].add(path), qvel=speeds)

    # The gaps must not take the leap for an impact.
    time = leap.hung + leap.flown
    has_leapt = time > 0
    tool_gap, plate_gap = _gaps(bench, ready, data)
    gaps = [tool_gap if pair.surface == forces.probe else plate_gap for pair in forces.pairs]
    state = force.state._replace(
        charge=leap.charge,
        before=jnp.where(has_leapt, jnp.stack(gaps), force.state.before),
        rebound=jnp.where(has_leapt, 0.0, force.state.rebound),
    )
    return data, state, time * MS


def _hanging_ball(bench: MjxBench, ready: Ready, data: mjx.Data, force: Force) -> Hanging:
    """Return what leaps need to know of the ball."""
    forces, model = ready
    tool, plate = (force.adhesion[pair] for pair in forces.tool_and_plate)
    to_probe, to_plate = force.capacitances
    up, down = force.pulls
    gravity = -model.opt.gravity[2]
    mass = model.body_mass[forces.bodies[forces.ball]]
    return Hanging(
        voltage=data.ctrl[bench.where.voltage],
        ball_voltage=force.ball_voltage,
        charge=force.state.charge,
        to_probe=to_probe,
        to_plate=to_plate,
        leak=forces.numbers[forces.circuit, "leak"],
        up=up,
        down=down,
        adhesion=tool,
        hold=tool - plate - gravity * mass,
    )


def _gaps(bench: MjxBench, ready: Ready, data: mjx.Data) -> tuple[Array, Array]:
    """Return the gaps of the ball to the tool's face above it and to the plate [um]."""
    where = bench.where
    forces, model = ready
    radius = model.geom_size[forces.ball, 0]
    height = data.qpos[where.ball + 2]
    face = data.qpos[where.slide] + where.tip_height
    return face - height - radius, height - radius


def _ready(bench: MjxBench, attempt: Attempts) -> Ready:
    """Return forces and model with an attempt's ball; its works are those at the air's humidity."""
    forces = bench.forces.having(
        {
            ("adhesion_probe", "work"): attempt.work_tool_object * (UM / NN),
            ("adhesion_plate", "work"): attempt.work_object_substrate * (UM / NN),
        }
    )
    return forces, resize(forces, bench.model, attempt.radius / UM)
