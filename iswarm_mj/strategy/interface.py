"""What robots sense and do in a control step. S = 4 is the number of their sides."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from jaxtyping import Bool, Float, Int

from iswarm_mj.utils.arrays import Array


class Observation(NamedTuple):
    """All that N robots sense in one control step."""

    is_heard: Bool[Array, "N S"]
    """A valid message arrived on this side; elsewhere its content is undefined."""
    bearing: Float[Array, "N S"]
    """Measured direction of its sender, in the robot's frame [rad]."""
    distance: Float[Array, "N S"]
    """Measured distance of its sender [mm]."""
    led: Int[Array, "N S"]
    """Number of the LED that sent it, int32."""
    payload: dict[str, Any]
    """(N, S) fields of the message by name (`sensors.messages.Payload`); vectors are in the sender's frame."""
    sees_wall: Bool[Array, "N S"]
    """A wall reflects the light of this side's LED."""
    at_dust: Bool[Array, "N"]
    """A ball lies beside or beneath the robot."""
    ball_vector: Float[Array, "N 2"]
    """From the robot to that ball, in the robot's frame [mm]."""
    on_dump: Bool[Array, "N"]
    """The robot is on the dump."""
    is_loaded: Bool[Array, "N"]
    """The robot holds a ball."""
    grasp_failed: Bool[Array, "N"]
    """The robot's attempt to pick up a ball failed in this step."""
    sensed: Mapping[str, Array]
    """(N, ...) what the task lets robots sense, by the names in `tasks.base.Task.senses`."""
    waits: Bool[Array, "N"]
    """The robot does not move in this step: it works at a ball, has no energy, or stops to emit."""


class Command(NamedTuple):
    """What N robots do in one control step: turn, then move."""

    turn: Float[Array, "N"]
    """Turn, anticlockwise [rad]."""
    forward: Float[Array, "N"]
    """Distance to move after the turn, negative backwards [mm]."""
