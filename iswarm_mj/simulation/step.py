"""One control step of the swarm, written once for all engines: sense, decide, move, account."""

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any, NamedTuple

from jaxtyping import Float, Int

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.engines.base import Engine, Motion, boxes_of
from iswarm_mj.simulation.actuate import DriveOutput, drive_phases, velocity_towards
from iswarm_mj.simulation.decide import Decision
from iswarm_mj.simulation.perceive import StepInputs
from iswarm_mj.simulation.power import is_emitting
from iswarm_mj.simulation.state import Fault, StepRecord, SwarmState, WorldParams, WorldState
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.errors import FaultKind

Decide = Callable[[SwarmState, StepInputs], Decision]
"""`decide.decide` with configuration, robots and parameters of the world; mapped over worlds where the
engine acts on many at once."""


class Stepper(NamedTuple):
    """What carries out control steps: of one world, or of B, and all arrays have a leading axis."""

    engine: Engine
    """Senses and moves."""
    config: StaticConfig
    """What control steps are compiled for."""
    decide: Decide
    """Decides what the robots do."""
    records: bool
    """Return a record of each step."""
    watch: Callable[[str], Any] = nullcontext
    """Times a stage, by its name; only on the host."""


def control_step(
    stepper: Stepper, params: WorldParams, state: WorldState, step: Int[Array, ""], last: Int[Array, ""]
) -> tuple[WorldState, StepRecord | None]:
    """Take one control step, unless the world is finished or faulty or the run over.

    Args:
        stepper: engine, configuration and decisions.
        params: of the world.
        state: before.
        step: number of this step, from 0.
        last: number of steps of the run.
    """
    engine, config, swarm = stepper.engine, stepper.config, state.swarm
    is_running = ~state.is_finished & (state.fault.bits == 0) & (step < last)
    emits = is_emitting(config, swarm.is_alive, swarm.energy)
    emits = emits if swarm.led_power is None else emits * swarm.led_power
    with stepper.watch("sense"):
        sight = engine.sense(state.bodies, emits, is_running)
    begin = StepInputs(engine.poses(state.bodies), sight, step, is_running, boxes_of(engine, state.bodies))
    with stepper.watch("policy"):
        decision = stepper.decide(swarm, begin)
    moves = is_running & ~decision.done.is_refused.any(axis=-1)
    boxes = velocity_towards(config.drive, params.is_driven, decision.boxes, begin.boxes)
    phases = drive_phases(config.drive, decision.done.command, boxes)
    with stepper.watch("physics"):
        motion = engine.move(state.bodies, phases, moves)
    moved = after_motion(state, motion, decision.done, step, is_running)
    new = after_task(params, moved._replace(swarm=decision.swarm), decision.progress, step, is_running)
    return new, record(stepper, params, new, decision, begin) if stepper.records else None


def after_motion(
    state: WorldState, motion: Motion, done: DriveOutput, step: Int[Array, ""], is_running: Array
) -> WorldState:
    """Account for the motion of a control step: bodies, faults, collisions.

    Args:
        state: before the step.
        motion: of the robots.
        done: by the drives.
        step: number of the step, from 0.
        is_running: (*B,) worlds that take it.
    """
    xp = array_module(motion.touching)
    any_refused = done.is_refused.any(axis=-1) & is_running
    bits = motion.fault | xp.where(any_refused, int(FaultKind.COMMAND_NOT_FINITE), 0).astype(motion.fault.dtype)
    robot = xp.where(any_refused, done.is_refused.argmax(axis=-1), motion.robot).astype(state.fault.robot.dtype)
    fault = Fault(
        state.fault.bits | bits,
        xp.where(bits != 0, step + 1, state.fault.step).astype(state.fault.step.dtype),
        xp.where(bits != 0, robot, state.fault.robot),
    )
    begun = new_contacts(state.touching, motion.touching) + done.is_blocked.sum(axis=-1)
    begun = begun.astype(state.collisions.dtype)
    collisions = state.collisions + xp.where(is_running & (fault.bits == 0), begun, 0)
    return state._replace(bodies=motion.bodies, touching=motion.touching, collisions=collisions, fault=fault)


def new_contacts(before: Int[Array, "*B K N"], now: Int[Array, "*B K N"]) -> Int[Array, "*B"]:
    """Return the number of pairs of robots that touch now and did not before, see `Motion.touching`."""
    is_known = (now[..., None, :, :] == before[..., :, None, :]).any(axis=-3)
    return ((now > 0) & ~is_known).sum(axis=(-2, -1))


def after_task(
    params: WorldParams, state: WorldState, progress: Int[Array, "*B"], step: Int[Array, ""], is_running: Array
) -> WorldState:
    """Account for the progress of the task in a control step, which may finish the world.

    Args:
        params: with the goal.
        state: after the motion.
        progress: of the task.
        step: number of the step, from 0.
        is_running: (*B,) worlds that take it.
    """
    xp = array_module(is_running)
    reached = is_running & (state.fault.bits == 0) & (progress >= params.goal)
    finished_at = xp.where(reached, step + 1, state.finished_at).astype(state.finished_at.dtype)
    return state._replace(is_finished=state.is_finished | reached, finished_at=finished_at, progress=progress)


def record(
    stepper: Stepper, params: WorldParams, state: WorldState, decision: Decision, begin: StepInputs
) -> StepRecord:
    """Record of a control step; a world that does not run has no links.

    Args:
        stepper: engine and configuration.
        params: of the world.
        state: after the step.
        decision: of the robots.
        begin: how the step began.
    """
    links, received, is_running = decision.links or begin.sight.links, decision.received, begin.is_running
    xp = array_module(is_running)
    poses = stepper.engine.poses(state.bodies)
    return StepRecord(
        step=xp.broadcast_to(begin.step + 1, is_running.shape),
        poses=poses,
        swarm=decision.swarm,
        links=links._replace(valid=links.valid & is_running[..., None, None]),
        has_priority=decision.has_priority,
        message=received.bits[..., 0],
        is_heard=received.is_heard & is_running[..., None, None],
        measured_distance=received.distance,
        command=Command(*(xp.where(is_running[..., None], part, 0.0) for part in decision.done.command)),
        collisions=state.collisions,
        speed=mean_step(begin.poses, poses, params.is_present) / stepper.config.drive.control_period,
        is_running=is_running,
        boxes=boxes_of(stepper.engine, state.bodies),
    )


def mean_step(before: Float[Array, "*B N 3"], after: Float[Array, "*B N 3"], is_present: Array) -> Float[Array, "*B"]:
    """Mean distance of the robots of a world between two poses [mm]."""
    xp = array_module(after)
    moved = xp.sqrt(((after - before)[..., :2] ** 2).sum(axis=-1))
    return xp.where(is_present, moved, 0).sum(axis=-1) / is_present.sum(axis=-1)
