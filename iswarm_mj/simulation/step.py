"""One control step of the swarm, written once for all engines: sense, decide, move, account."""

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any, NamedTuple

from jaxtyping import Bool, Float, Int

from iswarm_mj.config.static import StaticConfig
from iswarm_mj.engines.base import Engine, Motion, boxes_of
from iswarm_mj.simulation.actuate import DriveOutput, drive_phases, velocity_towards
from iswarm_mj.simulation.decide import Decision
from iswarm_mj.simulation.perceive import StepInputs
from iswarm_mj.simulation.power import emitted_light
from iswarm_mj.simulation.state import Fault, StepRecord, SwarmState, WorldParams, WorldState
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.errors import FaultKind

Decide = Callable[[SwarmState, StepInputs], Decision]
"""`decide.decide` with configuration, robots and parameters of the world.

It is mapped over worlds where the engine acts on many at once."""


class Stepper(NamedTuple):
    """Parts that take control steps of one world, or of B with a leading axis of all arrays."""

    engine: Engine
    """Senses and moves."""
    config: StaticConfig
    """Settings that control steps are compiled for."""
    decide: Decide
    """Decides what the robots do."""
    records: bool
    """Return a record of each step."""
    watch: Callable[[str], Any] = nullcontext
    """Times a stage, by its name; only on the host."""


def control_step(
    stepper: Stepper,
    params: WorldParams,
    state: WorldState,
    step: Int[Array, ""],
    last: Int[Array, ""],
) -> tuple[WorldState, StepRecord | None]:
    """Take one control step, unless the world is finished or faulty or the run is over.

    Args:
        stepper: engine, configuration and decisions.
        params: parameters of the world.
        state: state before the step.
        step: number of this step, from 0.
        last: number of steps of the run.

    Returns:
        State after the step, and the record of the step; None if the stepper makes none.
    """
    engine = stepper.engine
    drive_config = stepper.config.drive
    is_running = ~state.is_finished & (state.fault.bits == 0) & (step < last)

    # Sense: the nearest sender in sight of each side, and walls that reflect the robot's own light.
    light = emitted_light(stepper.config, state.swarm)
    with stepper.watch("sense"):
        sight = engine.sense(state.bodies, light, is_running)
    inputs = StepInputs(
        poses=engine.poses(state.bodies),
        sight=sight,
        step=step,
        is_running=is_running,
        boxes=boxes_of(engine, state.bodies),
    )

    # Decide: robots communicate, the task advances, and the strategy acts.
    with stepper.watch("policy"):
        decision = stepper.decide(state.swarm, inputs)

    # Move: turn on the spot, then walk. A refused command is a fault, and stops the whole world.
    moves = is_running & ~decision.drive.is_refused.any(axis=-1)
    box_velocity = velocity_towards(
        drive_config, params.is_driven, decision.box_targets, inputs.boxes
    )
    phases = drive_phases(drive_config, decision.drive.command, box_velocity)
    with stepper.watch("physics"):
        motion = engine.move(state.bodies, phases, moves)

    # Account: faults and collisions of the motion, then the progress of the task.
    moved = account_for_motion(state, motion, decision.drive, step, is_running)
    moved = moved._replace(swarm=decision.swarm)
    after = account_for_task(params, moved, decision.progress, step, is_running)

    if not stepper.records:
        return after, None
    return after, record_step(stepper, params, after, decision, inputs)


def account_for_motion(
    state: WorldState,
    motion: Motion,
    drive: DriveOutput,
    step: Int[Array, ""],
    is_running: Bool[Array, "*B"],
) -> WorldState:
    """Return the state with the bodies, faults and collisions of a control step's motion.

    The motion needs no mask. For a world that does not run, engines return the bodies as they were
    and no fault (`engines.base.finish_motion`). Its partners are read only if it runs later, which
    no world does that has stopped; environments clear those of an episode that begins.

    Args:
        state: state before the step.
        motion: motion of the robots.
        drive: motion that the drives carried out, and commands that they refused.
        step: number of the step, from 0.
        is_running: worlds that take it.
    """
    xp = array_module(motion.touching)

    # Bits are added, step and robot replaced: new bits come only from worlds that took this step,
    # and worlds stop at their first fault. Faults count steps from 1, as tables do. Types stay
    # those of the state, as `lax.scan` demands.
    any_refused = drive.is_refused.any(axis=-1) & is_running
    refusal = xp.where(any_refused, int(FaultKind.COMMAND_NOT_FINITE), 0)
    new_bits = motion.fault | refusal.astype(motion.fault.dtype)
    first_refused = drive.is_refused.argmax(axis=-1)
    robot = xp.where(any_refused, first_refused, motion.robot).astype(state.fault.robot.dtype)
    is_faulty = new_bits != 0
    fault = Fault(
        bits=state.fault.bits | new_bits,
        step=xp.where(is_faulty, step + 1, state.fault.step).astype(state.fault.step.dtype),
        robot=xp.where(is_faulty, robot, state.fault.robot),
    )

    # A collision is a pair that begins to touch or, where robots keep to cells, each step in which
    # a robot finds the cell before it taken: nobody touches there, so that no contact begins.
    collisions = new_contacts(state.touching, motion.touching) + drive.is_blocked.sum(axis=-1)
    collisions = collisions.astype(state.collisions.dtype)
    is_counted = is_running & (fault.bits == 0)
    return state._replace(
        bodies=motion.bodies,
        touching=motion.touching,
        collisions=state.collisions + xp.where(is_counted, collisions, 0),
        fault=fault,
    )


def new_contacts(before: Int[Array, "*B K N"], after: Int[Array, "*B K N"]) -> Int[Array, "*B"]:
    """Return the number of pairs that touch after a step and did not before (`Motion.touching`)."""
    # Rows of K partners after the step against rows of K partners before; 0 stands for nobody,
    # since partners have higher numbers than the robot itself.
    is_old = (after[..., None, :, :] == before[..., :, None, :]).any(axis=-3)
    is_new = (after > 0) & ~is_old
    return is_new.sum(axis=(-2, -1))


def account_for_task(
    params: WorldParams,
    state: WorldState,
    progress: Int[Array, "*B"],
    step: Int[Array, ""],
    is_running: Bool[Array, "*B"],
) -> WorldState:
    """Return the state with the progress of the task in a control step, which may finish the world.

    Args:
        params: parameters of the world, with its goal.
        state: state after the motion.
        progress: progress of the task.
        step: number of the step, from 0.
        is_running: worlds that take it.
    """
    xp = array_module(is_running)
    # `progress` needs no mask: `decide` keeps the task's state of worlds that do not run.
    reached = is_running & (state.fault.bits == 0) & (progress >= params.goal)
    finished_at = xp.where(reached, step + 1, state.finished_at).astype(state.finished_at.dtype)
    return state._replace(
        is_finished=state.is_finished | reached, finished_at=finished_at, progress=progress
    )


def record_step(
    stepper: Stepper,
    params: WorldParams,
    state: WorldState,
    decision: Decision,
    inputs: StepInputs,
) -> StepRecord:
    """Return the record of a control step; a world that does not run has no links.

    Args:
        stepper: engine and configuration.
        params: parameters of the world.
        state: state after the step.
        decision: decisions of the robots.
        inputs: bodies, light and time as the step began.
    """
    is_running = inputs.is_running
    xp = array_module(is_running)
    links = inputs.sight.links if decision.links is None else decision.links
    received = decision.received
    poses = stepper.engine.poses(state.bodies)
    period = stepper.config.drive.control_period
    command = decision.drive.command

    robots_run = is_running[..., None]
    sides_run = is_running[..., None, None]
    return StepRecord(
        step=xp.broadcast_to(inputs.step + 1, is_running.shape),
        poses=poses,
        swarm=decision.swarm,
        links=links._replace(valid=links.valid & sides_run),
        has_priority=decision.has_priority,
        message=received.bits[..., 0],
        is_heard=received.is_heard & sides_run,
        measured_distance=received.distance,
        command=Command(
            turn=xp.where(robots_run, command.turn, 0.0),
            forward=xp.where(robots_run, command.forward, 0.0),
        ),
        collisions=state.collisions,
        speed=mean_distance(inputs.poses, poses, params.is_present) / period,
        is_running=is_running,
        boxes=boxes_of(stepper.engine, state.bodies),
    )


def mean_distance(
    before: Float[Array, "*B N 3"], after: Float[Array, "*B N 3"], is_present: Bool[Array, "*B N"]
) -> Float[Array, "*B"]:
    """Return the mean distance that the robots of a world moved between two poses [mm]."""
    xp = array_module(after)
    distance = xp.sqrt(((after - before)[..., :2] ** 2).sum(axis=-1))
    return xp.where(is_present, distance, 0).sum(axis=-1) / is_present.sum(axis=-1)
