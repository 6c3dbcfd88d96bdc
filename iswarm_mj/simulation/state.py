"""What a run consists of: the state of a world, its parameters, and the record of a control step.

All are pytrees of arrays of one world, or of B worlds with a leading axis.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from iswarm_mj.sensors.arena import Arena
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.sensors.links import Links
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.base import Task
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.errors import FaultKind, SimulationFault

MAX_LISTED = 5
"""Worlds that a message lists at most."""

_OF_ROBOTS = FaultKind.POSE_NOT_FINITE | FaultKind.OUTSIDE | FaultKind.COMMAND_NOT_FINITE


class WorldParams(NamedTuple):
    """What stays the same in a world during a run."""

    strategy: Strategy
    conditions: Conditions
    key: UInt32[Array, "*B 2"]
    """Data of the random key of the world's noise and of its robots' chances."""
    is_present: Bool[Array, "*B N"]
    """The other places are empty."""
    goal: Int[Array, "*B"]
    """The world is finished with this progress of the task, in cleaning balls delivered."""
    task: Task
    arena: Arena
    is_driven: Bool[Array, "*B M"]
    """Boxes of mass 0, which the task alone moves."""


class SwarmState(NamedTuple):
    """Everything about a world that is not rigid-body physics."""

    memory: Any
    """What the robots remember, the strategy's own."""
    task: Any
    """State of the task, its own."""
    is_alive: Bool[Array, "*B N"]
    """The others neither sense, nor send, nor move: they only stand in the way."""
    is_loaded: Bool[Array, "*B N"]
    """The robot carries something."""
    energy: Float[Array, "*B N"] | None = None
    """In the robots' capacitors [J]; None where they have none."""
    steps_without_energy: Int[Array, "*B N"] | None = None
    """Control steps in which each robot waited for energy; None where they have no capacitors."""
    led_power: Float[Array, "*B N"] | None = None
    """With which each robot sends its next message, from 0 to 1; None where all send at full power."""


class Fault(NamedTuple):
    """The first thing that went wrong in a world; it stays."""

    bits: Int[Array, "*B"]
    """Of `FaultKind`, 0 for nothing."""
    step: Int[Array, "*B"]
    """Control step, counted from 1."""
    robot: Int[Array, "*B"]
    """First robot concerned; no meaning for faults of the contact buffers or the solver."""


def decode(fault: Fault, worlds: Sequence[int]) -> list[SimulationFault | None]:
    """Return the fault of each of B worlds, None for a world without one.

    Args:
        fault: NumPy arrays (B,).
        worlds: their numbers.
    """
    found: list[SimulationFault | None] = [None] * len(worlds)
    for row in np.flatnonzero(fault.bits).tolist():
        kind = FaultKind(int(fault.bits[row]))
        robots = [int(fault.robot[row])] if kind & _OF_ROBOTS else []
        found[row] = SimulationFault(step=int(fault.step[row]), world=worlds[row], robots=robots, kind=kind)
    return found


def summary(faults: Sequence[SimulationFault]) -> str:
    """One sentence that lists the faults."""
    listed = [str(fault) for fault in faults[:MAX_LISTED]]
    more = len(faults) - MAX_LISTED
    return "; ".join(listed) + (f"; and {more} more worlds" if more > 0 else "")


class WorldState(NamedTuple):
    """Everything that changes in a world."""

    bodies: Any
    """Mechanical state, the engine's own."""
    swarm: SwarmState
    touching: Int[Array, "*B K N"]
    """Who touched whom in the last control step, see `Motion.touching`; no meaning in a world with a fault."""
    collisions: Int[Array, "*B"]
    """Counted so far."""
    is_finished: Bool[Array, "*B"]
    """The goal is reached."""
    finished_at: Int[Array, "*B"]
    """After this control step; 0 if not finished."""
    progress: Int[Array, "*B"]
    """Of the task (`tasks.base.Task.progress`), counted in each control step; 0 at the start."""
    fault: Fault


class StepRecord(NamedTuple):
    """What an observer sees of a control step; step 0 is the start."""

    step: Int[Array, "*T"]
    """Control steps taken."""
    poses: Float[Array, "*T N 3"]
    """x, y [mm] and yaw [rad] after the step."""
    swarm: SwarmState
    links: Links
    """By which the robots heard each other in this step; none at the start."""
    has_priority: Bool[Array, "*T N"]
    """The robot sent the flag `priority` as the step began; nobody does where messages have none."""
    message: UInt32[Array, "*T N"]
    """The 32 bits (`sensors.messages`) that the robot's first LED sent as the step began; no meaning at the start,
    where the world did not take this step, and for dead robots."""
    is_heard: Bool[Array, "*T N S"]
    """The message of a link arrived, and its check is right, if that is looked at."""
    measured_distance: Float[Array, "*T N S"]
    """Of the sender, as the receiver measured it [mm]; no meaning where the link is not valid."""
    command: Command
    """What the drive carried out: the strategy's command with the actuators' errors, within the limits; zero at the
    start, where the world did not take this step, and for dead robots."""
    collisions: Int[Array, "*T"]
    """Counted so far."""
    speed: Float[Array, "*T"]
    """Mean distance that the robots moved in this step, per second [mm/s]."""
    is_running: Bool[Array, "*T"]
    """The world took this step; false once it is finished or faulty."""
    boxes: Float[Array, "*T M 3"] | None = None
    """x, y [mm] and yaw [rad] of the boxes after the step; None where there are none."""
