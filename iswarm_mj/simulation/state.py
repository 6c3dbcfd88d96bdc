"""State of a world, its parameters, and the record of a control step.

All are pytrees of arrays of one world, or of B worlds with a leading axis.
"""

from typing import Any, NamedTuple

from jaxtyping import Bool, Float, Int, UInt32

from iswarm_mj.sensors.arena import Arena
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.sensors.links import Links
from iswarm_mj.strategy.base import Strategy
from iswarm_mj.strategy.interface import Command
from iswarm_mj.tasks.base import Task
from iswarm_mj.utils.arrays import Array


class WorldParams(NamedTuple):
    """Parameters of a world, which stay the same during a run."""

    strategy: Strategy
    """Strategy of the robots."""
    conditions: Conditions
    """Noise, voltages and places."""
    key: UInt32[Array, "*B 2"]
    """Data of the random key of the world's noise and of its robots' chances."""
    is_present: Bool[Array, "*B N"]
    """Places that hold a robot; the others are empty."""
    goal: Int[Array, "*B"]
    """Progress of the task that finishes the world, in cleaning balls delivered."""
    task: Task
    """Task of the robots."""
    arena: Arena
    """Size, dust and balls of the arena."""
    is_driven: Bool[Array, "*B M"]
    """Boxes of mass 0, which the task alone moves."""
    fails_at: Int[Array, "*B N"] | None = None
    """Control steps that each robot takes before it fails (`Failures`); None where none does."""


class SwarmState(NamedTuple):
    """State of a world but for its rigid bodies.

    Between control steps on the host, `memory` and `task` are `Packed` (`simulation.packed`).
    """

    memory: Any
    """Memory of the robots, in the strategy's own structure."""
    task: Any
    """State of the task, in its own structure."""
    is_alive: Bool[Array, "*B N"]
    """Robots that live; dead ones neither sense, send nor move: they stay as obstacles."""
    is_loaded: Bool[Array, "*B N"]
    """Robots that carry something."""
    energy: Float[Array, "*B N"] | None = None
    """Energy in the robots' capacitors [J]; None where they have none."""
    steps_without_energy: Int[Array, "*B N"] | None = None
    """Control steps in which each robot waited for energy; None where they have no capacitors."""
    led_power: Float[Array, "*B N"] | None = None
    """Power of each robot's next message, from 0 to 1; None where all send at full power."""


class Fault(NamedTuple):
    """First fault of a world; the world stops at it."""

    bits: Int[Array, "*B"]
    """Bits of `FaultKind`, 0 for no fault."""
    step: Int[Array, "*B"]
    """Control step of the fault, counted from 1."""
    robot: Int[Array, "*B"]
    """First robot concerned; undefined for faults of the contact buffers or the solver."""


class WorldState(NamedTuple):
    """State of a world."""

    bodies: Any
    """Mechanical state, in the engine's own structure."""
    swarm: SwarmState
    """State but for the rigid bodies."""
    touching: Int[Array, "*B K N"]
    """Pairs in contact in the last step, see `Motion.touching`; undefined after a fault."""
    collisions: Int[Array, "*B"]
    """Number of collisions so far."""
    is_finished: Bool[Array, "*B"]
    """Worlds that have reached their goal."""
    finished_at: Int[Array, "*B"]
    """Control step after which the goal was reached; 0 where it was not."""
    progress: Int[Array, "*B"]
    """Progress of the task (`Task.progress`) after the last control step; 0 at the start."""
    fault: Fault
    """First fault of the world."""


class StepRecord(NamedTuple):
    """Record of a control step as an observer sees it; step 0 is the start."""

    step: Int[Array, "*T"]
    """Number of control steps taken."""
    poses: Float[Array, "*T N 3"]
    """x, y [mm] and yaw [rad] after the step."""
    swarm: SwarmState
    """State after the step but for the rigid bodies."""
    links: Links
    """Links over which the robots heard each other in this step; none at the start."""
    has_priority: Bool[Array, "*T N"]
    """Robots that sent the flag `priority` as the step began; none without such a flag."""
    message: UInt32[Array, "*T N"]
    """The 32 bits (`sensors.messages`) that the robot's first LED sent as the step began.

    Undefined at the start, where the world did not take this step, and for dead robots."""
    is_heard: Bool[Array, "*T N S"]
    """Sides at which the message of a link arrived with a right check, if checks are looked at."""
    measured_distance: Float[Array, "*T N S"]
    """Distance of the sender as measured [mm]; undefined where the link is not valid."""
    command: Command
    """Motion that the drive carried out: the command with the actuators' errors, within the limits.

    Zero at the start, where the world did not take this step, and for dead robots."""
    collisions: Int[Array, "*T"]
    """Number of collisions so far."""
    speed: Float[Array, "*T"]
    """Mean distance that the robots moved in this step, per second [mm/s]."""
    is_running: Bool[Array, "*T"]
    """Worlds that took this step, being neither finished nor faulty."""
    boxes: Float[Array, "*T M 3"] | None = None
    """x, y [mm] and yaw [rad] of the boxes after the step; None where there are none."""
