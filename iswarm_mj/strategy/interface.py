"""What robots sense and do in a control step. S = 4 is the number of their sides."""

from collections.abc import Mapping
from typing import Any, NamedTuple

from jaxtyping import Bool, Float, Int

from iswarm_mj.utils.arrays import Array


class Observation(NamedTuple):
    """All that N robots sense in one control step."""

    is_heard: Bool[Array, "N S"]
    """A message arrived on this side, and its check is right; elsewhere what it says is undefined."""
    bearing: Float[Array, "N S"]
    """Direction that it came from, in the robot's frame [rad]."""
    distance: Float[Array, "N S"]
    """Measured distance of its sender [mm]."""
    led: Int[Array, "N S"]
    """int32, LED number in the message."""
    payload: dict[str, Any]
    """(N, S) what the messages carry, by the names of the payload's fields (`sensors.messages.Payload`); vectors are in
    their senders' frames."""
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
    """The robot tried to lift a ball in this step, and the ball stayed on the floor."""
    sensed: Mapping[str, Array]
    """(N, ...) what else the task lets robots sense, by the names of `tasks.protocol.Task.senses`."""
    waits: Bool[Array, "N"]
    """The robot stays where it is in this step, whatever it commands: it works at a ball, or has no energy."""


class Command(NamedTuple):
    """What N robots do in one control step: turn, then move."""

    turn: Float[Array, "N"]
    """Anticlockwise [rad]."""
    forward: Float[Array, "N"]
    """[mm], negative backwards."""
