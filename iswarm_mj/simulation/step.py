"""One control step of the swarm, written once for all engines: sense, decide, move, account."""

import math
from collections.abc import Callable
from typing import NamedTuple

from jaxtyping import Bool, Float, Int

from iswarm_mj.config import DriveConfig, SwarmConfig
from iswarm_mj.engines.base import Engine, Motion, Phase
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.simulation.decide import Decision, Situation
from iswarm_mj.simulation.power import talks
from iswarm_mj.simulation.state import Fault, StepRecord, SwarmState, WorldParams, WorldState
from iswarm_mj.strategy.interface import Command
from iswarm_mj.utils.arrays import Array, array_module
from iswarm_mj.utils.errors import FaultKind
from iswarm_mj.utils.robot import Robot
from iswarm_mj.utils.units import mm_from_rd

Decide = Callable[[WorldParams, SwarmState, Situation], Decision]
"""`decide.decide` with its configuration; mapped over worlds where the engine acts on many at once."""


class Stepper(NamedTuple):
    """What carries out control steps: of one world, or of B, and all arrays have a leading axis."""

    engine: Engine
    """Senses and moves."""
    config: SwarmConfig
    """Everything that is not evolved."""
    decide: Decide
    """What the robots decide."""
    records: bool
    """Return a record of each step."""


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
    engine, config = stepper.engine, stepper.config
    is_running = ~state.is_finished & (state.fault.bits == 0) & (step < last)
    sight = engine.sense(state.bodies, talks(config, state.swarm.is_alive, state.swarm.energy), is_running)
    situation = Situation(engine.poses(state.bodies), sight, step, is_running)
    decision = stepper.decide(params, state.swarm, situation)
    command, refused = limited(config, decision.command)
    motion = engine.move(state.bodies, drive_phases(config.drive, command), is_running & ~refused.any(axis=-1))
    new = account(params, state, decision, motion, refused, situation)
    done = decision._replace(command=command)
    return new, record(stepper, params, new, done, situation) if stepper.records else None


def limited(config: SwarmConfig, command: Command) -> tuple[Command, Bool[Array, "*B N"]]:
    """Commands within the limits of the drive, whatever the strategy asked for, and which were not finite.

    Args:
        config: longest step and largest turn.
        command: turns [rad] and distances [mm] (*B, N).
    """
    xp = array_module(command.turn)
    turn, step = math.radians(config.drive.max_turn), mm_from_rd(config.step_length)
    refused = ~(xp.isfinite(command.turn) & xp.isfinite(command.forward))
    return Command(xp.clip(command.turn, -turn, turn), xp.clip(command.forward, -step, step)), refused


def drive_phases(drive: DriveConfig, command: Command) -> tuple[Phase, Phase]:
    """Turn on the spot, then walk ahead, along the heading as it is then.

    A robot that a contact turns while it walks keeps its direction over the ground until the next control step.

    Args:
        drive: durations of the phases.
        command: turns [rad] and distances [mm] (*B, N).
    """
    xp = array_module(command.turn)

    def spin(poses: Array) -> Array:
        rate = command.turn / (drive.turn_substeps * drive.timestep)
        still = xp.zeros_like(rate)
        return xp.stack([still, still, rate], axis=-1)

    def walk(poses: Array) -> Array:
        speed, yaw = command.forward / (drive.walk_substeps * drive.timestep), poses[..., 2]
        return xp.stack([speed * xp.cos(yaw), speed * xp.sin(yaw), xp.zeros_like(yaw)], axis=-1)

    return Phase(drive.turn_substeps, spin), Phase(drive.walk_substeps, walk)


def account(
    params: WorldParams,
    state: WorldState,
    decision: Decision,
    motion: Motion,
    refused: Bool[Array, "*B N"],
    situation: Situation,
) -> WorldState:
    """State after a control step: collisions and progress of the task, the end of the world, its faults.

    Args:
        params: of the world.
        state: before the step.
        decision: of the robots, with what became of the task.
        motion: of the robots.
        refused: commands that were not finite.
        situation: as the step began.
    """
    xp = array_module(motion.touching)
    step, is_running = situation.step, situation.is_running
    is_refused = refused.any(axis=-1) & is_running
    bits = motion.fault | xp.where(is_refused, int(FaultKind.COMMAND_NOT_FINITE), 0).astype(motion.fault.dtype)
    robot = xp.where(is_refused, refused.argmax(axis=-1), motion.robot).astype(state.fault.robot.dtype)
    fault = Fault(
        state.fault.bits | bits,
        xp.where(bits != 0, step + 1, state.fault.step).astype(state.fault.step.dtype),
        xp.where(bits != 0, robot, state.fault.robot),
    )
    is_sound = is_running & (fault.bits == 0)
    begun = (motion.touching > state.touching).sum(axis=(-2, -1), dtype=state.collisions.dtype)
    reached = is_sound & (decision.progress >= params.goal)
    return WorldState(
        bodies=motion.bodies,
        swarm=decision.swarm,
        touching=motion.touching,
        collisions=state.collisions + xp.where(is_sound, begun, 0),
        is_finished=state.is_finished | reached,
        finished_at=xp.where(reached, step + 1, state.finished_at).astype(state.finished_at.dtype),
        progress=decision.progress,
        fault=fault,
    )


def record(
    stepper: Stepper, params: WorldParams, state: WorldState, decision: Decision, situation: Situation
) -> StepRecord:
    """Record of a control step; a world that does not run has no links.

    Args:
        stepper: engine and configuration.
        params: of the world.
        state: after the step.
        decision: of the robots, with the commands that the drive carried out.
        situation: as the step began.
    """
    links, spoken, is_running = decision.links, decision.spoken, situation.is_running
    xp = array_module(is_running)
    poses = stepper.engine.poses(state.bodies)
    return StepRecord(
        step=xp.broadcast_to(situation.step + 1, is_running.shape),
        poses=poses,
        swarm=decision.swarm,
        links=links._replace(valid=links.valid & is_running[..., None, None]),
        has_priority=decision.has_priority,
        message=spoken.message,
        is_heard=xp.asarray(spoken.is_heard) & is_running[..., None, None],
        measured_distance=spoken.measured_distance,
        command=Command(*(xp.where(is_running[..., None], part, 0.0) for part in decision.command)),
        balls=ball_centres(decision.swarm.balls, poses, stepper.engine.robot),
        collisions=state.collisions,
        speed=mean_step(situation.poses, poses, params.is_present) / stepper.config.drive.control_period,
        is_running=is_running,
    )


def mean_step(before: Float[Array, "*B N 3"], after: Float[Array, "*B N 3"], is_present: Array) -> Float[Array, "*B"]:
    """Mean distance of the robots of a world between two poses [mm]."""
    xp = array_module(after)
    moved = xp.sqrt(((after - before)[..., :2] ** 2).sum(axis=-1))
    return xp.where(is_present, moved, 0).sum(axis=-1) / is_present.sum(axis=-1)


def ball_centres(balls: Balls, poses: Float[Array, "*B N 3"], robot: Robot) -> Float[Array, "*B K 3"]:
    """Positions of the balls' centres after the robots moved to `poses` [mm]."""
    xp, probe = array_module(poses), robot.probe_tip
    radius, held, holder, position = (
        xp.asarray(a) for a in (balls.radius, balls.is_held, balls.holder, balls.position)
    )
    at = xp.take_along_axis(poses, holder[..., None], axis=-2)
    c, s = xp.cos(at[..., 2]), xp.sin(at[..., 2])
    tip = xp.stack([at[..., 0] + c * probe[0] - s * probe[1], at[..., 1] + s * probe[0] + c * probe[1]], axis=-1)
    xy = xp.where(held[..., None], tip, position)
    height = xp.where(held, robot.tip_height - 1e3 * radius, 1e3 * radius)
    return xp.concatenate([xy, height[..., None]], axis=-1)
