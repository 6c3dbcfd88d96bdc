"""Observations and commands of robots in a control step.

S is the number of a robot's sides, 4 for the paper's.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

from jaxtyping import Bool, Float, Int

from iswarm_mj.utils.arrays import Array


class Observation(NamedTuple):
    """Everything that N robots sense in one control step."""

    is_heard: Bool[Array, "N S"]
    """A valid message arrived on this side; elsewhere its content is undefined."""
    bearing: Float[Array, "N S"]
    """Measured direction of its sender, in the robot's frame [rad]."""
    distance: Float[Array, "N S"]
    """Measured distance of its sender [mm]."""
    led: Int[Array, "N S"]
    """Number of the LED that sent it, int32."""
    payload: dict[str, Any]
    """Fields (N, S) of the message by name (`sensors.messages.Payload`).

    Vectors are in the sender's frame."""
    sees_wall: Bool[Array, "N S"]
    """A wall reflects the light of this side's LED."""
    at_dust: Bool[Array, "N"]
    """A ball lies beside or beneath the robot."""
    ball_vector: Float[Array, "N 2"]
    """Vector from the robot to that ball, in the robot's frame [mm]."""
    on_dump: Bool[Array, "N"]
    """The robot is on the dump."""
    is_loaded: Bool[Array, "N"]
    """The robot holds a ball."""
    grasp_failed: Bool[Array, "N"]
    """The robot's attempt to pick up a ball failed in this step."""
    sensed: Mapping[str, Array]
    """Arrays (N, ...) of other quantities that the task lets robots sense (`Task.senses`)."""
    waits: Bool[Array, "N"]
    """The robot cannot move in this step: it grips, has no energy, or stops to emit."""


class Command(NamedTuple):
    """Motion of N robots in one control step: they turn, then move."""

    turn: Float[Array, "N"]
    """Anticlockwise turn [rad]."""
    forward: Float[Array, "N"]
    """Distance to move after the turn, negative backwards [mm]."""
