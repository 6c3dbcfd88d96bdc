"""What a task is: how worlds begin, what robots sense of it, what becomes of it, and how well they do."""

from collections.abc import Mapping
from typing import Any, Literal, NamedTuple, Protocol, runtime_checkable

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from iswarm_mj.config import SwarmConfig
from iswarm_mj.gripper.handling import Balls
from iswarm_mj.sensors.conditions import Conditions
from iswarm_mj.utils.arrays import Array
from iswarm_mj.utils.robot import Robot


class Quantity(NamedTuple):
    """A number that a task lets robots sense, or that it measures."""

    description: str
    unit: str = ""
    low: float = 0.0
    high: float = float("inf")


class Look(NamedTuple):
    """How areas on the floor are drawn."""

    colour: tuple[int, int, int]
    """Red, green, blue from 0 to 255."""
    shape: Literal["square", "disc"] = "disc"


class Things(NamedTuple):
    """What changes in a world beside the robots."""

    balls: Balls
    """K of them, which may be none."""
    own: Any = None
    """The task's own pytree of arrays."""


class Around(NamedTuple):
    """A world as its task finds it when a control step begins."""

    poses: Float[Array, "N 3"]
    """x, y [mm] and yaw [rad] of the robots."""
    is_present: Bool[Array, "N"]
    """The other places are empty."""
    is_alive: Bool[Array, "N"]
    picks: Bool[Array, "N"]
    """Robots that pick up what their tools reach."""
    conditions: Conditions
    """Noise, voltages and places of the world."""
    config: SwarmConfig
    """What worlds of one run have in common."""
    robot: Robot
    """Geometry of a robot."""
    voltage: Any = None
    """That the robots' capacitors have (N,) [V]; None: as much as a gripper asks for."""


class Sensed(NamedTuple):
    """What N robots sense of the task; with what they hear it makes the `Observation`."""

    at_dust: Bool[Array, "N"]
    """A ball lies beside or beneath the robot."""
    ball_vector: Float[Array, "N 2"]
    """From the robot to that ball, in the robot's frame [mm]."""
    on_dump: Bool[Array, "N"]
    """The robot is on the dump."""
    grasp_failed: Bool[Array, "N"]
    """The robot tried to lift a ball in this step, and the ball stayed on the floor."""
    own: Mapping[str, Array]
    """Of each of `Task.senses`, an array whose first axis is that of the robots."""


def only(n_robots: int, **own: Array) -> Sensed:
    """What robots sense of a task without balls and dump: these quantities alone."""
    no = jnp.zeros(n_robots, bool)
    return Sensed(no, jnp.zeros((n_robots, 2)), no, no, own)


@runtime_checkable
class Task(Protocol):
    """What N robots of one world are to do.

    A task is a dataclass: its fields are its settings, and flags of `iswarm run --task`. Like a strategy it is made a
    pytree (`strategy.pytrees.as_pytree`), so that numbers are arrays in the methods that say "JAX"; these run under
    `jit` and `vmap`, in every engine. `lay_out` and `goal` are plain Python, called once a world.

    Three attributes of its class are dictionaries, and may be left out: `senses`, a `Quantity` for each thing that
    robots sense beside balls and dump (`Sensed.own`, `Observation.sensed`); `measured`, one for each metric; `drawn`, a
    `Look` for each kind of areas (`DrawnTask.areas`). A tuple may be, too: `unused`, settings that have no effect in
    the task, as "arena.n_dust", or "gripper" for all of the group, whose flags `iswarm run` then refuses.
    """

    def lay_out(
        self, config: SwarmConfig, n_robots: int, rng: np.random.Generator, shared: np.random.Generator, cell: float
    ) -> tuple[Float[np.ndarray, "N 3"], Things]:
        """Return poses of the robots (x, y [mm], yaw [rad]) and all else at the start; see `tasks.layout`.

        Args:
            config: of the world.
            n_robots: N.
            rng: of the world.
            shared: draws what all worlds of a seed have in common; may be `rng`.
            cell: width of the cells on which robots start, so that none touches another [rd].
        """
        ...

    def goal(self, config: SwarmConfig, n_robots: int) -> int | None:
        """Return the progress with which nothing is left to do; None if there always is.

        Args:
            config: of the run.
            n_robots: N.
        """
        ...

    def advance(self, things: Things, around: Around, key: Array) -> tuple[Things, Sensed]:
        """Take a control step of all but the robots, and return what they sense of it; JAX.

        Args:
            things: from the step before.
            around: the world as the step begins.
            key: random key of this world and step.
        """
        ...

    def progress(self, things: Things) -> Int[Array, ""]:
        """Return how far the robots are, int32; a world is finished at the goal, or at `RunSettings.stop_at`; JAX."""
        ...

    def reward(self, before: Things, after: Things, around: Around) -> Float[Array, "N"]:
        """Return the reward of each robot for a control step, for learning; JAX.

        Args:
            before: the step before.
            after: what `advance` made of it.
            around: the world in which it did.
        """
        ...

    def metrics(self, things: Things) -> dict[str, Array]:
        """Return the scalars that `measured` names so far, float32, int32 or bool; JAX."""
        ...


@runtime_checkable
class DrawnTask(Task, Protocol):
    """A task with areas on the floor, which recordings and pictures show."""

    def areas(self, config: SwarmConfig, things: Things) -> dict[str, Float[Array, "M 3"]]:
        """Return the areas of each of `drawn`: x, y and half the width, or the radius [mm]; JAX.

        Args:
            config: of the world.
            things: in any control step.
        """
        ...
